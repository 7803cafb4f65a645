// Surfaces smoothed by filters of their distance.
#include "grid/prune.h"
#include "smooth_filters.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>
#include <openvdb/tools/Morphology.h>
#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// The voxels whose values differ between two grids of one topology.
openvdb::MaskTree::Ptr changedVoxels(const FloatTree& before, const FloatTree& after)
{
    auto changed = std::make_shared<openvdb::MaskTree>(after, false, true, openvdb::TopologyCopy());
    openvdb::tree::LeafManager<openvdb::MaskTree> leaves(*changed);
    leaves.foreach ([&](openvdb::MaskTree::LeafNodeType& leaf, std::size_t) {
        const Leaf* const old = before.probeConstLeaf(leaf.origin());
        const Leaf* const now = after.probeConstLeaf(leaf.origin());
        for (auto voxel = leaf.beginValueOn(); voxel; ++voxel)
            if (old->getValue(voxel.pos()) == now->getValue(voxel.pos()))
                leaf.setValueOff(voxel.pos());
    });
    openvdb::tools::pruneInactive(*changed);
    return changed;
}

/// @a after around the voxels of @a changed, where the nearest place of the surface may be another;
/// else @a before.
LevelSet changedOnly(const LevelSet& before, const LevelSet& after, openvdb::MaskTree& changed,
                     Interrupter& progress)
{
    // A voxel's nearest place is in its band's reach, and the voxels around it two farther.
    openvdb::tools::dilateActiveValues(changed, int(std::ceil(before.halfWidth())) + 2,
                                       openvdb::tools::NN_FACE_EDGE_VERTEX,
                                       openvdb::tools::EXPAND_TILES);
    changed.voxelizeActiveTiles();
    progress.check();
    const auto grid = before.grid().deepCopy();
    FloatTree& tree = grid->tree();
    tree.topologyUnion(
        FloatTree(after.grid().tree(), before.grid().background(), openvdb::TopologyCopy()));
    std::vector<const openvdb::MaskTree::LeafNodeType*> masks;
    changed.getNodes(masks);
    for (const auto* mask : masks)
        if (after.grid().tree().probeConstLeaf(mask->origin())) tree.touchLeaf(mask->origin());
    openvdb::tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach ([&](Leaf& leaf, std::size_t) {
        progress.check();
        const Leaf* const old = before.grid().tree().probeConstLeaf(leaf.origin());
        const float tile = before.grid().tree().getValue(leaf.origin());
        const Leaf* const now = after.grid().tree().probeConstLeaf(leaf.origin());
        const float newTile = after.grid().tree().getValue(leaf.origin());
        const auto* const mask = changed.probeConstLeaf(leaf.origin());
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
            const bool isNew = mask && mask->isValueOn(n);
            const Leaf* const from = isNew ? now : old;
            leaf.setValueOnly(n, from ? from->getValue(n) : isNew ? newTile : tile);
            leaf.setActiveState(n, from && from->isValueOn(n));
        }
    });
    pruneBand(tree);
    return LevelSet(grid);
}

void requireMask(const FloatGrid& mask)
{
    requireFinite(mask);
    if (mask.getGridClass() == openvdb::GRID_LEVEL_SET)
        throw InputError(fmt::format("smooth: the mask '{}' is a level set, whose values are "
                                     "distances. Give shares from 0 to 1, as mpuvdb fog makes them",
                                     mask.getName()));
}

} // namespace

void requireSmoothSettings(const SmoothSettings& settings)
{
    if (settings.iterations < 1 || settings.iterations > 1000)
        throw UsageError(
            fmt::format("smooth: {} iterations; there must be 1 to 1000", settings.iterations));
    if (settings.filter != Filter::MeanCurvature && (settings.width < 1 || settings.width > 32))
        throw UsageError(fmt::format("smooth: the filter's width is {} voxels; it must be in "
                                     "[1, 32]. For more smoothing take more iterations",
                                     settings.width));
}

LevelSet smooth(const LevelSet& levelSet, const SmoothSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireSmoothSettings(settings);
    if (settings.mask) requireMask(*settings.mask);
    const double halfWidth = levelSet.halfWidth();
    progress.beginStage("smooth", passesOf(settings));
    LevelSet result = levelSet;
    bool isChanged = false;
    for (int done = 0; done < passesOf(settings) && !result.grid().empty();) {
        const FilterPass pass = nextPass(settings, done);
        const LevelSet wide =
            halfWidth < pass.halfWidth ? withHalfWidth(result, pass.halfWidth, &progress) : result;
        const FloatGrid::Ptr filtered = filter(wide, settings, pass, progress);
        const auto changed = changedVoxels(wide.grid().tree(), filtered->tree());
        progress.check();
        if (!changed->empty()) {
            isChanged = true;
            const LevelSet after = redistance(*filtered, halfWidth, &progress);
            result = settings.mask ? changedOnly(result, after, *changed, progress) : after;
        }
        done += pass.steps;
        progress.advance(pass.steps);
    }
    if (settings.mask && !isChanged && !levelSet.grid().empty())
        progress.note(fmt::format("nothing was smoothed: the mask '{}' is 0 wherever the "
                                  "filter changes the surface. Look where it lies with mpuvdb info",
                                  settings.mask->getName()));
    progress.endStage();
    return result;
}

} // namespace mpuvdb
