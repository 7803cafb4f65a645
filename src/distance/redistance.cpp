// Grids with values computed from distances to a surface: re-distancing, widening, offsets, shells.
#include "distance_front.h"

#include "grid/band_limits.h"
#include "grid/prune.h"
#include "restore_distance.h"
#include "shell_patches.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace mpuvdb
{
namespace
{

using Leaf = SurfacePatches::Leaf;
using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;

/// Largest offset or thickness, voxels. [derived: floats there resolve a hundredth of a voxel]
constexpr double kMaxDistance = 1e5;
/// Excess of the distance to an offset's surface over a value, voxels, from which on the value is
/// replaced. [tuned: offset_bench]
constexpr float kMaxCreaseError = 0.1f;
/// Distance from the zero set, voxels, up to which values that are not distances stay, as they
/// define it; over the next voxel they blend into distances. [tuned: redistance_test]
constexpr float kKeptWidth = 1;
/// Share of an offset's progress for the repair of creases. [free: progress display]
constexpr double kCreaseShare = 0.4;

/// Signed distances in world units, computed on demand.
class Distances
{
public:
    Distances(const LeafDistances& inVoxels, float voxelSize, bool ownAreDistances)
        : mInVoxels(inVoxels), mVoxelSize(voxelSize), mOwnAreDistances(ownAreDistances)
    {
    }
    float at(int voxel) const { return mVoxelSize * mInVoxels.at(voxel); }
    float atMost(int voxel) const { return mVoxelSize * mInVoxels.atMost(voxel); }
    /// Whether the grid's own values are distances in all its band.
    bool ownAreDistances() const { return mOwnAreDistances; }
    /// The distance of an active voxel: its @a own value as far as values are distances.
    float by(float own, int voxel) const
    {
        if (mOwnAreDistances) return own;
        const float found = at(voxel), fading = std::abs(found) / mVoxelSize - kKeptWidth;
        return fading >= 1 ? found : own + std::max(fading, 0.0f) * (found - own);
    }

private:
    const LeafDistances& mInVoxels;
    float mVoxelSize;
    bool mOwnAreDistances;
};

/// Infinite distances with the signs of a leaf, or with one sign.
class Beyond final : public LeafDistances
{
public:
    explicit Beyond(const Leaf& leaf) : mLeaf(&leaf) {}
    explicit Beyond(bool inside) : mSign(inside ? -1.0f : 1.0f) {}
    float at(int n) const override
    {
        // Not copysign: -0 is outside, as 0 is.
        const float v = mLeaf ? mLeaf->getValue(openvdb::Index(n)) : mSign;
        return v < 0 ? -kInfinity : kInfinity;
    }
    float atMost(int n) const override { return at(n); }
    std::uint32_t patch(int) const override { return kNoPatch; }

private:
    const Leaf* mLeaf = nullptr;
    float mSign = 1;
};

/// Computes the new value of a voxel of a leaf (null: of a tile) from its distance, world units.
using NewValue = std::function<float(const Leaf*, int voxel, const Distances&)>;

/// Makes leaves of a band of @a halfWidth voxels with the values of @a newValue.
class BandMaker
{
public:
    BandMaker(double halfWidth, double voxelSize, NewValue newValue)
        : mVoxelSize(float(voxelSize)), mBackground(float(halfWidth * voxelSize)),
          mNewValue(std::move(newValue))
    {
    }

    FinishedLeaf finish(const Coord& origin, const Leaf* signs, const LeafDistances& d,
                        bool ownAreDistances) const
    {
        FinishedLeaf finished;
        finished.origin = origin;
        auto leaf = std::make_unique<Leaf>(origin, mBackground);
        unsigned negative = 0;
        const float rim = mBackground * (1 - 1e-6f);
        const Distances distances(d, mVoxelSize, ownAreDistances);
        for (int n = 0; n < int(Leaf::SIZE); ++n) {
            const float v = mNewValue(signs, n, distances);
            negative += v < 0;
            if (std::abs(v) < rim)
                leaf->setValueOn(openvdb::Index(n), v);
            else if (v < 0)
                leaf->setValueOnly(openvdb::Index(n), -mBackground);
        }
        if (leaf->isEmpty() && (negative == 0 || negative == Leaf::SIZE))
            finished.tile = negative ? -mBackground : mBackground;
        else
            finished.leaf = std::move(leaf);
        return finished;
    }

    float background() const { return mBackground; }
    /// The new value of a tile beyond the reach.
    float farValue(bool inside) const
    {
        const float v = mNewValue(nullptr, 0, Distances(Beyond(inside), mVoxelSize, true));
        return v < 0 ? -mBackground : mBackground;
    }

private:
    float mVoxelSize, mBackground;
    NewValue mNewValue;
};

/// Input of distances to a grid's zero set.
struct Sources {
    SurfacePatches patches;
    Reach reach; ///< of the patches' distances; 0 where the grid's own values suffice
    bool ownAreDistances = true; ///< the grid's own values, in all its band
};

/// The tree of new values: @a reached leaves, and all others of @a old by their own values and
/// signs.
FloatTree::Ptr assemble(const FloatTree& old, const Sources& sources,
                        std::vector<FinishedLeaf>&& reached, const BandMaker& maker,
                        Interrupter& progress)
{
    auto tree = std::make_shared<FloatTree>(maker.background());
    auto tile = old.cbeginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile)
        if (const float value = maker.farValue(*tile < 0); value < 0)
            tree->addTile(tile.getLevel(), tile.getCoord(), value, false);
    const auto add = [&](FinishedLeaf& leaf) {
        if (leaf.leaf)
            tree->addLeaf(leaf.leaf.release());
        else
            tree->addTile(1, leaf.origin, leaf.tile, false);
    };
    std::vector<Coord> origins;
    origins.reserve(reached.size());
    for (const FinishedLeaf& leaf : reached) origins.push_back(leaf.origin);
    std::sort(origins.begin(), origins.end());
    for (const Leaf* leaf : sources.patches.leaves) {
        if (std::binary_search(origins.begin(), origins.end(), leaf->origin())) continue;
        progress.check();
        FinishedLeaf finished =
            maker.finish(leaf->origin(), leaf, Beyond(*leaf), sources.ownAreDistances);
        add(finished);
    }
    for (FinishedLeaf& leaf : reached) {
        progress.check();
        add(leaf);
    }
    pruneBand(*tree);
    return tree;
}

/// The side on which alone @a reach exceeds the band of @a grid: 1 outside, -1 inside, 0 if none.
float sideBeyond(const FloatGrid& grid, const Reach& reach)
{
    /// Relative tolerance of the comparison. [derived: a thousand roundings of a float]
    constexpr float kRounding = 1e-4f;
    const float own = float(grid.background() / grid.voxelSize()[0]) * (1 + kRounding);
    return float(reach.outside > own) - float(reach.inside > own);
}

/// Interpretation of a grid's own values.
enum class Own {
    Implicit, ///< as Values::Implicit
    Kept,     ///< as distances
    Judged    ///< as distances if the shell about the surface has some
};

/// The worse of the two sides' results of shellValues().
ShellValues shellValuesOfBothSides(const FloatGrid& grid, Interrupter& progress)
{
    const double voxelSize = grid.voxelSize()[0];
    const ShellValues outside = shellValues(grid.tree(), voxelSize, 1, progress);
    return outside == ShellValues::NoDistances ? outside
                                               : shellValues(grid.tree(), voxelSize, -1, progress);
}

/// @param reach  of the distances to the zero set of @a grid.
Sources sourcesOf(const FloatGrid& grid, Own own, const Reach& reach, Interrupter& progress)
{
    const double voxelSize = grid.voxelSize()[0];
    if (own == Own::Implicit)
        return {surfacePatches(grid.tree(), voxelSize, Values::Implicit, progress), reach};
    Sources sources{surfacePatches(grid.tree(), voxelSize, Values::Distances, progress), reach};
    ShellValues shell = ShellValues::TooNarrow;
    if (const float side = sideBeyond(grid, reach); side != 0) {
        shell = refineByShellProjection(sources.patches, grid.tree(), voxelSize, side, progress);
        if (shell == ShellValues::Distances)
            (side > 0 ? sources.reach.inside : sources.reach.outside) = 0;
    } else if (own == Own::Judged) {
        shell = shellValuesOfBothSides(grid, progress);
    }
    sources.ownAreDistances = own == Own::Kept || shell != ShellValues::NoDistances;
    return sources;
}

/// A level set on the lattice of @a grid with new values, computed from the distances to its zero
/// set as far as @a reach. @param units  by which the running stage advances.
FloatGrid::Ptr remade(const FloatGrid& grid, Own own, const Reach& reach, const BandMaker& maker,
                      Interrupter& progress, double units = 0)
{
    constexpr double kPatchesShare = 0.2; ///< share of the progress [free: progress display]
    const Sources sources = sourcesOf(grid, own, reach, progress);
    progress.advance(kPatchesShare * units);
    std::vector<FinishedLeaf> reached = spreadDistances(
        grid.tree(), sources.patches, sources.reach,
        [&](const Coord& origin, const Leaf* signs, const LeafDistances& d) {
            return maker.finish(origin, signs, d, sources.ownAreDistances);
        },
        progress, (1 - kPatchesShare) * units);
    auto result =
        FloatGrid::create(assemble(grid.tree(), sources, std::move(reached), maker, progress));
    result->insertMeta(grid);
    result->setTransform(grid.transform().copy());
    result->setGridClass(openvdb::GRID_LEVEL_SET);
    return result;
}

/// The grid's own distance of an active voxel, as Distances::by(), or else the computed one.
float ownOrFound(const Leaf* leaf, int n, const Distances& distances)
{
    const bool own = leaf && leaf->isValueOn(openvdb::Index(n));
    return own ? distances.by(leaf->getValue(openvdb::Index(n)), n) : distances.at(n);
}

/// New values: ownOrFound(), changed by @a change.
NewValue changed(const std::function<float(float)>& change)
{
    return [change](const Leaf* leaf, int n, const Distances& distances) {
        return change(ownOrFound(leaf, n, distances));
    };
}

/// New values: ownOrFound() less @a shift, in a band as wide as @a background.
NewValue shifted(float shift, float background)
{
    return [=](const Leaf* leaf, int n, const Distances& distances) {
        const bool own = leaf && leaf->isValueOn(openvdb::Index(n)) && distances.ownAreDistances();
        if (!own) {
            const float most = distances.atMost(n), v = most - shift;
            // All values from zero to there lie beyond the new band.
            if ((most < 0) != (v < 0) && std::abs(v) >= background) return v;
        }
        return ownOrFound(leaf, n, distances) - shift;
    };
}

/// Where offsets of two parts of the old surface meet, the new surface has a crease, and values
/// behind it are distances to places that the offset has removed. Replace those on one side (1
/// outside, -1 inside) by distances to the new surface.
FloatGrid::Ptr repairOffsetCreases(const FloatGrid& grid, float side, double halfWidth,
                                   Interrupter& progress)
{
    const auto reach = float(halfWidth), tolerance = float(kMaxCreaseError * grid.voxelSize()[0]);
    const auto newValue = [side, tolerance](const Leaf* leaf, int n, const Distances& distances) {
        const float most = distances.atMost(n);
        const bool active = leaf && leaf->isValueOn(openvdb::Index(n));
        if (!active) return std::copysign(kInfinity, most);
        const float v = leaf->getValue(openvdb::Index(n)), least = std::abs(v) + tolerance;
        if (!(v * side > 0) || !(std::abs(most) > least)) return v;
        const float distance = distances.at(n);
        return std::abs(distance) > least ? distance : v;
    };
    const BandMaker maker(halfWidth, grid.voxelSize()[0], newValue);
    FloatGrid::Ptr made = remade(grid, Own::Implicit, side > 0 ? Reach{reach, 0} : Reach{0, reach},
                                 maker, progress, kCreaseShare);
    restoreDistance(made->tree(), made->voxelSize()[0], ValuesFrom::Distances, progress);
    return made;
}

/// @throws LimitError if floats do not resolve @a distance (world units). @param what  its name.
void requireRepresentableDistance(const char* what, double distance, double voxelSize)
{
    if (std::abs(distance) > kMaxDistance * voxelSize)
        throw LimitError(fmt::format("{} {:.6g} is {:.3g} voxels of {:.6g}, and no more than {:g} "
                                     "are resolved: use at most {:.6g}, or larger voxels",
                                     what, distance, std::abs(distance) / voxelSize, voxelSize,
                                     kMaxDistance, kMaxDistance * voxelSize));
}

/// Whether a voxel is inside @a solid and outside @a wall, which has a band's voxels there.
bool isHollow(const FloatTree& solid, const FloatTree& wall, const Interrupter& progress)
{
    std::vector<const FloatTree::LeafNodeType*> leaves;
    wall.getNodes(leaves);
    std::atomic<bool> found{false};
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        if (found) return;
        progress.check();
        const openvdb::tree::ValueAccessor<const FloatTree, false> before(solid);
        for (auto voxel = leaves[n]->cbeginValueOn(); voxel && !found; ++voxel)
            if (*voxel > 0 && before.getValue(voxel.getCoord()) < 0) found = true;
    });
    return found;
}

} // namespace

