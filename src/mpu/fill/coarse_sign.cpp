#include "coarse_sign.h"

#include "coarse_fill.h"
#include "core/clones.h"
#include "files/array_file.h"
#include "spatial/point_group.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <type_traits>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Padding of the grid on each side, in extents of the points. [tuned: unseen_bench]
constexpr double kPadding = 0.2;
constexpr int kMaxNodes = 96;         ///< nodes along the longest side [tuned: unseen_bench, time]
constexpr double kKernelRadius = 1.5; ///< radius of a splat, node steps [tuned: coarse_sign_test]
/// Squared distance, node steps, below which points weigh alike in a splat, and the distance added
/// to it for noise, standard deviations: single points shall not draw the surface.
/// [tuned: noise_bench]
constexpr double kSoftness = 0.1, kSoftnessNoises = 2;
/// Weight of data at a node against the equation between them. [tuned: coarse_sign_test]
constexpr float kDataWeight = 16;
/// Largest cubes whose points are merged into a dipole, node steps. [tuned: unseen_bench]
constexpr double kDipoleSize = 0.55;
/// Largest distance of data from the line through a node along their normal, node steps.
/// [tuned: unseen_bench]
constexpr double kMaxLateral = 0.6;
/// Largest cubes of dipoles for distances from the box, node steps. [tuned: unseen_bench, time]
constexpr double kBorderDipoleSize = 9;

/// The points of a small cube merged into one: mean position, weighted sum of normals.
struct Dipole {
    Vec3f position, normal;
    float weight;
};

/// Mean distance between points, by the area of the occupied cells of a level with a few points per
/// cell; a plane meets a cube in 2/3 of its face on average.
double meanSpacing(const SortedPoints& points, const RootCube& root)
{
    int level = 1;
    while (level < SortedPoints::kMaxLevel && std::ldexp(8.0, 2 * level) < double(points.size()))
        ++level;
    std::size_t occupied = 0;
    points.forEachCell(level, [&](std::size_t, std::size_t) { ++occupied; });
    return root.size(level) * std::sqrt(double(occupied) / (1.5 * double(points.size())));
}

/// Add the dipoles of the cubes whose first point is in @a among.
void addDipoles(const SortedPoints& points, int level, const SortedPoints::Range& among,
                std::vector<Dipole>& dipoles)
{
    const PointArrays& p = points.points();
    points.forEachCell(level, among, [&](std::size_t begin, std::size_t end) {
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

std::vector<Dipole> makeDipoles(const SortedPoints& points, int level)
{
    constexpr std::size_t kChunk = 1 << 14; ///< points of a task [free: grain]
    std::vector<std::vector<Dipole>> chunks((points.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), chunks.size(), [&](std::size_t c) {
        const std::size_t begin = c * kChunk;
        addDipoles(points, level, {begin, std::min(begin + kChunk, points.size())}, chunks[c]);
    });
    std::vector<Dipole> dipoles;
    for (const auto& chunk : chunks) dipoles.insert(dipoles.end(), chunk.begin(), chunk.end());
    return dipoles;
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

NodeData splat(const std::vector<Dipole>& dipoles, const NodeGrid& grid, const Vec3d& corner,
               double step, double noise, bool withNormals, Interrupter& progress)
{
    const Bins bins = binDipoles(dipoles, grid, corner, step);
    NodeData data(grid, withNormals);
    tbb::enumerable_thread_specific<PlaneSums> scratch(
        [&] { return PlaneSums(grid, corner, step, noise); });
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
            if (!withNormals) return;
            const Vec3f normal = sums.normal.normalized().cast<float>();
            for (int c = 0; c < 3; ++c) data.normal[std::size_t(c)][n] = normal[c];
        });
    });
    return data;
}

/// Coordinates of dipoles, one array each.
struct Places {
    std::vector<float> x, y, z;

    explicit Places(const std::vector<Dipole>& dipoles)
    {
        for (const Dipole& d : dipoles) {
            x.push_back(d.position[0]);
            y.push_back(d.position[1]);
            z.push_back(d.position[2]);
        }
    }
};

