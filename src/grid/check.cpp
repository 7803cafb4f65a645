// The check of a level set: tiles here, leaves in leaf_check, findings as text.
#include "leaf_check.h"
#include "transform_lattice.h"
#include <mpuvdb/error.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;

/// Tolerance of values saved as half floats, relative. [derived: 11 significant bits, two
/// roundings]
constexpr double kHalfTolerance = 1.0 / 1024;
/// Tolerance of floats, relative. [derived: eighty roundings]
constexpr double kFloatTolerance = 1e-5;
/// Largest change of a distance between neighbors, voxels: twice that of a true distance.
/// [tuned: level_set_test]
constexpr double kMaxStep = 2;
/// Uncertainty of a mean ||grad| - 1| over n voxels, times sqrt(n): the few voxels of a band that
/// grazes a region may all be at a crease. [tuned: region_test]
constexpr double kMeanUncertainty = 0.5;
/// Margin by which a neighbor's distance has to put a voxel inside the band, voxels.
/// [tuned: level_set_test]
constexpr double kBandMargin = 0.5;

CheckLimits limitsOf(const openvdb::FloatGrid& grid, double voxelSize, double gradientTolerance)
{
    CheckLimits limits;
    limits.background = grid.background();
    limits.tolerance =
        float(limits.background * (grid.saveFloatAsHalf() ? kHalfTolerance : kFloatTolerance));
    limits.step = float(kMaxStep * voxelSize);
    limits.twiceVoxel = float(2 * voxelSize);
    for (int n = 0; n < 3; ++n)
        limits.near[n] = float(limits.background - (std::sqrt(n + 1.0) + kBandMargin) * voxelSize);
    limits.steepness = float(gradientTolerance);
    return limits;
}

/// Check a tile: inactive, of the background's magnitude, of the same sign as what it touches.
/// Smaller neighbors are compared with it from their side.
void checkTile(const openvdb::FloatGrid::ConstAccessor& accessor, const CheckLimits& limits,
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

/// Whether child @a n of a node and its neighbors in the node are sound tiles of one sign: nearly
/// all are, and need no search from the root.
template <typename Node>
bool isInUniformTiles(const Node& node, openvdb::Index n, const CheckLimits& limits)
{
    /// Last child along an axis. [derived: the node's edge]
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

/// Check the tiles of all nodes of one level.
template <typename Node>
FaultTallies checkTilesOf(const openvdb::FloatGrid& grid, const CheckLimits& limits,
                          const openvdb::CoordBBox& within, Interrupter& progress)
{
    constexpr int kDim = Node::ChildNodeType::DIM; ///< edge of a child, voxels [derived: the tree]
    std::vector<const Node*> nodes;
    grid.tree().getNodes(nodes);
    return tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, nodes.size(), 1), FaultTallies{},
        [&](const tbb::blocked_range<std::size_t>& range, FaultTallies tallies) {
            const auto accessor = grid.getConstAccessor();
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                for (auto tile = nodes[n]->cbeginValueAll(); tile; ++tile)
                    if (!isInUniformTiles(*nodes[n], tile.pos(), limits) &&
                        isWellWithin(tile.getCoord(), kDim, within))
                        checkTile(accessor, limits, tile.getCoord(), kDim, tallies);
            }
            return tallies;
        },
        [](FaultTallies a, const FaultTallies& b) {
            a.join(b);
            return a;
        });
}

FaultTallies checkTiles(const openvdb::FloatGrid& grid, const CheckLimits& limits,
                        const openvdb::CoordBBox& within, Interrupter& progress)
{
    using Upper = Tree::RootNodeType::ChildNodeType;
    using Lower = Upper::ChildNodeType;
    FaultTallies tallies = checkTilesOf<Upper>(grid, limits, within, progress);
    tallies.join(checkTilesOf<Lower>(grid, limits, within, progress));
    const auto accessor = grid.getConstAccessor();
    for (auto tile = grid.tree().root().cbeginValueAll(); tile; ++tile)
        if (isWellWithin(tile.getCoord(), Upper::DIM, within))
            checkTile(accessor, limits, tile.getCoord(), Upper::DIM, tallies);
    return tallies;
}

std::vector<const Leaf*> leavesWithin(const openvdb::FloatGrid& grid,
                                      const openvdb::CoordBBox& within)
{
    std::vector<const Leaf*> leaves;
    grid.tree().getNodes(leaves);
    const auto isBeyond = [&](const Leaf* leaf) {
        return !isWellWithin(leaf->origin(), Leaf::DIM, within);
    };
    leaves.erase(std::remove_if(leaves.begin(), leaves.end(), isBeyond), leaves.end());
    return leaves;
}

