#include "coarse_refiner.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tuple>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Solutions of a block: the first takes the values around it from the level above, the next those
/// of its neighbors' solutions before. [derived: one of each]
constexpr int kPasses = 2;
constexpr int kNodes = CoarseBlock::kNodes, kHalo = CoarseBlock::kHalo,
              kFade = CoarseBlock::kFade; ///< nodes [derived: as there]
/// Nodes along an edge of the grid that is solved for a block. [derived: the block and its halo]
constexpr int kSolved = kNodes + 2 * kHalo + 1;
/// Distance from points at which the field above passes them that makes a block, steps of the
/// block. [derived: the difference of a leaf and the field from which the leaf fades]
constexpr double kMissed = 0.5;
/// Nodes along an edge of those that are kept. [derived: the block and the fades around]
constexpr int kKept = kNodes + 2 * kFade;
/// Cycles of the solver. [tuned: unseen_bench pieces; one and three differ by less than 4 %]
constexpr int kBlockCycles = 2;

struct ByPlace {
    bool operator()(const Vec3i& a, const Vec3i& b) const
    {
        return std::tie(a[0], a[1], a[2]) < std::tie(b[0], b[1], b[2]);
    }
};

/// Places of the blocks of @a level that unseen cubes small beside a block reach into, sorted.
/// @param isAsked  whether the cube with this center and edge counts.
template <typename F>
std::vector<Vec3i> blocksNear(const CoarseLevels& levels, const RootCube& cube,
                              const Unseen& unseen, int level, const F& isAsked)
{
    const double step = levels.step(level);
    std::vector<Vec3i> places;
    Vec3i lastFirst = Vec3i::Zero(), lastEnd = Vec3i::Zero();
    for (const OctreeCell& cell : unseen.cells) {
        const double size = cube.size(cell.level);
        if (size > kHalo * step) continue;
        // Where a block does not fade into the levels above.
        const Vec3d reach = Vec3d::Constant(size / 2 + kFade * step), center = cube.center(cell);
        const auto blockAt = [&](const Vec3d& p) -> Vec3i {
            return (levels.cellAt(p, level) / kNodes).array().floor().matrix().cast<int>();
        };
        const Vec3i first = blockAt(center - reach), end = blockAt(center + reach) + Vec3i::Ones();
        if ((first == lastFirst && end == lastEnd) || !isAsked(center, size)) continue;
        lastFirst = first, lastEnd = end; // the next cubes are close to this one
        for (int i = first[0]; i < end[0]; ++i)
            for (int j = first[1]; j < end[1]; ++j)
                for (int k = first[2]; k < end[2]; ++k) places.emplace_back(i, j, k);
    }
    std::sort(places.begin(), places.end(), ByPlace());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    return places;
}

/// Places of the blocks of @a level that are to be made: where the field so far, @a coarse, may
/// close what nobody saw, and there is a parent.
std::vector<Vec3i> wantedBlocks(const CoarseLevels& levels, const RootCube& cube,
                                const Unseen& unseen, int level, const CoarseRefiner::Value& coarse)
{
    // Farther than a step above from that field's surface nothing is decided.
    const double above = levels.step(level - 1);
    const auto isNear = [&](const Vec3d& center, double size) {
        return std::abs(coarse(center)) <= above + size / 2;
    };
    std::vector<Vec3i> places = blocksNear(levels, cube, unseen, level, isNear);
    const auto isOrphan = [&](const Vec3i& at) {
        if (level == 1) return !levels.holds(at);
        return !levels.has(Vec3i(at[0] >> 1, at[1] >> 1, at[2] >> 1), level - 1);
    };
    places.erase(std::remove_if(places.begin(), places.end(), isOrphan), places.end());
    return places;
}