MPUVDB_WIDE_CLONES
float nearestSquared(const Places& places, float x, float y, float z)
{
    using Lanes = float __attribute__((vector_size(32)));
    constexpr std::size_t kLanes = 8; ///< lanes of a vector [derived: floats of 256 bits]
    float least[kLanes];
    std::fill_n(least, kLanes, std::numeric_limits<float>::max());
    const std::size_t whole = places.x.size() / kLanes * kLanes;
    Lanes nearest;
    std::memcpy(&nearest, least, sizeof nearest);
    for (std::size_t n = 0; n < whole; n += kLanes) {
        Lanes dx, dy, dz;
        std::memcpy(&dx, &places.x[n], sizeof dx);
        std::memcpy(&dy, &places.y[n], sizeof dy);
        std::memcpy(&dz, &places.z[n], sizeof dz);
        dx -= x, dy -= y, dz -= z;
        const Lanes d2 = dx * dx + dy * dy + dz * dz;
        nearest = d2 < nearest ? d2 : nearest;
    }
    std::memcpy(least, &nearest, sizeof least);
    for (std::size_t n = whole; n < places.x.size(); ++n) {
        const float dx = places.x[n] - x, dy = places.y[n] - y, dz = places.z[n] - z;
        least[0] = std::min(least[0], dx * dx + dy * dy + dz * dz);
    }
    return *std::min_element(least, least + kLanes);
}

/// Distance from the nodes of the box to the nearest dipole, node steps; 0 at the other nodes.
std::vector<float> borderDistance(const std::vector<Dipole>& dipoles, const NodeGrid& grid,
                                  const Vec3d& corner, double step, Interrupter& progress)
{
    const Places places(dipoles);
    std::vector<float> distance(grid.size(), 0.0f);
    tbb::parallel_for(0, grid.n[0], [&](int i) {
        progress.check();
        for (int j = 0; j < grid.n[1]; ++j) {
            for (int k = 0; k < grid.n[2]; k += grid.borderStep(i, j)) {
                const Vec3f at = (corner + step * Vec3d(i, j, k)).cast<float>();
                distance[grid.index(i, j, k)] =
                    std::sqrt(nearestSquared(places, at[0], at[1], at[2])) / float(step);
            }
        }
    });
    return distance;
}

/// First level with cubes no larger than @a size.
int levelOf(const RootCube& root, double size)
{
    int level = 0;
    while (level < SortedPoints::kMaxLevel && root.size(level) > size) ++level;
    return level;
}

/// Nodes, @a step apart, in a box around the points.
struct NodeBox {
    double extent, step;
    NodeGrid grid;

    NodeBox(const Box3d& bounds, double spacing)
        : extent(std::max(bounds.sizes().maxCoeff(), 4 * spacing)),
          step(std::max(extent * (1 + 2 * kPadding) / kMaxNodes, 3 * spacing))
    {
        for (int k = 0; k < 3; ++k) {
            const double side = bounds.sizes()[k] + 2 * kPadding * extent;
            grid.n[std::size_t(k)] = 16 * std::max(1, int(std::ceil(side / step / 16))) + 1;
        }
    }
};

// Arithmetic for one place (double) and for a group of four alike.

template <typename T>
[[gnu::always_inline]] inline T larger(const T& a, const T& b)
{
    return a > b ? a : b;
}

template <typename T>
[[gnu::always_inline]] inline T smaller(const T& a, const T& b)
{
    return a < b ? a : b;
}

[[gnu::always_inline]] inline double squareRoot(double x)
{
    return std::sqrt(x);
}

[[gnu::always_inline]] inline double lane(double x, std::size_t)
{
    return x;
}

[[gnu::always_inline]] inline double lane(const Group& x, std::size_t n)
{
    return x[n];
}

[[gnu::always_inline]] inline void setLane(double& x, std::size_t, double to)
{
    x = to;
}

[[gnu::always_inline]] inline void setLane(Group& x, std::size_t n, double to)
{
    x[n] = to;
}

} // namespace

std::uint64_t CoarseSign::makingPeakBytes(const SortedPoints& some, const Box3d& bounds,
                                          const RootCube& root)
{
    /// Bytes of a node: data, right-hand side, border, solver. [tuned: estimate_test]
    constexpr std::uint64_t kNodeBytes = 32;
    return kNodeBytes * NodeBox(bounds, meanSpacing(some, root)).grid.size();
}

CoarseSign::CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root,
                       double noise, Interrupter& progress)
{
    const NodeBox box(bounds, meanSpacing(points, root));
    mStep = box.step;
    mGrid = box.grid;
    for (int k = 0; k < 3; ++k)
        mCorner[k] = bounds.center()[k] - mStep * (mGrid.n[std::size_t(k)] - 1) / 2;
    mSlopeFloor = 0.45 / (box.extent / mStep);
    const auto dipoles = [&](double steps) {
        return makeDipoles(points, levelOf(root, steps * mStep));
    };
    const auto dataAt = [&](const NodeGrid& grid, int steps, bool withNormals) {
        return splat(dipoles(steps * kDipoleSize), grid, mCorner, steps * mStep, noise, withNormals,
                     progress);
    };
    // Curvature is smooth: half as many nodes along each axis do.
    const NodeGrid half = halved(mGrid);
    const std::vector<float> curvature = spreadCurvature(half, dataAt(half, 2, true), progress);
    mU = fillBetween(mGrid, dataAt(mGrid, 1, false), curvature,
                     borderDistance(dipoles(kBorderDipoleSize), mGrid, mCorner, mStep, progress),
                     progress);
}