/// Error of the slopes of values, the better side's: inside a wall thinner than the band there is
/// no full slope. Infinite without any.
struct SlopeError {
    double mean = std::numeric_limits<double>::infinity(); ///< of ||grad| - 1|
    double least = mean; ///< the least that the mean of distances everywhere may be
};

SlopeError slopeErrorOf(const FaultTallies& tallies, const SideSums& steepness)
{
    SlopeError error;
    for (std::size_t side : {0, 1}) {
        const auto n = double(tallies.gradients[side]);
        if (!(n > 0)) continue;
        error.mean = std::min(error.mean, steepness[side] / n);
        error.least = std::min(error.least, steepness[side] / n - kMeanUncertainty / std::sqrt(n));
    }
    return error;
}

/// The text of a finding.
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
                           kMaxStep);
    case Fault::Flat:
        return "active voxels whose neighbors all have their value, where a distance changes: "
               "no surface is near them";
    case Fault::Steepness:
        break;
    }
    return fmt::format("not a distance: ||grad| - 1| is {:.3f} on average (largest {:.3f}, "
                       "tolerance {:g})",
                       report.meanGradientError, report.maxGradientError, limits.steepness);
}

/// Faults of the grid as a whole, with which its voxels cannot be checked.
std::vector<CheckFinding> findingsOfGrid(const openvdb::FloatGrid& grid)
{
    std::vector<CheckFinding> findings;
    const auto add = [&](const std::string& what) { findings.push_back({what, Coord(), 0}); };
    const auto lattice = latticeOf(grid.transform());
    if (!lattice) add(whyNoLattice(grid.transform()));
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
    const std::vector<const Leaf*> leaves = leavesWithin(grid, within);
    const auto units = double(std::max<std::size_t>(leaves.size(), 1));
    progress.beginStage("check", units);
    FaultTallies tallies = checkLeaves(grid, leaves, limits, steepness, progress, units);
    tallies.join(checkTiles(grid, limits, within, progress));
    progress.endStage();

    report.bandInside = -tallies.lowest / voxelSize;
    report.bandOutside = tallies.highest / voxelSize;
    report.maxGradientError = tallies.maxSteepness;
    const SlopeError slopes = slopeErrorOf(tallies, steepness);
    if (std::isfinite(slopes.mean)) report.meanGradientError = slopes.mean;
    for (std::size_t n = 0; n < kFaults; ++n) {
        const auto fault = Fault(n);
        const FaultTally& tally = tallies[fault];
        if (tally.count == 0) continue;
        if (fault == Fault::Steepness && slopes.least <= gradientTolerance) continue;
        report.findings.push_back({describe(fault, limits, report), tally.voxel, tally.count});
    }
    return report;
}

bool hasSlopesOfDistances(const LevelSet& levelSet, Interrupter* interrupter)
{
    /// Leaves to look at first. [free: they only tell where all need be looked at]
    constexpr std::size_t kSampledLeaves = 128;
    /// Largest mean error of these with which all are distances: that of as many numbers in [0, 1]
    /// errs by 0.5 / sqrt(128) at most, one standard deviation. [derived: half the tolerance]
    constexpr double kMaxSampled = kGradientTolerance / 2;
    Interrupter& progress = orSilent(interrupter);
    const openvdb::FloatGrid& grid = levelSet.grid();
    const CheckLimits limits = limitsOf(grid, levelSet.voxelSize(), kGradientTolerance);
    const auto errorOf = [&](const std::vector<const Leaf*>& leaves) {
        SideSums steepness = {};
        const FaultTallies tallies = checkLeaves(grid, leaves, limits, steepness, progress);
        return slopeErrorOf(tallies, steepness);
    };
    const std::vector<const Leaf*> all = leavesWithin(grid, openvdb::CoordBBox::inf());
    const std::size_t stride = all.size() / kSampledLeaves + 1;
    std::vector<const Leaf*> some;
    for (std::size_t n = 0; n < all.size(); n += stride) some.push_back(all[n]);
    if (errorOf(some).mean <= kMaxSampled) return true;
    const SlopeError error = errorOf(all);
    return !std::isfinite(error.mean) || error.least <= kGradientTolerance;
}

} // namespace mpuvdb
