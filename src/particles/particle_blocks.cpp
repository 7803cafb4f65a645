#include "particle_blocks.h"

#include "core/parallel_each.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/memory.h>

#include <fmt/format.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// Voxels on either side of a surface on which its distances depend. [derived: those of a cell
/// that it crosses, and their neighbors]
constexpr double kMargin = 2;
/// Share of a bin's volume that balls take where it is full. [derived: a plane through its middle
/// leaves half of it; a grid of particles leaves 8 of 11.9]
constexpr double kFull = 0.5;
bool before(const Vec3i& a, const Vec3i& b)
{
    return std::make_tuple(a[0], a[1], a[2]) < std::make_tuple(b[0], b[1], b[2]);
}

void sortOnce(std::vector<Vec3i>& blocks)
{
    tbb::parallel_sort(blocks.begin(), blocks.end(), before);
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
}

/// The distance from @a center to the farthest corner of @a box.
double farthest(const Vec3d& center, const Box3d& box)
{
    return (center - box.min()).cwiseAbs().cwiseMax((box.max() - center).cwiseAbs()).norm();
}

} // namespace

std::size_t ParticleBlocks::ByPlace::operator()(const Vec3i& at) const
{
    std::uint64_t hash = 0;
    for (int axis = 0; axis < 3; ++axis)
        hash = (hash ^ std::uint64_t(std::uint32_t(at[axis]))) * 0x9e3779b97f4a7c15u;
    return std::size_t(hash ^ hash >> 32);
}

ParticleBlocks::ParticleBlocks(const ParticleOctaves& octaves, const Lattice& lattice, bool fills,
                               Interrupter& progress)
    : mOctaves(octaves), mLattice(lattice)
{
    for (const ParticleBins& bins : octaves)
        mDeep.push_back(fills ? deepCells(bins, progress) : Cells());
}

