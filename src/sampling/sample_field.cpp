#include "band.h"
#include "distance/restore_distance.h"
#include "grid/band_limits.h"
#include "grid/prune.h"
#include "grid/transform_lattice.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/sampling.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <optional>

namespace mpuvdb
{
namespace
{

/// Half-width of the band, voxels, in which values that are not distances define the surface.
/// [derived: above sqrt(3), the distance of a crossed cell's corners]
constexpr double kCrossingWidth = 2;

/// Voxels beyond a band that distances at its end still depend on. [derived: a leaf]
constexpr int kStencil = 8;

void requireValidSettings(const Field& field, const SampleSettings& settings)
{
    requireVoxelSize(settings.lattice.voxelSize);
    requireHalfWidth(settings.halfWidth);
    const Box3d box = field.bounds();
    if (!box.isEmpty() && !(box.min().allFinite() && box.max().allFinite()))
        throw UsageError("the solid is unbounded, which no grid can hold: intersect it with a box, "
                         "or with a bounded solid");
    if (settings.region && (settings.region->isEmpty() || !settings.region->min().allFinite() ||
                            !settings.region->max().allFinite()))
        throw UsageError("the region's corners are not finite, or not in order: give the lower "
                         "corner first");
}

/// Whether there is no surface. @throws InputError if there has to be one.
bool isEmpty(const Band& band, const SampleSettings& settings)
{
    if (band.hasZeroCrossing()) return false;
    if (!settings.mayBeEmpty && !settings.region)
        throw InputError("the surface encloses nothing at this voxel size: no voxel is inside. Use "
                         "smaller voxels, or, if points were fitted, check their normals");
    return true;
}

/// The blocks of @a region and @a margin voxels about it.
BlockBox blocksOf(const openvdb::CoordBBox& region, int margin)
{
    const auto block = [](int voxel) { return voxel >> 3; };
    BlockBox blocks;
    for (int axis = 0; axis < 3; ++axis) {
        blocks.first[axis] = block(region.min()[axis] - margin);
        blocks.last[axis] = block(region.max()[axis] + margin);
    }
    return blocks;
}

/// The cubes of @a zone's voxels, world units.
Box3d boxOf(const BlockBox& zone, const Lattice& lattice)
{
    const double h = lattice.voxelSize;
    const Vec3d half = Vec3d::Constant(0.5);
    const Vec3d first = (kBlockDim * zone.first).cast<double>() - half,
                last = (kBlockDim * (zone.last + Vec3i::Ones())).cast<double>() - half;
    return {lattice.origin + h * first, lattice.origin + h * last};
}

/// The box of the leaves of @a tree, and of what is inside without leaves.
openvdb::CoordBBox solidBox(const openvdb::FloatTree& tree)
{
    openvdb::CoordBBox box;
    tree.evalLeafBoundingBox(box);
    auto tile = tree.cbeginValueAll();
    tile.setMaxDepth(openvdb::FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile)
        if (*tile < 0) box.expand(tile.getBoundingBox());
    return box;
}

/// Let @a grid be outside beyond @a region. OpenVDB makes nodes all along the sides of the box that
/// it clips by: those beyond what there is are brought up to it.
void clipTo(openvdb::FloatGrid& grid, const openvdb::CoordBBox& region)
{
    openvdb::CoordBBox box = solidBox(grid.tree());
    if (box.empty() || region.isInside(box)) return;
    box.intersect(region);
    if (box.empty())
        grid.tree().clear();
    else
        grid.clip(box);
}

/// The part of @a whole in @a region; the rest is outside.
LevelSet cropped(const LevelSet& whole, const openvdb::CoordBBox& region)
{
    const openvdb::FloatGrid::Ptr grid = whole.grid().deepCopy();
    clipTo(*grid, region);
    return LevelSet(grid);
}

/// The closed band of @a field, with islands and handles off; of @a region (voxels; or null: all)
/// and a margin about it, which grows until the rest of the band decides nothing in the region.
std::unique_ptr<Band> closedBand(const Field& field, const SampleSettings& settings,
                                 const openvdb::CoordBBox* region, Interrupter& progress)
{
    const double h = settings.lattice.voxelSize;
    const auto widest = int(std::min(field.bounds().sizes().maxCoeff() / h, 1e6));
    const double halfWidth =
        field.isDistance() ? settings.halfWidth : kCrossingWidth * field.steepness();
    for (int margin = kRegionMargin + int(std::ceil(settings.halfWidth));; margin *= 2) {
        std::optional<Band::Zone> zone;
        if (region) zone = {blocksOf(*region, margin), blocksOf(*region, 0)};
        progress.beginStage("sample");
        auto band = std::make_unique<Band>(field, settings.lattice, halfWidth, settings.maxBytes,
                                           progress, zone);
        band->search(
            zone ? field.seedBlocksIn(settings.lattice, boxOf(zone->known, settings.lattice))
                 : field.seedBlocks(settings.lattice));
        if (zone) band->searchUnsupported();
        if (isEmpty(*band, settings)) return nullptr;
        progress.beginStage("close");
        band->resolveSigns();
        band->removeIslands();
        band->removeHandles();
        if (zone && !band->isCertain() && margin < widest) continue;
        if (isEmpty(*band, settings)) return nullptr;
        band->close();
        return band;
    }
}

/// What is restored for @a region: a block about it, so that the border of what is sampled, where
/// the band is cut, is not taken for one that lacks voxels.
openvdb::CoordBBox examinedAbout(const openvdb::CoordBBox& region)
{
    const BlockBox blocks = blocksOf(region, kBlockDim);
    const auto corner = [](const Vec3i& block) {
        return openvdb::Coord(kBlockDim * block[0], kBlockDim * block[1], kBlockDim * block[2]);
    };
    return {corner(blocks.first), corner(blocks.last)};
}

/// The level set of @a field in a band that is sampled as a whole. @param region  voxels; or null.
LevelSet sampleNarrow(const Field& field, const SampleSettings& settings,
                      const openvdb::CoordBBox* region, Interrupter& progress)
{
    const Lattice& lattice = settings.lattice;
    std::unique_ptr<Band> band = closedBand(field, settings, region, progress);
    if (!band) return emptyLevelSet(lattice, settings.halfWidth);
    progress.beginStage("assemble");
    const openvdb::FloatTree::Ptr tree = band->assemble();
    band.reset();
    if (field.isDistance()) {
        progress.beginStage("restore");
        if (field.isDistanceFar())
            completeBand(*tree, lattice.voxelSize, progress);
        else
            restoreDistance(*tree, lattice.voxelSize, ValuesFrom::Field, progress,
                            region ? examinedAbout(*region) : openvdb::CoordBBox::inf());
        pruneBand(*tree); // of leaves whose last voxels turned out to be beyond the band
    }
    auto grid = openvdb::FloatGrid::create(tree);
    setLattice(*grid, lattice);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.endStage();
    if (!field.isDistance()) {
        const LevelSet measured = redistance(*grid, settings.halfWidth, &progress);
        return region ? cropped(measured, *region) : measured;
    }
    if (region) clipTo(*grid, *region);
    return LevelSet(grid);
}

/// The same for wider bands, whose values are all measured from the zero set.
LevelSet sampleWide(const Field& field, const SampleSettings& settings, double sampledBand,
                    const openvdb::CoordBBox* region, Interrupter& progress)
{
    SampleSettings narrow = settings;
    narrow.halfWidth = sampledBand;
    openvdb::CoordBBox around;
    if (region) {
        around = *region;
        around.expand(int(std::ceil(settings.halfWidth)) + kStencil);
    }
    const LevelSet near = sampleNarrow(field, narrow, region ? &around : nullptr, progress);
    const LevelSet wide = redistance(near.grid(), settings.halfWidth, &progress);
    return region ? cropped(wide, *region) : wide;
}

} // namespace

openvdb::CoordBBox voxelsIn(const Box3d& region, const Lattice& lattice)
{
    constexpr double kMaxIndex = 1 << 23; ///< index of a voxel [derived: 2^20 blocks of 8]
    openvdb::CoordBBox voxels;
    for (int axis = 0; axis < 3; ++axis) {
        const auto index = [&](double x) {
            return std::clamp((x - lattice.origin[axis]) / lattice.voxelSize, -kMaxIndex,
                              kMaxIndex);
        };
        voxels.min()[axis] = int(std::ceil(index(region.min()[axis])));
        voxels.max()[axis] = int(std::floor(index(region.max()[axis])));
    }
    return voxels;
}

LevelSet sampleField(const Field& field, const SampleSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireValidSettings(field, settings);
    openvdb::CoordBBox region;
    if (settings.region) {
        region = voxelsIn(*settings.region, settings.lattice);
        if (region.empty()) return emptyLevelSet(settings.lattice, settings.halfWidth);
    }
    const openvdb::CoordBBox* const part = settings.region ? &region : nullptr;
    const double sampledBand = field.isDistanceFar() ? kMaxFarBand : kMaxNearBand;
    return field.isDistance() && settings.halfWidth > sampledBand
               ? sampleWide(field, settings, sampledBand, part, progress)
               : sampleNarrow(field, settings, part, progress);
}

} // namespace mpuvdb
