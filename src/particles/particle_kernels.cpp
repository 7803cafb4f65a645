#include "particle_kernels.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "core/parallel_each.h"

#include <Eigen/Dense>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Lanes = float __attribute__((vector_size(32)));
using Numbers = int __attribute__((vector_size(32)));
constexpr int kLanes = 8; // [derived: of a register of 32 bytes]

/// Support of a lone particle's kernel, radii. [derived: (1 - q^2)^3 has the iso value at the
/// radius: 1 / sqrt(1 - cbrt(kIsoValue))]
constexpr double kLoneSupport = 2.738782;
/// Sum over a particle's neighbors by its largest kernel, its own volumes, from which on it has
/// that. [derived: of the first layer of particles in a cubic grid that fill a half-space]
constexpr double kFullSum = 4.896507;
/// Radius of the neighbors whose covariance shapes a kernel, radii. [paper: Yu13, 2 h, for the
/// support h of a lone particle]
constexpr double kNeighbors = 2 * kLoneSupport;
/// Neighbors from which on a kernel is as anisotropic as they are; with fewer it is less so.
/// [paper: Yu13, N_eps]
constexpr double kEnough = 25;
/// Largest ratio of two variances. [paper: Yu13, k_r]
constexpr double kMaxVariance = 4;
/// Mean of the neighbors' weights 1 - (r/R)^4 in a ball. [derived: its integral]
constexpr double kMeanWeight = 4.0 / 7;
/// Volume of (1 - q^2)^3, supports cubed. [derived: its integral, 64 pi / 315]
constexpr double kKernelVolume = 0.63829136;
/// Least length of an axis, local spacings: two sheets of particles that are one spacing apart, and
/// those alone, are one body. [derived: sheets of (1 - q^2)^3 have (1 - z^2)^4 across, and midway
/// 2 (1 - z^2)^4 / (1 + (1 - 4 z^2)^4) = kIsoValue for half a spacing of z = 0.4946 axes]
constexpr double kLeastAxis = 1.0108;

/// Sums over the neighbors of a particle, eight of them at a time.
struct Sums {
    Lanes count{}, kernel{}, peers{}, smaller{}, weight{}, x{}, y{}, z{}, xx{}, yy{}, zz{}, xy{},
        xz{}, yz{};
};

/// A particle whose neighbors are summed, by the reciprocals that this takes.
struct Center {
    Vec3f place;
    float perRadius;
    float perNeighbors, perSupport, perLoneSupport; ///< of the squares of these radii

    Center(const Vec3f& at, double radius)
        : place(at), perRadius(float(1 / radius)), perNeighbors(square(kNeighbors * radius)),
          perSupport(square(kSupport * radius)), perLoneSupport(square(kLoneSupport * radius))
    {
    }

private:
    static float square(double length) { return float(1 / (length * length)); }
};

struct Places {
    const float *x, *y, *z, *radius, *volume;
};

float sum(const Lanes& v)
{
    return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
}

/// (1 - q^2)^3 where that is above 0.
Lanes kernelAt(const Lanes& squares)
{
    Lanes t = 1 - squares;
    t = t > 0 ? t : Lanes{};
    return t * t * t;
}

/// Add the particles of @a run about @a center.
MPUVDB_CLONES
void addNeighbors(Sums& sums, const Places& places, const ParticleBins::Run& run,
                  const Center& center)
{
    const Numbers lane = {0, 1, 2, 3, 4, 5, 6, 7};
    for (std::uint32_t n = run.begin; n < run.end; n += kLanes) {
        const Lanes x = lanesAt<Lanes>(places.x + n) - center.place.x(),
                    y = lanesAt<Lanes>(places.y + n) - center.place.y(),
                    z = lanesAt<Lanes>(places.z + n) - center.place.z();
        const Lanes square = x * x + y * y + z * z, far = square * center.perNeighbors;
        const Numbers isNear = (far < 1) & (lane < int(run.end - n));
        const Lanes volume = isNear ? lanesAt<Lanes>(places.volume + n) : Lanes{};
        const Lanes fading = 1 - far * far, weight = isNear ? volume * fading : Lanes{};
        sums.count += isNear ? fading : Lanes{};
        sums.kernel += volume * kernelAt(square * center.perSupport);
        // Those half as large, and smaller ones, do not fill a particle's room; its equals do.
        Lanes share = 2 * center.perRadius * lanesAt<Lanes>(places.radius + n) - 1;
        share = share > 0 ? share : Lanes{};
        share = share < 1 ? share : Lanes{} + 1;
        const Lanes lone = volume * kernelAt(square * center.perLoneSupport);
        sums.peers += share * lone;
        sums.smaller += (1 - share) * lone;
        sums.weight += weight;
        const Lanes wx = weight * x, wy = weight * y, wz = weight * z;
        sums.x += wx;
        sums.y += wy;
        sums.z += wz;
        sums.xx += wx * x;
        sums.yy += wy * y;
        sums.zz += wz * z;
        sums.xy += wx * y;
        sums.xz += wx * z;
        sums.yz += wy * z;
    }
}

