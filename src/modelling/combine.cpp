#include "combine.h"

#include "csg_tree.h"
#include "distance/measure_voxels.h"
#include "distance/restore_distance.h"
#include "fillet.h"
#include "grid/band_limits.h"
#include "grid/has_inside.h"
#include "grid/prune.h"
#include "half_widths.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <openvdb/tools/ChangeBackground.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// The band, in voxels, that interpolation at the ball's path reads beyond it.
/// [tuned: combine_test]
constexpr double kAroundPath = 2.5;

/// @a tree with @a background; a copy only if it has another.
FloatTree::ConstPtr withBackground(const FloatTree::ConstPtr& tree, float background)
{
    if (tree->background() == background) return tree;
    const auto copy = std::make_shared<FloatTree>(*tree);
    openvdb::tools::changeLevelSetBackground(*copy, background);
    return copy;
}

/// A box that holds all of the solids, world units.
Box3d boxOf(const std::vector<LevelSet>& solids)
{
    Box3d box;
    for (const LevelSet& solid : solids) {
        openvdb::CoordBBox active;
        if (!solid.grid().tree().evalActiveVoxelBoundingBox(active)) continue;
        const Lattice lattice = solid.lattice();
        for (const openvdb::Coord& corner : {active.min(), active.max()})
            box.extend(lattice.origin +
                       lattice.voxelSize * Vec3d(corner.x(), corner.y(), corner.z()));
    }
    return box;
}

/// Reads level sets in bands of at least some widths, with one background.
struct Bands {
    double halfWidth = 0; ///< voxels
    float background = 0; ///< world units

    FloatTree::ConstPtr treeOf(const LevelSet& solid, Interrupter& progress) const
    {
        if (solid.halfWidth() >= halfWidth * (1 - kSameHalfWidth))
            return withBackground(solid.grid().constTreePtr(), background);
        const LevelSet wider = withHalfWidth(solid, halfWidth, &progress);
        return withBackground(wider.grid().constTreePtr(), background);
    }
};

/// The Boolean of two solids.
class Pair
{
public:
    /// @param halfWidth  of the result, voxels; the solids' may be wider.
    Pair(Boolean kind, const LevelSet& a, const LevelSet& b, double halfWidth)
        : mKind(kind), mA(a), mB(b), mHalfWidth(halfWidth), mVoxelSize(a.voxelSize())
    {
    }

    FloatTree::Ptr sharp(Interrupter& progress) const
    {
        const float background = std::max(
            {float(mHalfWidth * mVoxelSize), mA.grid().background(), mB.grid().background()});
        const Bands bands{mHalfWidth, background};
        CsgTree csg = csgTree(mKind, *bands.treeOf(mA, progress), *bands.treeOf(mB, progress),
                              mVoxelSize, mHalfWidth, progress);
        measureUnplaced(*csg.tree, mVoxelSize, csg.known, progress);
        restoreDistance(*csg.tree, mVoxelSize, csg.known, progress);
        pruneBand(*csg.tree);
        return csg.tree;
    }

    /// Changes @a sharp where the ball of @a radius (world units) fillets it.
    void fillet(FloatTree& sharp, double radius, Interrupter& progress) const
    {
        const FilletReport report = mpuvdb::fillet(sharp, mKind, mA.grid().tree(), mB.grid().tree(),
                                                   mVoxelSize, mHalfWidth, radius, progress);
        noteLimits(report, radius, progress);
        if (!report.hasChanged) return;
        if (!report.suspects.empty()) restoreDistance(sharp, mVoxelSize, report.suspects, progress);
        pruneBand(sharp);
    }

private:
    /// Notes effects of the blend that the user may not expect.
    void noteLimits(const FilletReport& report, double radius, Interrupter& progress) const
    {
        // The least depth, in voxels, of a removed part that is noted. [derived: less is thinner
        // than a voxel, which no grid shows]
        constexpr float kMinNotedDepth = 0.5f;
        if (!report.hasChanged && report.isTooNarrow)
            progress.note(fmt::format("the blend changed nothing: beside the creases a ball of "
                                      "its radius {:.4g} has no room. Take a smaller one",
                                      radius));
        if (report.removedRadius < kMinNotedDepth) return;
        const Coord& middle = report.removed;
        const Vec3d at =
            mA.lattice().origin + mVoxelSize * Vec3d(middle.x(), middle.y(), middle.z());
        const double depth = report.removedRadius * mVoxelSize;
        progress.note(fmt::format("the blend took away what is thinner than its ball, up to {:.4g} "
                                  "thick at ({:.4g}, {:.4g}, {:.4g}): radius {:.4g} has no room "
                                  "there, {:.4g} has",
                                  2 * depth, at.x(), at.y(), at.z(), radius, depth));
    }