/// The @a count values along each axis, nearest to the first corner, that lie about the block in
/// the middle of @a grid, which has one node more on its far sides.
std::vector<float> middleOf(const std::vector<float>& values, const NodeGrid& grid, int count)
{
    const int first = (grid.n[0] - 1 - count) / 2;
    std::vector<float> middle;
    for (int i = first; i < first + count; ++i)
        for (int j = first; j < first + count; ++j) {
            const float* const row = &values[grid.index(i, j, first)];
            middle.insert(middle.end(), row, row + count);
        }
    return middle;
}

/// Laplacian, per square of a step, of values at the nodes of a grid's box: that of the nearest
/// interior node.
std::vector<float> bendOnBox(const NodeGrid& grid, const std::vector<float>& values)
{
    const std::size_t plane = grid.index(1, 0, 0), row = grid.index(0, 1, 0);
    std::vector<float> bend(grid.size(), 0.0f);
    const auto inside = [&](int n, std::size_t axis) { return std::clamp(n, 1, grid.n[axis] - 2); };
    for (int i = 0; i < grid.n[0]; ++i)
        for (int j = 0; j < grid.n[1]; ++j)
            for (int k = 0; k < grid.n[2]; k += grid.borderStep(i, j)) {
                const float* const at =
                    &values[grid.index(inside(i, 0), inside(j, 1), inside(k, 2))];
                bend[grid.index(i, j, k)] = (at[plane] + *(at - plane)) + (at[row] + *(at - row)) +
                                            (at[1] + at[-1]) - 6 * *at;
            }
    return bend;
}

double smoothRise(double t)
{
    const double x = std::clamp(t, 0.0, 1.0);
    return x * x * (3 - 2 * x);
}

} // namespace

/// Data of a grid, of the nodes that have any.
struct CoarseRefiner::SparseData {
    std::vector<std::uint32_t> nodes;
    std::vector<float> values; ///< weight and distance of each

    SparseData() = default;
    explicit SparseData(const NodeData& data)
    {
        for (std::size_t n = 0; n < data.weight.size(); ++n) {
            if (!(data.weight[n] > 0)) continue;
            nodes.push_back(std::uint32_t(n));
            values.push_back(data.weight[n]);
            values.push_back(data.distance[n]);
        }
    }

    NodeData on(const NodeGrid& grid) const
    {
        NodeData data(grid);
        const float* value = values.data();
        for (const std::uint32_t n : nodes) {
            data.weight[n] = *value++;
            data.distance[n] = *value++;
        }
        return data;
    }
};

/// A block that is made.
struct CoarseRefiner::Part {
    Vec3i at;
    SparseData data;
    std::vector<float> u; ///< its solution: kKept nodes along each axis
};

Nodes CoarseRefiner::nodesAbout(const CoarseLevels& levels, const Vec3i& at, int level)
{
    return {{{kSolved, kSolved, kSolved}},
            levels.nodeAt(kNodes * at - Vec3i::Constant(kHalo), level),
            levels.step(level)};
}

void CoarseRefiner::gather(const CoarseLevels& levels, Part& part, int level,
                           Interrupter& progress) const
{
    const Nodes nodes = nodesAbout(levels, part.at, level);
    part.data =
        SparseData(splat(mSource.near(nodes, dipoleSize(nodes.step)), nodes, mNoise, progress));
}

bool CoarseRefiner::isMissed(const CoarseLevels& levels, const Vec3i& at, int level,
                             const Value& coarse) const
{
    const double step = levels.step(level);
    const Vec3i reach = Vec3i::Constant(kFade);
    const Box3d box(levels.nodeAt(kNodes * at - reach, level),
                    levels.nodeAt(kNodes * (at + Vec3i::Ones()) + reach, level));
    return mSource.isAny(box, step,
                         [&](const Vec3d& p) { return std::abs(coarse(p)) > kMissed * step; });
}

void CoarseRefiner::solve(const CoarseLevels& levels, Part& part, int level,
                          Interrupter& progress) const
{
    const Vec3i low = kNodes * part.at - Vec3i::Constant(kHalo);
    const NodeGrid grid = nodesAbout(levels, part.at, level).grid;
    const std::vector<float> above = levels.coefficients(low, kSolved, level);
    NodeData data = part.data.on(grid);
    const std::vector<float> u =
        TensionSpline(grid, std::move(data.weight), progress)
            .solve(std::move(data.distance), above, bendOnBox(grid, above), kBlockCycles);
    part.u = middleOf(u, grid, kKept);
}

