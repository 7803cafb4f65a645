#include "evaluation.h"

#include "bindings.h"

#include <mpuvdb/error.h>
#include <mpuvdb/memory.h>

namespace mpuvdb::python
{

ShapeSettings settingsFor(const Shape& shape, const VoxelSize& voxelSize, double halfWidth,
                          const MaxBytes& maxBytes)
{
    ShapeSettings settings;
    settings.voxelSize = voxelSize ? worldLength(*voxelSize, {shape.bounds()}) : shape.voxelSize();
    if (!voxelSize && !(settings.voxelSize > 0))
        throw UsageError("a shape without level sets has no voxel size of its own: give "
                         "voxel_size, in world units or as '1%' of the diagonal");
    settings.halfWidth = halfWidth;
    settings.maxBytes = maxBytes ? *maxBytes : defaultMemoryLimit();
    return settings;
}

ShapeSettings settingsToWork(const Shape& shape, const VoxelSize& voxelSize, double halfWidth,
                             const MaxBytes& maxBytes)
{
    const ShapeSettings settings = settingsFor(shape, voxelSize, halfWidth, maxBytes);
    if (!voxelSize) shape.requireFewVoxels(settings);
    return settings;
}

LevelSet evaluated(const Shape& shape, const ShapeSettings& settings, Interrupter& progress)
{
    LevelSet made = shape.evaluate(settings, &progress);
    noteIfEmpty(made, progress);
    return made;
}

} // namespace mpuvdb::python