/// The sum of the volumes of the particles of @a run by the kernel @a k at their places.
MPUVDB_CLONES
void addKernel(Lanes& into, const Places& places, const ParticleBins::Run& run,
               const ParticleKernel& k)
{
    const Numbers lane = {0, 1, 2, 3, 4, 5, 6, 7};
    for (std::uint32_t n = run.begin; n < run.end; n += kLanes) {
        const Lanes x = lanesAt<Lanes>(places.x + n) - k.center.x(),
                    y = lanesAt<Lanes>(places.y + n) - k.center.y(),
                    z = lanesAt<Lanes>(places.z + n) - k.center.z();
        Lanes t = 1 - (k.form[0] * x * x + k.form[1] * y * y + k.form[2] * z * z +
                       2 * (k.form[3] * x * y + k.form[4] * x * z + k.form[5] * y * z));
        t = (t > 0) & (lane < int(run.end - n)) ? t : Lanes{};
        into += lanesAt<Lanes>(places.volume + n) * (t * t * t);
    }
}

/// Principal axes of neighbors, as columns, and the lengths of the kernel's along them.
struct Axes {
    Eigen::Matrix3d directions = Eigen::Matrix3d::Identity();
    Vec3d lengths;
};

/// The support of the kernel of a particle of @a radius and @a volume: more among others.
double supportOf(const Sums& sums, double radius, double volume)
{
    const double others = double(sum(sums.kernel)) / volume - 1;
    const double share = std::clamp(others / kFullSum, 0.0, 1.0);
    return radius * (kLoneSupport + share * (kSupport - kLoneSupport));
}

/// The axes of the kernel of a particle of @a radius and @a volume.
Axes axesOf(const Sums& sums, double radius, double volume)
{
    const double support = supportOf(sums, radius, volume);
    Axes axes;
    axes.lengths = Vec3d::Constant(support);
    const double weight = double(sum(sums.weight));
    const Vec3d mean = Vec3d(sum(sums.x), sum(sums.y), sum(sums.z)) / weight;
    const double xy = double(sum(sums.xy)), xz = double(sum(sums.xz)), yz = double(sum(sums.yz));
    Eigen::Matrix3d covariance;
    covariance << double(sum(sums.xx)), xy, xz, xy, double(sum(sums.yy)), yz, xz, yz,
        double(sum(sums.zz));
    covariance = covariance / weight - mean * mean.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    const double largest = solver.eigenvalues()[2];
    if (!(largest > 0)) return axes;
    // Logarithms of the axes: roots of the variances, with their geometric mean as the unit.
    const Eigen::Array3d variances = solver.eigenvalues().array().max(largest / kMaxVariance);
    Eigen::Array3d logs = variances.log() / 2;
    logs -= logs.mean();
    const double neighbors = double(sum(sums.count)) - 1;
    double share = std::clamp(neighbors / (kMeanWeight * kEnough), 0.0, 1.0);
    const double spacing = kSupport * radius *
                           std::cbrt(volume * kKernelVolume / double(sum(sums.kernel))),
                 room = std::min(0.0, std::log(kLeastAxis * spacing / support));
    if (logs[0] * share < room) share = room / logs[0];
    axes.directions = solver.eigenvectors();
    axes.lengths = support * (share * logs).exp();
    return axes;
}

/// The kernel of unit weight with @a axes.
ParticleKernel kernelOf(const Vec3f& center, const Axes& axes)
{
    const Eigen::Matrix3d& e = axes.directions;
    const Eigen::Array3d squares = axes.lengths.array().square();
    const Eigen::Matrix3d form = e * squares.inverse().matrix().asDiagonal() * e.transpose();
    const Vec3d reach = (e.cwiseAbs2() * squares.matrix()).cwiseSqrt();
    ParticleKernel kernel;
    kernel.center = center;
    kernel.reach = reach.cast<float>();
    kernel.form = {float(form(0, 0)), float(form(1, 1)), float(form(2, 2)),
                   float(form(0, 1)), float(form(0, 2)), float(form(1, 2))};
    kernel.weight = 1;
    return kernel;
}

} // namespace