namespace
{

/// A block of a level beside another, or that one itself.
struct Neighbor {
    Vec3i offset;                ///< blocks
    const std::vector<float>* u; ///< its kept values; null where there is none
};
using Neighborhood = std::array<Neighbor, 27>;

/// Share of the block at @a offset in the value of node @a n of another, along one axis: half at
/// the border between them.
double shareOf(int offset, int n)
{
    const double x = n + 0.5, before = 1 - smoothRise((x + kFade) / (2 * kFade)),
                 behind = smoothRise((x - kNodes + kFade) / (2 * kFade));
    return offset < 0 ? before : offset > 0 ? behind : 1 - before - behind;
}

/// The values of the blocks around at the stored nodes of the middle one, where they fade into each
/// other.
std::vector<double> meanOf(const Neighborhood& around)
{
    constexpr int kStored = CoarseBlock::kStored; ///< nodes [derived: as there]
    std::vector<double> sum(cubeIndex(kStored, 0, 0, kStored)), weight(sum.size());
    for (const Neighbor& neighbor : around) {
        if (!neighbor.u) continue;
        // The nodes of the middle block that this one's kept values reach.
        int first[3], end[3];
        double share[3][kStored];
        for (int axis = 0; axis < 3; ++axis) {
            const int side = neighbor.offset[axis];
            first[axis] = side > 0 ? kNodes - kFade + 1 : 0;
            end[axis] = side < 0 ? kFade + 1 : kStored;
            for (int n = 0; n < kStored; ++n) share[axis][n] = shareOf(side, n - 1);
        }
        const Vec3i shift = Vec3i::Constant(kFade - 1) - kNodes * neighbor.offset;
        for (int i = first[0]; i < end[0]; ++i)
            for (int j = first[1]; j < end[1]; ++j) {
                const double row = share[0][i] * share[1][j];
                const float* const from =
                    neighbor.u->data() +
                    cubeIndex(i + shift[0], j + shift[1], shift[2] + first[2], kKept);
                const std::size_t to = cubeIndex(i, j, 0, kStored);
                for (int k = first[2]; k < end[2]; ++k) {
                    const double w = row * share[2][k];
                    sum[to + std::size_t(k)] += w * double(from[k - first[2]]);
                    weight[to + std::size_t(k)] += w;
                }
            }
    }
    for (std::size_t n = 0; n < sum.size(); ++n) sum[n] = weight[n] > 0 ? sum[n] / weight[n] : 0;
    return sum;
}

/// Distance of @a x, nodes from the middle block's corner, from the missing blocks around, at most
/// kFade.
double distanceFromMissing(const Neighborhood& around, const Vec3d& x)
{
    double least = kFade;
    for (const Neighbor& neighbor : around) {
        if (neighbor.u) continue;
        double distance = -kNodes;
        for (int axis = 0; axis < 3; ++axis) {
            const int side = neighbor.offset[axis];
            if (side != 0) distance = std::max(distance, side < 0 ? x[axis] : kNodes - x[axis]);
        }
        least = std::min(least, distance);
    }
    return least;
}

/// The blocks around @a at. @param parts  those of the level, sorted by place.
template <typename Part>
Neighborhood neighborhood(const std::vector<Part>& parts, const Vec3i& at)
{
    Neighborhood around;
    for (int n = 0; n < 27; ++n) {
        const Vec3i offset(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1), there = at + offset;
        const auto found = std::lower_bound(
            parts.begin(), parts.end(), there,
            [](const Part& part, const Vec3i& place) { return ByPlace()(part.at, place); });
        const bool exists = found != parts.end() && found->at == there;
        around[std::size_t(n)] = {offset, exists ? &found->u : nullptr};
    }
    return around;
}

/// The block @a at of a @a level, from the solutions about it and its neighbors. Towards missing
/// ones it fades into the levels above.
CoarseBlock blended(const CoarseLevels& levels, const Vec3i& at, int level,
                    const Neighborhood& around)
{
    constexpr int kStored = CoarseBlock::kStored,
                  kSteps = CoarseBlock::kSteps; ///< nodes and places [derived: as there]
    CoarseBlock block;
    block.at = at;
    const std::vector<double> mean = meanOf(around);
    const std::vector<float> above =
        levels.coefficients(kNodes * at - Vec3i::Ones(), kStored, level);
    std::size_t n = 0;
    for (int i = 0; i < kStored; ++i)
        for (int j = 0; j < kStored; ++j)
            for (int k = 0; k < kStored; ++k, ++n) {
                const double distance =
                    distanceFromMissing(around, Vec3d(i - 0.5, j - 0.5, k - 0.5));
                // The nodes on both sides of a rim are its value and gradient: those of above.
                const double share = smoothRise((distance - 0.5) / (kFade - 0.5));
                block.nodes[n] = float(share * mean[n] + (1 - share) * double(above[n]));
            }
    n = 0;
    for (int i = 0; i < kSteps; ++i)
        for (int j = 0; j < kSteps; ++j)
            for (int k = 0; k < kSteps; ++k, ++n) {
                const Vec3d x = kFade * Vec3d(i, j, k);
                const Vec3d cell = ((kNodes * at).cast<double>() + x) / double(1 << level);
                const bool isAtRim = !(distanceFromMissing(around, x) > 0);
                block.steps[n] = float(isAtRim ? levels.stepAt(cell) : levels.step(level));
            }
    return block;
}

} // namespace