CoarseSign::CoarseSign(const ArrayFile& file)
    : mCorner(file.value<Vec3d>("coarse corner")), mStep(file.value<double>("coarse step")),
      mSlopeFloor(file.value<double>("coarse slope floor")),
      mGrid(file.value<NodeGrid>("coarse grid"))
{
    const auto values = file.get<float>("coarse values");
    if (values.size() != mGrid.size()) throw InputError("the coarse field is damaged");
    mU.assign(values.begin(), values.end());
}

void CoarseSign::save(ArrayFileWriter& file) const
{
    file.addValue("coarse corner", mCorner);
    file.addValue("coarse step", mStep);
    file.addValue("coarse slope floor", mSlopeFloor);
    file.addValue("coarse grid", mGrid);
    file.add("coarse values", mU);
}

Box3d CoarseSign::bounds() const
{
    const Vec3d first = mCorner + Vec3d::Constant(mStep);
    return {first, first + mStep * Vec3d(mGrid.n[0] - 3, mGrid.n[1] - 3, mGrid.n[2] - 3)};
}

/// A sample at one place (double), or at a group of four.
template <typename T>
struct CoarseSign::Sample {
    T value, slope;
    std::array<T, 3> gradient;
};

template <typename T>
[[gnu::always_inline]] inline CoarseSign::Sample<T>
CoarseSign::sample(const std::array<T, 3>& p) const
{
    // Quadratic B-splines: value and gradient are smooth across the nodes' cells.
    constexpr std::size_t kLanes = std::is_same_v<T, Group> ? 4 : 1; ///< lanes [derived: of T]
    T w[3][3], dw[3][3], beyond2{};
    int base[kLanes][3];
    for (int k = 0; k < 3; ++k) {
        const int last = mGrid.n[std::size_t(k)] - 2;
        const T at = (p[std::size_t(k)] - mCorner[k]) / mStep;
        const T t = smaller(larger(at, T{} + 1.0), T{} + double(last));
        beyond2 += (at - t) * (at - t);
        T node{};
        for (std::size_t n = 0; n < kLanes; ++n) {
            const double up = lane(t, n) + 0.5;
            const int nearest = int(up); // as it is positive
            base[n][k] = nearest - 1;
            setLane(node, n, nearest);
        }
        const T f = t - node;
        w[k][0] = 0.5 * (0.5 - f) * (0.5 - f);
        w[k][1] = 0.75 - f * f;
        w[k][2] = 0.5 * (0.5 + f) * (0.5 + f);
        dw[k][0] = f - 0.5;
        dw[k][1] = -2 * f;
        dw[k][2] = f + 0.5;
    }
    Sample<T> s{};
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            T row[3] = {};
            for (std::size_t n = 0; n < kLanes; ++n) {
                const float* const nodes =
                    &mU[mGrid.index(base[n][0] + i, base[n][1] + j, base[n][2])];
                for (int k = 0; k < 3; ++k) setLane(row[k], n, nodes[k]);
            }
            const T v = w[2][0] * row[0] + w[2][1] * row[1] + w[2][2] * row[2];
            const T dv = dw[2][0] * row[0] + dw[2][1] * row[1] + dw[2][2] * row[2];
            s.value += w[0][i] * w[1][j] * v;
            s.gradient[0] += dw[0][i] * w[1][j] * v;
            s.gradient[1] += w[0][i] * dw[1][j] * v;
            s.gradient[2] += w[0][i] * w[1][j] * dv;
        }
    }
    const auto& g = s.gradient;
    s.slope = larger(squareRoot(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]), T{} + mSlopeFloor);
    const T most = T{} + maxDistance();
    s.value = smaller(larger(mStep * s.value / s.slope, -most), most) + mStep * squareRoot(beyond2);
    return s;
}

FieldSample CoarseSign::evaluate(const Vec3d& p) const
{
    const Sample<double> s = sample<double>({p[0], p[1], p[2]});
    FieldSample result;
    result.value = s.value;
    result.gradient = Vec3d(s.gradient[0], s.gradient[1], s.gradient[2]) / s.slope;
    return result;
}

MPUVDB_WIDE_CLONES
void CoarseSign::evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                              std::array<double, 4>& values) const
{
    std::array<Group, 3> p;
    std::memcpy(&p, &places, sizeof p);
    const Sample<Group> s = sample(p);
    std::memcpy(&values, &s.value, sizeof values);
}

} // namespace mpuvdb