    Boolean mKind;
    const LevelSet &mA, &mB;
    double mHalfWidth, mVoxelSize; ///< voxels; world units
};

/// @a tree with the transform and metadata of @a model, but those of its contents.
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

/// The Boolean of many solids, as Booleans of two.
class Fold
{
public:
    /// @param model  the grid whose metadata the result has.
    /// @param halfWidth  of the result, voxels.
    Fold(const FloatGrid& model, double blendRadius, double halfWidth, Interrupter& progress)
        : mModel(model), mBlendRadius(blendRadius), mHalfWidth(halfWidth), mProgress(progress)
    {
    }

    LevelSet all(Boolean kind, const std::vector<LevelSet>& inputs) const
    {
        if (mBlendRadius > 0) return inOrder(kind, inputs);
        if (kind != Boolean::Difference || inputs.size() < 3) return inPairs(kind, inputs);
        const LevelSet cut = inPairs(Boolean::Union, {inputs.begin() + 1, inputs.end()});
        return ofTwo(kind, inputs.front(), cut);
    }

private:
    /// One after the other, as fillets depend on the order.
    LevelSet inOrder(Boolean kind, const std::vector<LevelSet>& inputs) const
    {
        LevelSet result = inputs.front();
        for (std::size_t n = 1; n < inputs.size(); ++n) result = ofTwo(kind, result, inputs[n]);
        return result;
    }

    /// Two by two, then these two by two: each voxel is copied as often as the logarithm of the
    /// number of solids says, not once for each.
    LevelSet inPairs(Boolean kind, const std::vector<LevelSet>& inputs) const
    {
        std::vector<std::pair<std::size_t, LevelSet>> open; // sizes fall, with the solids in each
        const auto joinLast = [&] {
            const auto [size, last] = open.back();
            open.pop_back();
            open.back() = {open.back().first + size, ofTwo(kind, open.back().second, last)};
        };
        for (const LevelSet& input : inputs) {
            open.emplace_back(1, input);
            while (open.size() > 1 && open[open.size() - 2].first == open.back().first) joinLast();
        }
        while (open.size() > 1) joinLast();
        return open.front().second;
    }

    LevelSet ofTwo(Boolean kind, const LevelSet& a, const LevelSet& b) const
    {
        const Pair pair(kind, a, b, mHalfWidth);
        const FloatTree::Ptr tree = pair.sharp(mProgress);
        if (mBlendRadius > 0) pair.fillet(*tree, mBlendRadius, mProgress);
        mProgress.advance();
        return likeGrid(mModel, tree);
    }

    const FloatGrid& mModel;
    double mBlendRadius, mHalfWidth;
    Interrupter& mProgress;
};

} // namespace

LevelSet combine(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                 Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (inputs.empty())
        throw UsageError("Boolean operation: there is no level set. Give at least one");
    requireBlendRadius(blendRadius);
    if (inputs.size() == 1) return inputs.front();
    const std::vector<LevelSet> solids = onOneLattice(inputs, 0, &progress).levelSets;
    double halfWidth = 0;
    for (const LevelSet& solid : solids) halfWidth = std::max(halfWidth, solid.halfWidth());
    return combineInBand(kind, solids, blendRadius, halfWidth, progress);
}

LevelSet combineInBand(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                       double halfWidth, Interrupter& progress)
{
    if (blendRadius > 0) {
        const double voxelSize = inputs.front().voxelSize();
        requireBandForBlend(blendRadius, voxelSize, std::max(halfWidth, kAroundPath));
        requireBallForSolids(blendRadius, voxelSize, boxOf(inputs));
    }
    progress.beginStage("combine", double(inputs.size() - 1));
    const Fold fold(inputs.front().grid(), blendRadius, halfWidth, progress);
    const LevelSet result = fold.all(kind, inputs);
    progress.endStage();
    // A part thinner than a voxel may lie between voxels: a band without an inside is empty.
    if (!hasInside(result.grid().tree()))
        return emptyLevelSet(result.lattice(), std::max(halfWidth, kMinHalfWidth));
    return result.halfWidth() > halfWidth * (1 + kSameHalfWidth)
               ? withHalfWidth(result, halfWidth, &progress)
               : result;
}

} // namespace mpuvdb
