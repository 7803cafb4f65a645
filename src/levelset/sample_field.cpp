#include "band.h"
#include "restore_distance.h"
#include "transform_lattice.h"

#include <mpuvdb/error.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// How far from the zero set, in voxels, values of a field that is no distance are needed to find
/// the surface: all corners of a cell that it crosses.
constexpr double kCrossingWidth = 2;

void demandSettings(const Field& field, const SampleSettings& settings)
{
    demandVoxelSize(settings.lattice.voxelSize);
    if (!(settings.halfWidth >= 1.5 && settings.halfWidth <= 100))
        throw UsageError(
            fmt::format("half-width is {} voxels; it must be in [1.5, 100]", settings.halfWidth));
    const Box3d box = field.bounds();
    if (!box.isEmpty() && !(box.min().allFinite() && box.max().allFinite()))
        throw UsageError("the solid goes on without end, which no grid can hold: intersect it with "
                         "a box, or with a solid that ends");
}

/// Whether there is no surface. @throws InputError where there has to be one.
bool isEmpty(const Band& band, const SampleSettings& settings)
{
    if (band.hasZeroCrossing()) return false;
    if (!settings.mayBeEmpty)
        throw InputError("the surface encloses nothing at this voxel size: no voxel is inside. Use "
                         "smaller voxels, or, if points were fitted, check their normals");
    return true;
}

} // namespace

LevelSet sampleField(const Field& field, const SampleSettings& settings, Progress& progress)
{
    demandSettings(field, settings);
    const Lattice& lattice = settings.lattice;
    const bool isDistance = field.isDistance();
    progress.beginStage("sample");
    Band band(field, lattice, isDistance ? settings.halfWidth : kCrossingWidth * field.steepness(),
              settings.maxBytes, progress);
    band.search(field.seedBlocks(lattice));
    if (isEmpty(band, settings)) return emptyLevelSet(lattice, settings.halfWidth);
    progress.beginStage("close");
    band.resolveSigns();
    band.removeIslands();
    band.removeHandles();
    if (isEmpty(band, settings)) return emptyLevelSet(lattice, settings.halfWidth);
    band.close();
    progress.beginStage("assemble");
    const openvdb::FloatTree::Ptr tree = band.assemble();
    if (isDistance) {
        progress.beginStage("restore");
        restoreDistance(*tree, lattice.voxelSize, kBetween, progress);
    }
    auto grid = openvdb::FloatGrid::create(tree);
    setLattice(*grid, lattice);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.endStage();
    return isDistance ? LevelSet(grid) : redistance(*grid, settings.halfWidth, progress);
}

} // namespace mpuvdb