ParticleBlocks::Cells ParticleBlocks::deepCells(const ParticleBins& bins,
                                                Interrupter& progress) const
{
    const auto volumeOf = [](double radius) { return 4 * M_PI / 3 * std::pow(radius, 3); };
    const double full = kFull * std::pow(bins.side(), 3);
    Fill fill;
    for (const ParticleBins::Bin& bin : bins.bins()) {
        progress.check();
        double volume = 0;
        for (std::uint32_t n = bin.run.begin; n < bin.run.end; ++n)
            volume += volumeOf(double(bins.radius()[n]));
        fill[bin.at] += float(volume / full);
    }
    const auto isFull = [&](const Vec3i& cell) {
        const auto found = fill.find(cell);
        return found != fill.end() && found->second >= 1;
    };
    Cells deep;
    for (const auto& [cell, share] : fill) {
        progress.check();
        bool isDeep = share >= 1;
        for (int n = 0; n < 27 && isDeep; ++n)
            isDeep = isFull(cell + Vec3i(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
        if (isDeep) deep.emplace(cell, char(1));
    }
    return deep;
}

Box3d ParticleBlocks::boxOf(const Vec3i& block) const
{
    const Vec3d low = mLattice.origin + kBlockDim * mLattice.voxelSize * block.cast<double>();
    return {low, low + Vec3d::Constant((kBlockDim - 1) * mLattice.voxelSize)};
}

bool ParticleBlocks::isDeep(const Vec3i& block) const
{
    const Box3d box = boxOf(block);
    for (std::size_t o = 0; o < mOctaves.size(); ++o) {
        if (mDeep[o].empty()) continue;
        const Vec3i first = mOctaves[o].binAt(box.min()), last = mOctaves[o].binAt(box.max());
        bool isDeep = true;
        for (int i = first[0]; i <= last[0] && isDeep; ++i)
            for (int j = first[1]; j <= last[1] && isDeep; ++j)
                for (int k = first[2]; k <= last[2] && isDeep; ++k)
                    isDeep = mDeep[o].count({i, j, k}) > 0;
        if (isDeep) return true;
    }
    return false;
}

bool ParticleBlocks::isInBall(const Vec3i& block) const
{
    const Box3d box = boxOf(block);
    const double margin = kMargin * mLattice.voxelSize, across = box.diagonal().norm() / 2;
    for (const ParticleBins& bins : mOctaves) {
        const double reach = bins.largestRadius() - margin;
        if (reach < across) continue;
        bool isIn = false;
        const Vec3d far = Vec3d::Constant(reach);
        bins.forEachRunIn({box.max() - far, box.min() + far}, [&](const ParticleBins::Run& run) {
            for (std::uint32_t n = run.begin; n < run.end && !isIn; ++n)
                isIn = farthest(bins.center(n).cast<double>(), box) <
                       double(bins.radius()[n]) - margin;
        });
        if (isIn) return true;
    }
    return false;
}

bool ParticleBlocks::isInside(const Vec3i& block) const
{
    return isDeep(block) || isInBall(block);
}

/// Append the blocks about the surface of a ball, those in its midst left out.
void ParticleBlocks::addBlocks(const Vec3d& center, double radius, std::vector<Vec3i>& blocks) const
{
    const double h = mLattice.voxelSize, side = kBlockDim * h, outer = radius + kMargin * h,
                 inner = radius - kMargin * h;
    const Vec3d at = (center - mLattice.origin) / side;
    const auto blockAt = [&](double place) { return int(std::floor(place)); };
    /// A block's voxels reach from its lower corner to a voxel before its upper one.
    constexpr double kGap = 1.0 / kBlockDim; // [derived: a voxel, blocks]
    const auto offset = [&](int block, double center_) {
        return std::max({0.0, double(block) - center_, center_ - (double(block) + 1 - kGap)});
    };
    const auto farther = [&](int block, double center_) {
        return std::max(center_ - double(block), double(block) + 1 - kGap - center_);
    };
    const double out = outer / side, in = std::max(inner, 0.0) / side;
    for (int i = blockAt(at[0] - out); i <= blockAt(at[0] + out); ++i) {
        const double x = offset(i, at[0]), farX = farther(i, at[0]);
        for (int j = blockAt(at[1] - out); j <= blockAt(at[1] + out); ++j) {
            const double y = offset(j, at[1]), farY = farther(j, at[1]);
            const double square = out * out - x * x - y * y;
            if (square < 0) continue;
            const double z = std::sqrt(square);
            const int first = blockAt(at[2] - z + kGap), last = blockAt(at[2] + z);
            // Whole blocks within the inner ball: from center - depth to center + depth.
            const double depth2 = in * in - farX * farX - farY * farY;
            int skipFrom = last + 1, skipTo = last;
            if (depth2 > 0) {
                const double depth = std::sqrt(depth2);
                skipFrom = int(std::ceil(at[2] - depth));
                skipTo = blockAt(at[2] + depth - (1 - kGap));
            }
            for (int k = first; k <= last; ++k)
                if (k < skipFrom || k > skipTo)
                    blocks.push_back({i, j, k});
                else
                    k = std::max(k, skipTo);
        }
    }
}

std::vector<Vec3i> ParticleBlocks::nearSurface(std::uint64_t maxBytes, Interrupter& progress) const
{
    const double side = kBlockDim * mLattice.voxelSize;
    double candidates = 0; // at most, with what is found twice
    for (const ParticleBins& bins : mOctaves) {
        const double across = 2 * (bins.largestRadius() / side) + 2;
        candidates += double(bins.bins().size()) * M_PI * std::pow(across, 2);
    }
    const double bytes = candidates * sizeof(Vec3i);
    if (maxBytes && bytes > double(maxBytes))
        throw LimitError(fmt::format(
            "particles: about {} are needed to find the voxels of size {:.4g} beside balls of "
            "radius {:.4g}, and the limit is {}. Use larger voxels or a larger --max-memory",
            sizeText(std::uint64_t(std::min(bytes, 1e18))), mLattice.voxelSize,
            mOctaves.back().largestRadius(), sizeText(maxBytes)));
    std::vector<Vec3i> all;
    for (std::size_t o = 0; o < mOctaves.size(); ++o) {
        const ParticleBins& bins = mOctaves[o];
        constexpr std::size_t kBinsPerChunk = 64; // [free: the same blocks]
        const std::size_t chunks = (bins.bins().size() + kBinsPerChunk - 1) / kBinsPerChunk;
        std::vector<Vec3i> found =
            gatherParallel<Vec3i>(chunks, 1, progress, [&](std::size_t c, std::vector<Vec3i>& to) {
                /// Blocks that are not yet sorted. [free: the same blocks]
                constexpr std::size_t kFew = 4096;
                const std::size_t end = std::min((c + 1) * kBinsPerChunk, bins.bins().size());
                std::size_t kept = 0;
                for (std::size_t b = c * kBinsPerChunk; b < end; ++b) {
                    const ParticleBins::Run& run = bins.bins()[b].run;
                    for (std::uint32_t n = run.begin; n < run.end; ++n) {
                        progress.check();
                        addBlocks(bins.center(n).cast<double>(), double(bins.radius()[n]), to);
                        if (to.size() < 2 * kept + kFew) continue;
                        sortOnce(to);
                        kept = to.size();
                    }
                }
                sortOnce(to);
            });
        all.insert(all.end(), found.begin(), found.end());
    }
    sortOnce(all);
    std::vector<char> keep(all.size());
    forEachParallel(all.size(), 256, progress, [&](std::size_t n) { keep[n] = !isInside(all[n]); });
    std::size_t kept = 0;
    for (std::size_t n = 0; n < all.size(); ++n)
        if (keep[n]) all[kept++] = all[n];
    all.resize(kept);
    return all;
}

} // namespace mpuvdb