template <typename F>
void CoarseRefiner::forEachPart(std::vector<Part>& parts, Interrupter& progress, const F& f)
{
    tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t n) {
        progress.check();
        // The loops inside are too short to share.
        tbb::task_arena(1).execute([&] { f(parts[n]); });
    });
}

std::size_t CoarseRefiner::mostBlocks(const CoarseLevels& levels, const RootCube& cube,
                                      const Unseen& unseen, double least)
{
    std::size_t count = 0;
    for (int level = 1; levels.step(level) >= least; ++level)
        count += blocksNear(levels, cube, unseen, level, [](const Vec3d&, double) {
                     return true;
                 }).size();
    return count;
}

void CoarseRefiner::refine(CoarseLevels& levels, const Unseen& unseen, double least,
                           const Value& coarse, Interrupter& progress)
{
    for (int level = 1; levels.step(level) >= least; ++level) {
        const std::vector<Vec3i> wanted = wantedBlocks(levels, mCube, unseen, level, coarse);
        std::vector<std::uint8_t> isMade(wanted.size());
        tbb::parallel_for(std::size_t(0), wanted.size(), [&](std::size_t n) {
            progress.check();
            isMade[n] = isMissed(levels, wanted[n], level, coarse);
        });
        std::vector<Part> parts;
        for (std::size_t n = 0; n < wanted.size(); ++n) {
            if (!isMade[n]) continue;
            parts.emplace_back();
            parts.back().at = wanted[n];
        }
        forEachPart(parts, progress, [&](Part& part) { gather(levels, part, level, progress); });
        const auto isEmpty = [](const Part& part) { return part.data.nodes.empty(); };
        parts.erase(std::remove_if(parts.begin(), parts.end(), isEmpty), parts.end());
        if (parts.empty()) return;
        for (int pass = 0; pass < kPasses; ++pass) {
            forEachPart(parts, progress, [&](Part& part) { solve(levels, part, level, progress); });
            if (pass > 0) levels.removeLast();
            std::vector<CoarseBlock> blocks(parts.size());
            tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t n) {
                blocks[n] = blended(levels, parts[n].at, level, neighborhood(parts, parts[n].at));
            });
            levels.add(std::move(blocks));
        }
    }
}

} // namespace mpuvdb
