// What a level set promises, looked at voxel by voxel, and what is wrong with it in words.
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>

#include "leaf_check.h"
#include "transform_lattice.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Tree = openvdb::FloatTree;

/// A half float has 11 significant bits, all others are exact but for a rounding or two.
constexpr double kHalfTolerance = 1.0 / 1024, kFloatTolerance = 1e-5;
/// A distance changes by at most one voxel from voxel to voxel; beyond two, it is none.
constexpr double kLargestStep = 2;
/// What a mean ||grad| - 1| over n voxels may be off, times sqrt(n): 0.18 for eight, 0.005 for ten
/// thousand. The few voxels that a region has of a band that grazes it may all be at a crease.
constexpr double kMeanUncertainty = 0.5;
/// How much farther than its neighbor's distance allows a voxel may be before it is missed.
constexpr double kBandMargin = 0.5;

CheckLimits limitsOf(const openvdb::FloatGrid& grid, double voxelSize, double gradientTolerance)
{
    CheckLimits limits;
    limits.background = grid.background();
    limits.tolerance =
        float(limits.background * (grid.saveFloatAsHalf() ? kHalfTolerance : kFloatTolerance));
    limits.step = float(kLargestStep * voxelSize);
    limits.twiceVoxel = float(2 * voxelSize);
    for (int n = 0; n < 3; ++n)
        limits.near[n] = float(limits.background - (std::sqrt(n + 1.0) + kBandMargin) * voxelSize);
    limits.steepness = float(gradientTolerance);
    return limits;
}

/// Judge a tile: inactive, of background's magnitude, of the same sign as what it touches. Smaller
/// neighbors look at it from their side.
void judgeTile(const openvdb::FloatGrid::ConstAccessor& accessor, const CheckLimits& limits,
               const Coord& origin, int dim, FaultTallies& tallies)
{
    float value = 0;
    const bool active = accessor.probeValue(origin, value);
    const std::uint64_t voxels = std::uint64_t(dim) * dim * dim;
    if (active) tallies[Fault::ActiveTile].add(origin, 0, voxels);
    if (!std::isfinite(value))
        tallies[Fault::NotFinite].add(origin, 0, voxels);
    else if (!active && !(std::abs(std::abs(value) - limits.background) <= limits.tolerance))
        tallies[Fault::InactiveValue].add(origin, 0, voxels);
    for (int axis = 0; axis < 3; ++axis)
        for (int side : {-1, dim}) {
            Coord beyond = origin;
            beyond[axis] += side;
            float other = 0;
            const bool bothActive = accessor.probeValue(beyond, other) && active;
            if (!bothActive && (value < 0) != (other < 0)) tallies[Fault::SignChange].add(origin);
        }
}

/// Whether child @a n of a node is a tile without fault among tiles of the same node, like itself:
/// nearly all are, and need no look from the root.
template <typename Node>
bool isAmongItsLike(const Node& node, openvdb::Index n, const CheckLimits& limits)
{
    constexpr openvdb::Index kLast = (1u << Node::LOG2DIM) - 1;
    const float value = node.getTable()[n].getValue();
    if (node.isValueMaskOn(n) ||
        !(std::abs(std::abs(value) - limits.background) <= limits.tolerance))
        return false;
    for (openvdb::Index shift = 0; shift < 3 * Node::LOG2DIM; shift += Node::LOG2DIM) {
        const openvdb::Index at = n >> shift & kLast, step = 1u << shift;
        if (at == 0 || at == kLast) return false;
        for (const openvdb::Index other : {n - step, n + step})
            if (node.isChildMaskOn(other) || node.isValueMaskOn(other) ||
                (node.getTable()[other].getValue() < 0) != (value < 0))
                return false;
    }
    return true;
}

/// Judge the tiles of all nodes of one level.
template <typename Node>
FaultTallies judgeTilesOf(const openvdb::FloatGrid& grid, const CheckLimits& limits,
                          const openvdb::CoordBBox& within, Interrupter& progress)
{
    constexpr int kDim = Node::ChildNodeType::DIM;
    std::vector<const Node*> nodes;
    grid.tree().getNodes(nodes);
    return tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, nodes.size(), 1), FaultTallies{},
        [&](const tbb::blocked_range<std::size_t>& range, FaultTallies tallies) {
            const auto accessor = grid.getConstAccessor();
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                for (auto tile = nodes[n]->cbeginValueAll(); tile; ++tile)
                    if (!isAmongItsLike(*nodes[n], tile.pos(), limits) &&
                        isWellWithin(tile.getCoord(), kDim, within))
                        judgeTile(accessor, limits, tile.getCoord(), kDim, tallies);
            }
            return tallies;
        },
        [](FaultTallies a, const FaultTallies& b) {
            a.join(b);
            return a;
        });
}

