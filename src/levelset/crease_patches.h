// Patches on creases and corners of a surface, where those of its smooth parts end.
#pragma once
#include "surface_patches.h"

namespace mpuvdb
{

/// Where the planes about a voxel beside a crease meet, and the values of @a tree are about zero,
/// add a patch to @a patches, which are the tree's: for most, a piece of an edge; where three
/// planes meet, a point. @throws Interrupted.
void addCreasePatches(SurfacePatches& patches, const openvdb::FloatTree& tree, Progress& progress);

} // namespace mpuvdb
