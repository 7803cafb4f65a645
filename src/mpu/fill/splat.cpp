#include "splat.h"

#include "core/clones.h"
#include "spatial/point_group.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr double kKernelRadius = 1.5; ///< radius of a splat, node steps [tuned: coarse_sign_test]
/// Squared distance, node steps, below which points weigh alike in a splat, and the distance added
/// to it for noise, standard deviations: single points shall not draw the surface.
/// [tuned: noise_bench]
constexpr double kSoftness = 0.1, kSoftnessNoises = 2;
/// Weight of data at a node against the spline between them: it nearly interpolates.
/// [tuned: unseen_bench; with a tenth of it, what nobody saw is 3 % farther off]
constexpr float kDataWeight = 1600;
static_assert(kDataWeight >= TensionSpline::kMinWeight);
/// Largest cubes whose points are merged into a dipole, node steps. [tuned: unseen_bench]
constexpr double kDipoleSize = 0.55;
/// Largest distance of data from the line through a node along their normal, node steps.
/// [tuned: unseen_bench]
constexpr double kMaxLateral = 0.6;

/// First level with cubes no larger than @a size.
int levelOf(const RootCube& root, double size)
{
    int level = 0;
    while (level < SortedPoints::kMaxLevel && root.size(level) > size) ++level;
    return level;
}

/// Dipoles sorted by plane of the node grid's cells, and there by row.
struct Bins {
    std::vector<std::uint32_t> start; ///< first dipole of each plane
    std::vector<Dipole> dipoles;
};

Bins binDipoles(const std::vector<Dipole>& dipoles, const NodeGrid& nodes, const Vec3d& corner,
                double step)
{
    const int planes = nodes.n[0] - 1, rows = nodes.n[1] - 1; // of cells
    std::vector<std::uint32_t> rowOf, next(std::size_t(planes) * std::size_t(rows) + 1, 0);
    rowOf.reserve(dipoles.size());
    for (const Dipole& d : dipoles) {
        const Vec3d c = (d.position.cast<double>() - corner) / step;
        const int plane = std::clamp(int(std::floor(c[0])), 0, planes - 1);
        rowOf.push_back(
            std::uint32_t(plane * rows + std::clamp(int(std::floor(c[1])), 0, rows - 1)));
        ++next[rowOf.back() + 1];
    }
    for (std::size_t n = 1; n < next.size(); ++n) next[n] += next[n - 1];
    Bins bins;
    for (int i = 0; i <= planes; ++i)
        bins.start.push_back(next[std::size_t(i) * std::size_t(rows)]);
    bins.dipoles.resize(dipoles.size());
    for (std::size_t d = 0; d < dipoles.size(); ++d) bins.dipoles[next[rowOf[d]]++] = dipoles[d];
    return bins;
}

/// Weighted sums over the dipoles around a node.
struct NodeSums {
    double weight, value, magnitude;
    Vec3d offset, normal;

    /// Whether data lie below or above the node, not beside it, and agree about the side.
    bool supported(double step) const
    {
        const Vec3d mean = offset / weight;
        const Vec3d direction = normal.normalized();
        const double lateral = (mean - mean.dot(direction) * direction).norm();
        return lateral <= kMaxLateral * step &&
               (normal.norm() >= 0.7 * weight || std::abs(value) >= 0.5 * magnitude);
    }
};

/// The sums of the nodes of one plane of the grid, row after row.
class PlaneSums
{
public:
    PlaneSums(const NodeGrid& grid, const Vec3d& corner, double step, double noise)
        : mGrid(grid), mCorner(corner), mStep(step),
          mSoftness(kSoftness + std::pow(kSoftnessNoises * noise / step, 2))
    {
        for (auto& sum : mSums) sum.assign(std::size_t(grid.n[1]) * std::size_t(grid.n[2]), 0.0);
    }

    /// Add the dipoles to the nodes of plane @a i within their kernels.
    void add(const Dipole* begin, const Dipole* end, int i);