FaultTallies judgeTiles(const openvdb::FloatGrid& grid, const CheckLimits& limits,
                        const openvdb::CoordBBox& within, Interrupter& progress)
{
    using Upper = Tree::RootNodeType::ChildNodeType;
    using Lower = Upper::ChildNodeType;
    FaultTallies tallies = judgeTilesOf<Upper>(grid, limits, within, progress);
    tallies.join(judgeTilesOf<Lower>(grid, limits, within, progress));
    const auto accessor = grid.getConstAccessor();
    for (auto tile = grid.tree().root().cbeginValueAll(); tile; ++tile)
        if (isWellWithin(tile.getCoord(), Upper::DIM, within))
            judgeTile(accessor, limits, tile.getCoord(), Upper::DIM, tallies);
    return tallies;
}

/// What is wrong, in words.
std::string describe(Fault fault, const CheckLimits& limits, const CheckReport& report)
{
    switch (fault) {
    case Fault::NotFinite:
        return "values are not finite";
    case Fault::ActiveTile:
        return "active tiles: a distance is not constant over a whole tile";
    case Fault::BeyondBackground:
        return fmt::format("active values beyond the background {:g}", limits.background);
    case Fault::InactiveValue:
        return fmt::format("inactive values other than +-{:g}, the background", limits.background);
    case Fault::MissingVoxel:
        return fmt::format("voxels missing from the band, which reaches {:.2f} voxels inside and "
                           "{:.2f} outside of the {:.2f} that the background promises",
                           report.bandInside, report.bandOutside,
                           2 * limits.background / limits.twiceVoxel);
    case Fault::SignChange:
        return "the sign changes beside an inactive voxel or tile";
    case Fault::Jump:
        return fmt::format("the distance changes by more than {:g} voxels from voxel to voxel",
                           kLargestStep);
    case Fault::Steepness:
        break;
    }
    return fmt::format("not a distance: ||grad| - 1| is {:.3f} on average (largest {:.3f}, "
                       "tolerance {:g})",
                       report.meanGradientError, report.maxGradientError, limits.steepness);
}

/// What is wrong with the grid as a whole, and forbids to look at its voxels.
std::vector<CheckFinding> findingsOfGrid(const openvdb::FloatGrid& grid)
{
    std::vector<CheckFinding> findings;
    const auto add = [&](const std::string& what) { findings.push_back({what, Coord(), 0}); };
    const auto lattice = latticeOf(grid.transform());
    if (!lattice) add("voxels are not cubes along the axes");
    const float background = grid.background();
    if (!std::isfinite(background) || !(background > 0))
        add(fmt::format("the background is {:g}, and should be the band's half-width", background));
    else if (lattice && background < lattice->voxelSize * (1 - kHalfTolerance))
        add(fmt::format("the background is {:g} voxels, and a band has at least 1",
                        background / lattice->voxelSize));
    return findings;
}

} // namespace

CheckReport check(const openvdb::FloatGrid& grid, double gradientTolerance,
                  const openvdb::CoordBBox& within, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    CheckReport report;
    report.activeVoxels = grid.activeVoxelCount();
    report.findings = findingsOfGrid(grid);
    const bool measurable = report.findings.empty();
    if (grid.getGridClass() != openvdb::GRID_LEVEL_SET)
        report.findings.push_back(
            {fmt::format("the class is '{}', and should be 'level set'",
                         openvdb::GridBase::gridClassToString(grid.getGridClass())),
             Coord(), 0});
    if (!measurable) return report;

    const double voxelSize = latticeOf(grid.transform())->voxelSize;
    const CheckLimits limits = limitsOf(grid, voxelSize, gradientTolerance);
    SideSums steepness = {};
    FaultTallies tallies = judgeLeaves(grid, limits, within, steepness, progress);
    tallies.join(judgeTiles(grid, limits, within, progress));
    progress.endStage();

    report.bandInside = -tallies.lowest / voxelSize;
    report.bandOutside = tallies.highest / voxelSize;
    report.maxGradientError = tallies.maxSteepness;
    // The better side counts: inside a wall thinner than the band there is no room for a slope.
    double mean = std::numeric_limits<double>::infinity(), least = mean;
    for (std::size_t side : {0, 1}) {
        const auto n = double(tallies.gradients[side]);
        if (!(n > 0)) continue;
        mean = std::min(mean, steepness[side] / n);
        least = std::min(least, steepness[side] / n - kMeanUncertainty / std::sqrt(n));
    }
    if (std::isfinite(mean)) report.meanGradientError = mean;
    for (std::size_t n = 0; n < kFaults; ++n) {
        const auto fault = Fault(n);
        const FaultTally& tally = tallies[fault];
        if (tally.count == 0) continue;
        if (fault == Fault::Steepness && least <= gradientTolerance) continue;
        report.findings.push_back({describe(fault, limits, report), tally.voxel, tally.count});
    }
    return report;
}

} // namespace mpuvdb