LevelSet withHalfWidth(const LevelSet& levelSet, double halfWidth, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireHalfWidth(halfWidth);
    const auto reach = float(halfWidth);
    const bool isWider = halfWidth > levelSet.halfWidth();
    const BandMaker maker(halfWidth, levelSet.voxelSize(), changed([](float d) { return d; }));
    const FloatGrid::Ptr made =
        remade(levelSet.grid(), isWider ? Own::Judged : Own::Kept, {reach, reach}, maker, progress);
    if (halfWidth < levelSet.halfWidth())
        completeBand(made->tree(), levelSet.voxelSize(), progress);
    return LevelSet(made);
}

LevelSet redistance(const FloatGrid& grid, double halfWidth, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireHalfWidth(halfWidth);
    const auto reach = float(halfWidth);
    const BandMaker maker(halfWidth, grid.voxelSize()[0],
                          [](const Leaf*, int n, const Distances& d) { return d.at(n); });
    const FloatGrid::Ptr made = remade(grid, Own::Implicit, {reach, reach}, maker, progress);
    restoreDistance(made->tree(), made->voxelSize()[0], ValuesFrom::Distances, progress);
    return LevelSet(made);
}

LevelSet offset(const LevelSet& levelSet, double distance, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!std::isfinite(distance))
        throw UsageError(fmt::format("offset: distance is {}; it must be finite", distance));
    requireRepresentableDistance("offset: distance", distance, levelSet.voxelSize());
    const double halfWidth = levelSet.halfWidth();
    const auto shift = float(distance / levelSet.voxelSize());
    const Reach reach{float(halfWidth) + shift, float(halfWidth) - shift};
    const BandMaker maker(halfWidth, levelSet.voxelSize(),
                          shifted(float(distance), float(halfWidth * levelSet.voxelSize())));
    const FloatGrid::Ptr moved =
        remade(levelSet.grid(), Own::Judged, reach, maker, progress, 1 - kCreaseShare);
    return LevelSet(repairOffsetCreases(*moved, shift > 0 ? -1.0f : 1.0f, halfWidth, progress));
}