    /// Call f(row, node, sums) for the interior nodes with dipoles around, and clear all sums.
    template <typename F>
    void take(F f)
    {
        std::size_t n = 0;
        for (int j = 0; j < mGrid.n[1]; ++j)
            for (int k = 0; k < mGrid.n[2]; ++k, ++n) {
                if (!(mSums[0][n] > 0)) continue;
                std::array<double, kSums> s;
                for (std::size_t m = 0; m < kSums; ++m) s[m] = std::exchange(mSums[m][n], 0.0);
                if (j == 0 || k == 0 || j == mGrid.n[1] - 1 || k == mGrid.n[2] - 1) continue;
                f(j, k, NodeSums{s[0], s[1], s[2], {s[3], s[4], s[5]}, {s[6], s[7], s[8]}});
            }
    }

private:
    static constexpr int kLanes = 4; ///< nodes across a kernel [derived: doubles of a Group]
    static constexpr std::size_t kSums =
        9; ///< sums of a node [derived: numbers of NodeSums, in order]

    NodeGrid mGrid;
    Vec3d mCorner;
    double mStep;
    double mSoftness; ///< square of a distance, node steps
    std::array<std::vector<double>, kSums> mSums;
};

MPUVDB_WIDE_CLONES
void PlaneSums::add(const Dipole* begin, const Dipole* end, int i)
{
    const double step2 = mStep * mStep, x = mCorner[0] + mStep * i;
    for (const Dipole* d = begin; d < end; ++d) {
        const Vec3d p = d->position.cast<double>(), n = d->normal.cast<double>();
        const double rx = x - p[0], rx2 = rx * rx;
        if (rx2 >= kKernelRadius * kKernelRadius * step2) continue;
        const auto firstNode = [&](int axis) {
            const double lowest = (p[axis] - mCorner[axis]) / mStep - kKernelRadius;
            return std::clamp(int(std::ceil(lowest)), 0, mGrid.n[std::size_t(axis)] - kLanes);
        };
        const int j0 = firstNode(1), k0 = firstNode(2);
        const Group lanes{0, 1, 2, 3};
        const Group rz = mCorner[2] + mStep * (double(k0) + lanes) - p[2], rz2 = rz * rz;
        for (int j = j0; j < j0 + kLanes; ++j) {
            const double ry = mCorner[1] + mStep * j - p[1];
            if (rx2 + ry * ry >= kKernelRadius * kKernelRadius * step2)
                continue; // as for most rows
            const Group d2 = (rx2 + ry * ry + rz2) / step2,
                        cut = 1 - d2 / (kKernelRadius * kKernelRadius);
            const Group w = cut > 0 ? cut * cut / ((d2 + mSoftness) * (d2 + mSoftness)) : Group{};
            const Group side = n[0] * rx + n[1] * ry + n[2] * rz;
            const Group heavy = w * double(d->weight);
            const Group terms[kSums] = {heavy,      w * side,   w * (side < 0 ? -side : side),
                                        heavy * rx, heavy * ry, heavy * rz,
                                        w * n[0],   w * n[1],   w * n[2]};
            const std::size_t node = std::size_t(j) * std::size_t(mGrid.n[2]) + std::size_t(k0);
            for (std::size_t m = 0; m < kSums; ++m) {
                double* const to = &mSums[m][node];
                Group sum;
                std::memcpy(&sum, to, sizeof sum);
                sum += terms[m];
                std::memcpy(to, &sum, sizeof sum);
            }
        }
    }
}

} // namespace

double dipoleSize(double step)
{
    return kDipoleSize * step;
}

double DipoleSource::meanSpacing() const
{
    int level = 1;
    while (level < SortedPoints::kMaxLevel && std::ldexp(8.0, 2 * level) < double(mPoints.size()))
        ++level;
    std::size_t occupied = 0;
    mPoints.forEachCell(level, [&](std::size_t, std::size_t) { ++occupied; });
    return mRoot.size(level) * std::sqrt(double(occupied) / (1.5 * double(mPoints.size())));
}

void DipoleSource::add(int level, const SortedPoints::Range& among,
                       std::vector<Dipole>& dipoles) const
{
    const PointArrays& p = mPoints.points();
    mPoints.forEachCell(level, among, [&](std::size_t begin, std::size_t end) {
        Vec3d position = Vec3d::Zero(), normal = Vec3d::Zero();
        double weight = 0;
        for (std::size_t n = begin; n < end; ++n) {
            const double c = p.confidence[n];
            position += c * Vec3d(p.x[n], p.y[n], p.z[n]);
            normal += c * Vec3d(p.nx[n], p.ny[n], p.nz[n]);
            weight += c;
        }
        if (!(weight > 0)) return;
        // Each cube counts once, however densely it was sampled.
        const double mean = weight / double(end - begin);
        dipoles.push_back({(position / weight).cast<float>(),
                           (mean * normal / weight).cast<float>(), float(mean)});
    });
}

