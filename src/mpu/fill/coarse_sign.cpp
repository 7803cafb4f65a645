#include "coarse_sign.h"

#include "coarse_refiner.h"
#include "core/clones.h"
#include "files/array_file.h"
#include "spatial/point_group.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tbb/parallel_for.h>
#include <type_traits>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Padding of the grid on each side, in extents of the points. [tuned: unseen_bench]
constexpr double kPadding = 0.2;
constexpr int kMaxNodes = 96; ///< nodes along the longest side [tuned: unseen_bench, time]
/// Least step, in spacings of the points. [derived: nodes then have several points around]
constexpr double kMinStep = 3;
/// Value on the grid's box, in distances from the points: above 0, so that every surface closes
/// inside. The surface that nobody saw is nearer than the points. [tuned: unseen_bench]
constexpr float kBorderShare = 0.5f;
/// Cycles of the solver: six are as near to what nobody saw. [tuned: unseen_bench]
constexpr int kCycles = 4;
/// Largest cubes of dipoles for distances from the box, node steps. [tuned: unseen_bench, time]
constexpr double kBorderDipoleSize = 9;

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

/// Values for the nodes of the box, node steps; 0 at the other nodes.
std::vector<float> borderValues(const std::vector<Dipole>& dipoles, const Nodes& nodes,
                                Interrupter& progress)
{
    const Places places(dipoles);
    const NodeGrid& grid = nodes.grid;
    std::vector<float> values(grid.size(), 0.0f);
    tbb::parallel_for(0, grid.n[0], [&](int i) {
        progress.check();
        for (int j = 0; j < grid.n[1]; ++j) {
            for (int k = 0; k < grid.n[2]; k += grid.borderStep(i, j)) {
                const Vec3f at = nodes.at(i, j, k).cast<float>();
                const float distance = std::sqrt(nearestSquared(places, at[0], at[1], at[2]));
                values[grid.index(i, j, k)] = kBorderShare * distance / float(nodes.step);
            }
        }
    });
    return values;
}

/// Nodes, @a step apart, in a box around the points.
struct NodeBox {
    double extent, step;
    NodeGrid grid;

    NodeBox(const Box3d& bounds, double spacing)
        : extent(std::max(bounds.sizes().maxCoeff(), 4 * spacing)),
          step(std::max(extent * (1 + 2 * kPadding) / kMaxNodes, kMinStep * spacing))
    {
        for (int k = 0; k < 3; ++k) {
            const double side = bounds.sizes()[k] + 2 * kPadding * extent;
            grid.n[std::size_t(k)] = 16 * std::max(1, int(std::ceil(side / step / 16))) + 1;
        }
    }
    /// The nodes about the middle of @a bounds.
    Nodes nodes(const Box3d& bounds) const
    {
        Nodes result{grid, Vec3d::Zero(), step};
        for (int k = 0; k < 3; ++k)
            result.corner[k] = bounds.center()[k] - step * (grid.n[std::size_t(k)] - 1) / 2;
        return result;
    }
};

/// Least step of all levels: below it nothing is known, or matters.
double leastStep(double spacing, const Unseen& unseen, double noise)
{
    return kMinStep * std::max({spacing, unseen.voxelSize, noise});
}

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
                                          const RootCube& root, const Unseen& unseen, double share)
{
    /// Bytes of a node: data, border, unknowns, residual. [tuned: estimate_test]
    constexpr std::uint64_t kNodeBytes = 36;
    /// Bytes of a block that may be wanted. [derived: of two in five, which are made, the block
    /// itself, its solution, and its data]
    constexpr double kBlockBytes = 2 * sizeof(CoarseBlock);
    const double spacing = DipoleSource(some, root).meanSpacing();
    const NodeBox box(bounds, spacing);
    const CoarseLevels levels(box.nodes(bounds), {});
    const double blocks = share * double(CoarseRefiner::mostBlocks(levels, root, unseen,
                                                                   leastStep(spacing, unseen, 0)));
    return kNodeBytes * box.grid.size() + std::uint64_t(kBlockBytes * blocks);
}

CoarseSign::CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root,
                       double noise, const Unseen& unseen, Interrupter& progress)
{
    const DipoleSource source(points, root);
    const double spacing = source.meanSpacing();
    const NodeBox box(bounds, spacing);
    const Nodes nodes = box.nodes(bounds);
    mSlopeFloor = 0.45 / (box.extent / box.step);
    NodeData data = splat(source.all(dipoleSize(nodes.step)), nodes, noise, progress);
    const std::vector<float> border =
        borderValues(source.all(kBorderDipoleSize * box.step), nodes, progress);
    mLevels = CoarseLevels(nodes, TensionSpline(nodes.grid, std::move(data.weight), progress)
                                      .solve(std::move(data.distance), border, {}, kCycles));
    CoarseRefiner(source, root, noise)
        .refine(
            mLevels, unseen, leastStep(spacing, unseen, noise),
            [this](const Vec3d& p) { return evaluate(p).value; }, progress);
}

CoarseSign::CoarseSign(const ArrayFile& file)
    : mSlopeFloor(file.value<double>("coarse slope floor")), mLevels(file)
{
}

void CoarseSign::save(ArrayFileWriter& file) const
{
    file.addValue("coarse slope floor", mSlopeFloor);
    mLevels.save(file);
}

Box3d CoarseSign::bounds() const
{
    const Nodes& root = mLevels.root();
    const Vec3d first = root.corner + Vec3d::Constant(root.step);
    const auto& n = root.grid.n;
    return {first, first + root.step * Vec3d(n[0] - 3, n[1] - 3, n[2] - 3)};
}

