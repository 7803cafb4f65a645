#include "band_limits.h"
#include "csg_tree.h"
#include "measure_voxels.h"
#include "prune.h"
#include "restore_distance.h"

#include <mpuvdb/error.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// Half-widths (and backgrounds) that differ by less pass for one.
constexpr double kSameWidth = 1e-5;
/// Voxels that the inputs' bands need beyond the ball's path to be interpolated there.
constexpr double kAroundPath = 2.5;
/// How often a fillet's distances are restored, at most.
constexpr int kMostRestored = 4;

/// The inputs with bands of at least @a halfWidth.
std::vector<LevelSet> widened(std::vector<LevelSet> inputs, double halfWidth, Progress& progress)
{
    for (LevelSet& input : inputs)
        if (input.halfWidth() < halfWidth * (1 - kSameWidth))
            input = withHalfWidth(input, halfWidth, progress);
    return inputs;
}

/// The tree of @a grid with @a background; a copy only if it has another.
FloatTree::ConstPtr withBackground(const FloatGrid& grid, float background)
{
    if (grid.background() == background) return grid.constTreePtr();
    const auto tree = std::make_shared<FloatTree>(grid.tree());
    openvdb::tools::changeLevelSetBackground(*tree, background);
    return tree;
}

/// Cut a band to @a background: values from there on become inactive.
void narrow(FloatTree& tree, float background, Progress& progress)
{
    openvdb::tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach ([&](Leaf& leaf, std::size_t) {
        progress.check();
        for (auto it = leaf.beginValueOn(); it; ++it)
            if (!(std::abs(*it) < background))
                leaf.setValueOff(it.pos(), std::copysign(tree.background(), *it));
    });
    if (tree.background() != background) openvdb::tools::changeLevelSetBackground(tree, background);
}

/// The result with all that @a model says of itself but its contents.
LevelSet likeGrid(const FloatGrid& model, const FloatTree::Ptr& tree)
{
    const FloatGrid::Ptr grid = FloatGrid::create(tree);
    grid->setTransform(model.transform().copy());
    grid->insertMeta(model);
    for (const char* stale : {FloatGrid::META_FILE_BBOX_MIN, FloatGrid::META_FILE_BBOX_MAX,
                              FloatGrid::META_FILE_MEM_BYTES, FloatGrid::META_FILE_VOXEL_COUNT})
        grid->removeMeta(stale);
    return LevelSet(grid);
}

} // namespace

LevelSet combine(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                 Progress& progress)
{
    if (inputs.empty())
        throw UsageError("Boolean operation: there is no level set. Give at least one");
    demandBlendRadius(blendRadius);
    if (inputs.size() == 1) return inputs.front();
    std::vector<LevelSet> solids = onOneLattice(inputs, progress).levelSets;
    const double voxelSize = solids.front().voxelSize();
    double halfWidth = 0;
    for (const LevelSet& solid : solids) halfWidth = std::max(halfWidth, solid.halfWidth());
    double needed = halfWidth;
    if (blendRadius > 0) {
        needed = std::max(halfWidth, kAroundPath);
        demandBandForBlend(blendRadius, voxelSize, needed);
        needed += blendRadius / voxelSize;
    }
    solids = widened(std::move(solids), needed, progress);
    progress.beginStage("combine", double(solids.size() - 1));
    float background = 0;
    for (const LevelSet& solid : solids)
        background = std::max(background, solid.grid().background());
    FloatTree::ConstPtr first = withBackground(solids.front().grid(), background);
    FloatTree::Ptr tree;
    for (std::size_t n = 1; n < solids.size(); ++n) {
        const FloatTree::ConstPtr next = withBackground(solids[n].grid(), background);
        CsgTree result = csgTree(kind, *first, *next, voxelSize, blendRadius, progress);
        tree = std::move(result.tree);
        if (result.isFilletDoubtful) {
            // Values made anew move crossings that others were measured to.
            for (int turn = 0; turn < kMostRestored; ++turn)
                if (restoreDistance(*tree, voxelSize, progress) == 0) break;
        } else {
            measureUnplaced(*tree, voxelSize, result.known, progress);
            restoreDistance(*tree, voxelSize, result.known, progress);
        }
        pruneBand(*tree);
        first = tree;
        progress.advance();
    }
    if (blendRadius > 0) {
        narrow(*tree, float(halfWidth * voxelSize), progress);
        completeBand(*tree, voxelSize, progress);
        pruneBand(*tree);
    }
    progress.endStage();
    return likeGrid(solids.front().grid(), tree);
}

} // namespace mpuvdb