std::vector<Dipole> DipoleSource::all(double size) const
{
    constexpr std::size_t kChunk = 1 << 14; ///< points of a task [free: grain]
    const int level = levelOf(mRoot, size);
    std::vector<std::vector<Dipole>> chunks((mPoints.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), chunks.size(), [&](std::size_t c) {
        const std::size_t begin = c * kChunk;
        add(level, {begin, std::min(begin + kChunk, mPoints.size())}, chunks[c]);
    });
    std::vector<Dipole> dipoles;
    for (const auto& chunk : chunks) dipoles.insert(dipoles.end(), chunk.begin(), chunk.end());
    return dipoles;
}

bool DipoleSource::isAny(const Box3d& box, double size,
                         const std::function<bool(const Vec3d&)>& f) const
{
    const PointArrays& points = mPoints.points();
    const int level = levelOf(mRoot, size),
              cover = std::min(level, levelOf(mRoot, box.sizes().maxCoeff()));
    const OctreeCell first = mRoot.cellAt(box.min(), cover), last = mRoot.cellAt(box.max(), cover);
    bool isAny = false;
    for (std::uint32_t i = first.i; i <= last.i; ++i)
        for (std::uint32_t j = first.j; j <= last.j; ++j)
            for (std::uint32_t k = first.k; k <= last.k; ++k) {
                const SortedPoints::Range range = mPoints.cellRange({cover, i, j, k});
                mPoints.forEachCell(level, range, [&](std::size_t begin, std::size_t) {
                    const Vec3d p(points.x[begin], points.y[begin], points.z[begin]);
                    isAny = isAny || (box.contains(p) && f(p));
                });
                if (isAny) return true;
            }
    return false;
}

std::vector<Dipole> DipoleSource::near(const Nodes& nodes, double size) const
{
    const double margin = kKernelRadius * nodes.step;
    const Vec3d low = nodes.corner - Vec3d::Constant(margin),
                high = nodes.at(nodes.grid.n[0] - 1, nodes.grid.n[1] - 1, nodes.grid.n[2] - 1) +
                       Vec3d::Constant(margin);
    const int level = levelOf(mRoot, size),
              cover = std::min(level, levelOf(mRoot, (high - low).maxCoeff()));
    // A dipole is in its cube.
    const OctreeCell first = mRoot.cellAt(low, cover), last = mRoot.cellAt(high, cover);
    std::vector<Dipole> dipoles;
    for (std::uint32_t i = first.i; i <= last.i; ++i)
        for (std::uint32_t j = first.j; j <= last.j; ++j)
            for (std::uint32_t k = first.k; k <= last.k; ++k)
                add(level, mPoints.cellRange({cover, i, j, k}), dipoles);
    const auto isFar = [&](const Dipole& d) {
        const Vec3d p = d.position.cast<double>();
        return (p.array() < low.array()).any() || (p.array() > high.array()).any();
    };
    dipoles.erase(std::remove_if(dipoles.begin(), dipoles.end(), isFar), dipoles.end());
    return dipoles;
}

NodeData splat(const std::vector<Dipole>& dipoles, const Nodes& nodes, double noise,
               Interrupter& progress)
{
    const NodeGrid& grid = nodes.grid;
    const double step = nodes.step;
    const Bins bins = binDipoles(dipoles, grid, nodes.corner, step);
    NodeData data(grid);
    tbb::enumerable_thread_specific<PlaneSums> scratch(
        [&] { return PlaneSums(grid, nodes.corner, step, noise); });
    tbb::parallel_for(1, grid.n[0] - 1, [&](int i) {
        progress.check();
        PlaneSums& plane = scratch.local();
        const Dipole* const all = bins.dipoles.data();
        plane.add(all + bins.start[std::size_t(std::max(i - 2, 0))],
                  all + bins.start[std::size_t(std::min(i + 2, grid.n[0] - 1))], i);
        plane.take([&](int j, int k, const NodeSums& sums) {
            if (!sums.supported(step)) return;
            const std::size_t n = grid.index(i, j, k);
            data.weight[n] = kDataWeight;
            data.distance[n] = float(sums.value / sums.weight / step);
        });
    });
    return data;
}
} // namespace mpuvdb
