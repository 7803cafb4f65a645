#include "particle_bins.h"

#include "core/parallel_each.h"
#include "spatial/key_order.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr int kKeyBits = 20; ///< of a bin's place along an axis [derived: three fit 64 bits]
/// Bins along the longest side at most; a bin more may lie at its end. [derived: of the bits]
constexpr double kMostBins = (1 << kKeyBits) - 1;
/// Numbers behind the last place that may be read. [derived: a register of eight]
constexpr std::size_t kPadding = 8;
constexpr std::size_t kBinGrain = 1 << 14; // particles; [free: the same bins]

std::uint64_t keyOf(const Vec3i& bin)
{
    return (std::uint64_t(bin[0]) << (2 * kKeyBits)) + (std::uint64_t(bin[1]) << kKeyBits) +
           std::uint64_t(bin[2]);
}

Vec3i binOf(std::uint64_t key)
{
    constexpr std::uint64_t kMask = (1 << kKeyBits) - 1; // [derived: of the bits]
    return {int(key >> (2 * kKeyBits)), int(key >> kKeyBits & kMask), int(key & kMask)};
}

} // namespace

ParticleBins::ParticleBins(const std::vector<Vec3f>& positions, const std::vector<float>& radii,
                           const std::vector<std::uint32_t>& of, const Box3d& bounds, double unit,
                           Interrupter& progress)
    : mCorner(bounds.min())
{
    for (const std::uint32_t i : of) mLargest = std::max(mLargest, double(radii[i]));
    mSide = std::max(kSupport * mLargest, bounds.sizes().maxCoeff() / kMostBins);
    mLast = ((bounds.max() - mCorner) / mSide).array().floor();
    const auto keyOfParticle = [&](std::uint32_t i) {
        return keyOf(binAt(positions[i].cast<double>()));
    };
    const std::size_t size = of.size();
    mOrder = orderByKeys(
        size, 3 * kKeyBits, [&](std::uint32_t n) { return keyOfParticle(of[n]); }, progress);
    for (std::vector<float>* const numbers : {&mX, &mY, &mZ, &mRadius, &mVolume})
        numbers->resize(size + kPadding);
    forEachParallel(size, kBinGrain, progress, [&](std::size_t n) {
        const std::uint32_t i = of[mOrder[n]];
        mOrder[n] = i;
        mX[n] = positions[i].x();
        mY[n] = positions[i].y();
        mZ[n] = positions[i].z();
        mRadius[n] = radii[i];
        mVolume[n] = float(std::pow(double(radii[i]) / unit, 3));
    });
    for (std::uint32_t n = 0; n < size; ++n) {
        if (n % kBinGrain == 0) progress.check();
        const std::uint64_t key = keyOfParticle(mOrder[n]);
        if (mKeys.empty() || key != mKeys.back()) {
            mKeys.push_back(key);
            mBins.push_back({binOf(key), {n, n}});
        }
        mBins.back().run.end = n + 1;
    }
}

std::size_t ParticleBins::notBefore(std::size_t begin, const Vec3i& at) const
{
    const auto from = mKeys.begin() + std::ptrdiff_t(begin);
    return std::size_t(std::lower_bound(from, mKeys.end(), keyOf(at)) - mKeys.begin());
}

ParticleOctaves binParticles(const std::vector<Vec3f>& positions, const std::vector<float>& radii,
                             Interrupter& progress)
{
    Box3d bounds;
    std::vector<std::vector<std::uint32_t>> byOctave;
    const auto [low, high] = std::minmax_element(radii.begin(), radii.end());
    const int first = std::ilogb(*low);
    byOctave.resize(std::size_t(std::ilogb(*high) - first + 1));
    for (std::uint32_t i = 0; i < positions.size(); ++i) {
        if (i % kBinGrain == 0) progress.check();
        bounds.extend(positions[i].cast<double>());
        byOctave[std::size_t(std::ilogb(radii[i]) - first)].push_back(i);
    }
    ParticleOctaves octaves;
    for (const std::vector<std::uint32_t>& of : byOctave)
        if (!of.empty()) octaves.emplace_back(positions, radii, of, bounds, *high, progress);
    return octaves;
}

} // namespace mpuvdb