double CoarseSign::stepAt(const Vec3d& p) const
{
    return mLevels.stepAt(mLevels.clamped(mLevels.cellAt(p, 0)));
}

/// A sample at one place (double), or at a group of four.
template <typename T>
struct CoarseSign::Sample {
    T value, slope, step;
    std::array<T, 3> gradient;
};

/// The 27 nodes around a place.
struct CoarseSign::Stencil {
    const float* first;
    std::size_t plane, row; ///< from one node to the next
    double beyond[3];       ///< offset of the place from the middle node, steps
    double step;            ///< between nodes, world units
    double blendedStep;     ///< the same, continuous across levels
};

/// @param t  the place in steps of the root grid, inside it.
CoarseSign::Stencil CoarseSign::stencilAt(const double (&t)[3]) const
{
    Stencil stencil;
    const Vec3d cell(t[0] + 0.5, t[1] + 0.5, t[2] + 0.5);
    int level = 0;
    std::size_t index = 0;
    const CoarseBlock* const block = mLevels.find(cell, level, index);
    if (!block) {
        const NodeGrid& grid = mLevels.root().grid;
        int nearest[3];
        for (int k = 0; k < 3; ++k) {
            nearest[k] = int(cell[k]); // as it is positive
            stencil.beyond[k] = t[k] - nearest[k];
        }
        stencil.first =
            &mLevels.rootValues()[grid.index(nearest[0] - 1, nearest[1] - 1, nearest[2] - 1)];
        stencil.plane = grid.index(1, 0, 0);
        stencil.row = grid.index(0, 1, 0);
        stencil.step = stencil.blendedStep = mLevels.root().step;
        return stencil;
    }
    const Vec3d at = cell * double(1 << level);
    std::size_t first = 0;
    for (int k = 0; k < 3; ++k) {
        const double inside = at[k] - CoarseBlock::kNodes * block->at[k];
        const int nearest = int(inside);
        stencil.beyond[k] = inside - nearest - 0.5;
        first = first * CoarseBlock::kStored + std::size_t(nearest);
    }
    stencil.first = &block->nodes[first];
    stencil.plane = std::size_t(CoarseBlock::kStored) * CoarseBlock::kStored;
    stencil.row = CoarseBlock::kStored;
    stencil.step = mLevels.step(level);
    stencil.blendedStep = block->stepAt(at);
    return stencil;
}

template <typename T>
[[gnu::always_inline]] inline CoarseSign::Sample<T>
CoarseSign::sample(const std::array<T, 3>& p) const
{
    // Quadratic B-splines: value and gradient are smooth across the nodes' cells.
    constexpr std::size_t kLanes = std::is_same_v<T, Group> ? 4 : 1; ///< lanes [derived: of T]
    const Nodes& root = mLevels.root();
    T t[3], beyond2{};
    for (int k = 0; k < 3; ++k) {
        const int last = root.grid.n[std::size_t(k)] - 2;
        const T at = (p[std::size_t(k)] - root.corner[k]) / root.step;
        t[k] = smaller(larger(at, T{} + 1.0), T{} + double(last));
        beyond2 += (at - t[k]) * (at - t[k]);
    }
    Stencil stencils[kLanes];
    Sample<T> s{};
    T step{}, f[3] = {};
    for (std::size_t n = 0; n < kLanes; ++n) {
        stencils[n] = stencilAt({lane(t[0], n), lane(t[1], n), lane(t[2], n)});
        setLane(step, n, stencils[n].step);
        setLane(s.step, n, stencils[n].blendedStep);
        for (int k = 0; k < 3; ++k) setLane(f[k], n, stencils[n].beyond[k]);
    }
    T w[3][3], dw[3][3];
    for (int k = 0; k < 3; ++k) {
        w[k][0] = 0.5 * (0.5 - f[k]) * (0.5 - f[k]);
        w[k][1] = 0.75 - f[k] * f[k];
        w[k][2] = 0.5 * (0.5 + f[k]) * (0.5 + f[k]);
        dw[k][0] = f[k] - 0.5;
        dw[k][1] = -2 * f[k];
        dw[k][2] = f[k] + 0.5;
    }
    for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
            T row[3] = {};
            for (std::size_t n = 0; n < kLanes; ++n) {
                const Stencil& stencil = stencils[n];
                const float* const nodes = stencil.first + i * stencil.plane + j * stencil.row;
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
    const T most = CoarseSample::maxDistance(1) * s.step;
    s.value =
        smaller(larger(step * s.value / s.slope, -most), most) + root.step * squareRoot(beyond2);
    return s;
}

CoarseSample CoarseSign::evaluate(const Vec3d& p) const
{
    const Sample<double> s = sample<double>({p[0], p[1], p[2]});
    CoarseSample result;
    result.value = s.value;
    result.gradient = Vec3d(s.gradient[0], s.gradient[1], s.gradient[2]) / s.slope;
    result.step = s.step;
    return result;
}

MPUVDB_WIDE_CLONES
void CoarseSign::evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                              std::array<double, 4>& values, std::array<double, 4>& steps) const
{
    std::array<Group, 3> p;
    std::memcpy(&p, &places, sizeof p);
    const Sample<Group> s = sample(p);
    std::memcpy(&values, &s.value, sizeof values);
    std::memcpy(&steps, &s.step, sizeof steps);
}

} // namespace mpuvdb
