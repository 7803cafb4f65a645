#include "coarse_sign.h"

#include "coarse_fill.h"
#include "point_group.h"

#include <mpuvdb/clones.h>
#include <mpuvdb/progress.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tbb/parallel_for.h>
#include <type_traits>

namespace mpuvdb
{
namespace
{

constexpr double kPad = 0.2;    ///< of the extent, on each side
constexpr int kMaxNodes = 64;   ///< along the longest side
constexpr double kKernel = 1.5; ///< radius of the splats, node steps
constexpr float kWeight = 8;    ///< of data at a node, against the equation between them
/// Steps across the cubes whose points stand for all where only distances to the box are asked.
constexpr double kFewSteps = 6;

/// Points of one small cube as one: mean position, sum of normals.
struct Dipole {
    Vec3f position, normal;
    float weight;
};

/// Mean distance between points: the area of the occupied cells of a level that holds a few points
/// per cell (a plane meets a cube in 2/3 of its face on average), shared among the points.
double meanSpacing(const SortedPoints& points, const RootCube& root)
{
    int level = 1;
    while (level < SortedPoints::kMaxLevel && std::ldexp(8.0, 2 * level) < double(points.size()))
        ++level;
    std::size_t occupied = 0;
    points.forEachCell(level, [&](std::size_t, std::size_t) { ++occupied; });
    return root.size(level) * std::sqrt(double(occupied) / (1.5 * double(points.size())));
}

std::vector<Dipole> makeDipoles(const SortedPoints& points, int level)
{
    std::vector<Dipole> dipoles;
    const PointBatch& p = points.points();
    points.forEachCell(level, [&](std::size_t begin, std::size_t end) {
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
    return dipoles;
}

/// Dipoles by the cell of the node grid they lie in.
struct Bins {
    NodeGrid cells;
    std::vector<std::uint32_t> start, member;
};

Bins binDipoles(const std::vector<Dipole>& dipoles, const NodeGrid& nodes, const Vec3d& corner,
                double step)
{
    Bins bins;
    bins.cells.n = {nodes.n[0] - 1, nodes.n[1] - 1, nodes.n[2] - 1};
    bins.start.assign(bins.cells.size() + 1, 0);
    const auto cellOf = [&](const Dipole& d) {
        const Vec3d c = (d.position.cast<double>() - corner) / step;
        int at[3];
        for (int k = 0; k < 3; ++k)
            at[k] = std::clamp(int(std::floor(c[k])), 0, bins.cells.n[std::size_t(k)] - 1);
        return bins.cells.index(at[0], at[1], at[2]);
    };
    for (const Dipole& d : dipoles) ++bins.start[cellOf(d) + 1];
    for (std::size_t n = 1; n < bins.start.size(); ++n) bins.start[n] += bins.start[n - 1];
    bins.member.resize(dipoles.size());
    std::vector<std::uint32_t> next(bins.start.begin(), bins.start.end() - 1);
    for (std::uint32_t d = 0; d < dipoles.size(); ++d) bins.member[next[cellOf(dipoles[d])]++] = d;
    return bins;
}

/// Nodes that some dipole's kernel may reach.
std::vector<char> nodesNear(const Bins& bins, const NodeGrid& nodes)
{
    std::vector<char> near(nodes.size(), 0);
    const auto& n = bins.cells.n;
    for (int i = 0; i < n[0]; ++i)
        for (int j = 0; j < n[1]; ++j)
            for (int k = 0; k < n[2]; ++k) {
                const std::size_t cell = bins.cells.index(i, j, k);
                if (bins.start[cell] == bins.start[cell + 1]) continue;
                for (int di = std::max(i - 1, 0); di <= std::min(i + 2, n[0]); ++di)
                    for (int dj = std::max(j - 1, 0); dj <= std::min(j + 2, n[1]); ++dj)
                        for (int dk = std::max(k - 1, 0); dk <= std::min(k + 2, n[2]); ++dk)
                            near[nodes.index(di, dj, dk)] = 1;
            }
    return near;
}

/// What the dipoles around a node say of it.
struct NodeSums {
    double weight = 0, value = 0, magnitude = 0;
    Vec3d offset = Vec3d::Zero(), normal = Vec3d::Zero();

    void add(const Dipole& d, const Vec3d& at, double step)
    {
        const Vec3d r = at - d.position.cast<double>();
        const double d2 = r.squaredNorm() / (step * step), cut = 1 - d2 / (kKernel * kKernel);
        if (cut <= 0) return;
        const double w = cut * cut / ((d2 + 0.1) * (d2 + 0.1));
        const Vec3d n = d.normal.cast<double>();
        const double side = n.dot(r);
        weight += w * d.weight;
        value += w * side;
        magnitude += w * std::abs(side);
        offset += w * d.weight * r;
        normal += w * n;
    }
    /// Data lie below or above the node, not beside it, and agree about the side.
    bool supported(double step) const
    {
        if (!(weight > 0)) return false;
        const Vec3d mean = offset / weight;
        const Vec3d direction = normal.normalized();
        const double lateral = (mean - mean.dot(direction) * direction).norm();
        return lateral <= 0.35 * step &&
               (normal.norm() >= 0.7 * weight || std::abs(value) >= 0.5 * magnitude);
    }
};

NodeData splat(const std::vector<Dipole>& dipoles, const NodeGrid& grid, const Vec3d& corner,
               double step, Progress& progress)
{
    const Bins bins = binDipoles(dipoles, grid, corner, step);
    const std::vector<char> near = nodesNear(bins, grid);
    NodeData data(grid);
    tbb::parallel_for(1, grid.n[0] - 1, [&](int i) {
        progress.check();
        for (int j = 1; j < grid.n[1] - 1; ++j) {
            for (int k = 1; k < grid.n[2] - 1; ++k) {
                if (!near[grid.index(i, j, k)]) continue;
                NodeSums sums;
                const Vec3d at = corner + step * Vec3d(i, j, k);
                for (int ci = std::max(i - 2, 0); ci <= std::min(i + 1, bins.cells.n[0] - 1); ++ci)
                    for (int cj = std::max(j - 2, 0); cj <= std::min(j + 1, bins.cells.n[1] - 1);
                         ++cj) {
                        const int k0 = std::max(k - 2, 0),
                                  k1 = std::min(k + 1, bins.cells.n[2] - 1);
                        const std::uint32_t begin = bins.start[bins.cells.index(ci, cj, k0)],
                                            end = bins.start[bins.cells.index(ci, cj, k1) + 1];
                        for (std::uint32_t m = begin; m < end; ++m)
                            sums.add(dipoles[bins.member[m]], at, step);
                    }
                if (!sums.supported(step)) continue;
                const std::size_t n = grid.index(i, j, k);
                data.weight[n] = kWeight;
                data.distance[n] = float(sums.value / sums.weight / step);
                const Vec3f normal = sums.normal.normalized().cast<float>();
                for (int c = 0; c < 3; ++c) data.normal[std::size_t(c)][n] = normal[c];
            }
        }
    });
    return data;
}

/// Coordinates of dipoles, one array each, for loops over them all.
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

MPUVDB_CLONES
float nearestSquared(const Places& places, float x, float y, float z)
{
    using Lanes = float __attribute__((vector_size(32)));
    constexpr std::size_t kLanes = 8;
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
                                  const Vec3d& corner, double step, Progress& progress)
{
    const Places places(dipoles);
    std::vector<float> distance(grid.size(), 0.0f);
    tbb::parallel_for(0, grid.n[0], [&](int i) {
        progress.check();
        for (int j = 0; j < grid.n[1]; ++j) {
            for (int k = 0; k < grid.n[2]; ++k) {
                if (!grid.onBorder(i, j, k)) continue;
                const Vec3f at = (corner + step * Vec3d(i, j, k)).cast<float>();
                distance[grid.index(i, j, k)] =
                    std::sqrt(nearestSquared(places, at[0], at[1], at[2])) / float(step);
            }
        }
    });
    return distance;
}

/// Level of the first cubes that are no larger than @a size.
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
          step(std::max(extent * (1 + 2 * kPad) / kMaxNodes, 3 * spacing))
    {
        for (int k = 0; k < 3; ++k) {
            const double side = bounds.sizes()[k] + 2 * kPad * extent;
            grid.n[std::size_t(k)] = 16 * std::max(1, int(std::ceil(side / step / 16))) + 1;
        }
    }
};

// The same arithmetic for one place and for a group of them.

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

std::uint64_t CoarseSign::makingBytes(const SortedPoints& some, const Box3d& bounds,
                                      const RootCube& root)
{
    constexpr std::uint64_t kNodeBytes = 64; // data, spread normals, right-hand sides, the solver
    return kNodeBytes * NodeBox(bounds, meanSpacing(some, root)).grid.size();
}

CoarseSign::CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root,
                       Progress& progress)
{
    const NodeBox box(bounds, meanSpacing(points, root));
    mStep = box.step;
    mGrid = box.grid;
    for (int k = 0; k < 3; ++k)
        mCorner[k] = bounds.center()[k] - mStep * (mGrid.n[std::size_t(k)] - 1) / 2;
    mSlopeFloor = 0.45 / (box.extent / mStep);
    const std::vector<Dipole> dipoles = makeDipoles(points, levelOf(root, 0.4 * mStep)),
                              few = makeDipoles(points, levelOf(root, kFewSteps * mStep));
    mU = fillBetween(mGrid, splat(dipoles, mGrid, mCorner, mStep, progress),
                     borderDistance(few, mGrid, mCorner, mStep, progress), progress);
}

/// Of one place (a double), or of a group.
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
    constexpr std::size_t kLanes = std::is_same_v<T, Group> ? 4 : 1;
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
    const T most = T{} + farthest();
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

MPUVDB_CLONES
void CoarseSign::evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                              std::array<double, 4>& values) const
{
    std::array<Group, 3> p;
    std::memcpy(&p, &places, sizeof p);
    const Sample<Group> s = sample(p);
    std::memcpy(&values, &s.value, sizeof values);
}

} // namespace mpuvdb