/// The particles about a bin.
class ParticleKernels::Neighbors
{
public:
    /// Those in @a box.
    Neighbors(const ParticleOctaves& octaves, const Box3d& box)
    {
        for (const ParticleBins& bins : octaves) {
            const Places places{bins.x(), bins.y(), bins.z(), bins.radius(), bins.volume()};
            bins.forEachRunIn(box, [&](const ParticleBins::Run& run) {
                mRuns.push_back({places, run});
            });
        }
    }
    /// The sums about a particle.
    Sums about(const Center& center) const
    {
        Sums sums;
        for (const auto& [places, run] : mRuns) addNeighbors(sums, places, run, center);
        return sums;
    }
    double sumOf(const ParticleKernel& kernel) const
    {
        Lanes lanes{};
        for (const auto& [places, run] : mRuns) addKernel(lanes, places, run, kernel);
        return double(sum(lanes));
    }

private:
    std::vector<std::pair<Places, ParticleBins::Run>> mRuns;
};

ParticleKernels::ParticleKernels(const ParticleOctaves& octaves)
    : mOctaves(octaves), mKernels(octaves.size())
{
    for (std::size_t o = 0; o < octaves.size(); ++o) {
        mKernels[o].resize(octaves[o].size());
        mMade.emplace_back(octaves[o].bins().size(), char(0));
    }
}

Box3d ParticleKernels::grown(const Box3d& box, std::size_t o) const
{
    const Vec3d reach = Vec3d::Constant(kLongestAxis * kSupport * mOctaves[o].largestRadius());
    return {box.min() - reach, box.max() + reach};
}

void ParticleKernels::makeBin(std::size_t octave, std::size_t bin, Interrupter& progress)
{
    const ParticleBins& bins = mOctaves[octave];
    const ParticleBins::Bin& own = bins.bins()[bin];
    const Vec3d corner = bins.lowerCorner(own.at),
                reach = Vec3d::Constant(std::max(kNeighbors, kLongestAxis * kSupport) *
                                        bins.largestRadius());
    const Neighbors neighbors(mOctaves,
                              {corner - reach, corner + Vec3d::Constant(bins.side()) + reach});
    for (std::uint32_t n = own.run.begin; n < own.run.end; ++n) {
        progress.check();
        const double radius = double(bins.radius()[n]), volume = double(bins.volume()[n]);
        const Sums sums = neighbors.about({bins.center(n), radius});
        ParticleKernel kernel = kernelOf(bins.center(n), axesOf(sums, radius, volume));
        kernel.weight = float(volume / neighbors.sumOf(kernel));
        kernel.loneSupport = float(kLoneSupport * radius);
        kernel.loneWeight = sum(sums.smaller) > 0 ? float(volume) / sum(sums.peers) : 0;
        mKernels[octave][n] = kernel;
    }
}

void ParticleKernels::makeWithin(const std::vector<Box3d>& boxes, double units,
                                 Interrupter& progress)
{
    constexpr std::size_t kGrain = 64; // boxes; [free: the same kernels]
    for (std::size_t o = 0; o < mOctaves.size(); ++o) {
        std::vector<std::atomic<char>> wanted(mOctaves[o].bins().size());
        forEachParallel(boxes.size(), kGrain, progress, [&](std::size_t n) {
            mOctaves[o].forEachColumnIn(grown(boxes[n], o),
                                        [&](std::size_t begin, std::size_t end) {
                                            for (std::size_t bin = begin; bin < end; ++bin)
                                                wanted[bin].store(1, std::memory_order_relaxed);
                                        });
        });
        std::vector<std::size_t> bins;
        for (std::size_t bin = 0; bin < wanted.size(); ++bin)
            if (wanted[bin] && !mMade[o][bin]) bins.push_back(bin);
        forEachParallel(bins.size(), 1, progress, [&](std::size_t n) {
            makeBin(o, bins[n], progress);
            mMade[o][bins[n]] = 1;
            progress.advance(units / double(mOctaves.size() * bins.size()));
        });
    }
}

} // namespace mpuvdb
