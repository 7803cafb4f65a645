#include "band.h"
#include "restore_distance.h"
#include "transform_lattice.h"

#include <mpuvdb/error.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>

namespace mpuvdb
{

LevelSet sampleField(const Field& field, const SampleSettings& settings, Progress& progress)
{
    const Lattice& lattice = settings.lattice;
    demandVoxelSize(lattice.voxelSize);
    if (!(settings.halfWidth >= 1.5 && settings.halfWidth <= 100))
        throw UsageError(
            fmt::format("half-width is {} voxels; it must be in [1.5, 100]", settings.halfWidth));
    progress.beginStage("sample");
    Band band(field, lattice, settings.halfWidth, settings.maxBytes, progress);
    band.search(field.seedBlocks(lattice));
    const auto demandInside = [&band] {
        if (!band.hasZeroCrossing())
            throw InputError("the points enclose nothing at this voxel size: the fitted surface "
                             "has no inside. Use smaller voxels, or check the normals");
    };
    demandInside();
    progress.beginStage("close");
    band.resolveSigns();
    band.removeIslands();
    band.removeHandles();
    demandInside();
    band.close();
    progress.beginStage("assemble");
    const openvdb::FloatTree::Ptr tree = band.assemble();
    progress.beginStage("restore");
    restoreDistance(*tree, lattice.voxelSize, progress);
    auto grid = openvdb::FloatGrid::create(tree);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(lattice.voxelSize));
    const Vec3d& o = lattice.origin;
    if (o != Vec3d::Zero()) grid->transform().postTranslate({o[0], o[1], o[2]});
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.endStage();
    return LevelSet(grid);
}

} // namespace mpuvdb
