// Patches on creases and corners of a surface, where those of its smooth parts end.
#pragma once
#include "surface_patches.h"

namespace mpuvdb
{

/// Where the planes about a voxel beside a crease meet, add a patch to @a patches: for most, a
/// piece of an edge; where three planes meet, a point. @throws Interrupted.
void addCreasePatches(SurfacePatches& patches, Progress& progress);

} // namespace mpuvdb