LevelSet shell(const LevelSet& levelSet, double thickness, Wall wall, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!(thickness > 0) || !std::isfinite(thickness))
        throw UsageError(
            fmt::format("shell: thickness is {:.6g}; it must be above 0 and finite", thickness));
    requireRepresentableDistance("shell: thickness", thickness, levelSet.voxelSize());
    const double halfWidth = levelSet.halfWidth();
    const auto reach = float(halfWidth), half = float(0.5 * thickness / levelSet.voxelSize());
    constexpr float kMinWall = 2; ///< thinnest wall, voxels [tuned: redistance_test]
    if (!(2 * half >= kMinWall))
        throw LimitError(
            fmt::format("shell: thickness {:.6g} is {:.3g} voxels, and a level set "
                        "resolves no wall thinner than {:g}: use voxels of at most {:g}",
                        thickness, 2 * half, kMinWall, thickness / kMinWall));
    const float middle = wall == Wall::Inward ? -half : wall == Wall::Outward ? half : 0;
    const auto h = float(levelSet.voxelSize());
    const BandMaker maker(halfWidth, levelSet.voxelSize(),
                          changed([=](float d) { return std::abs(d - middle * h) - half * h; }));
    const FloatGrid::Ptr hollow =
        remade(levelSet.grid(), Own::Judged, {reach + middle + half, reach + half - middle}, maker,
               progress, 1 - kCreaseShare);
    const LevelSet result(repairOffsetCreases(*hollow, -1, halfWidth, progress));
    if (!levelSet.grid().empty() &&
        !isHollow(levelSet.grid().tree(), result.grid().tree(), progress))
        progress.note(fmt::format("the solid is nowhere thicker than its walls of {:.4g} on both "
                                  "sides: nothing of it is hollow",
                                  thickness));
    return result;
}

} // namespace mpuvdb
