// Where patches end: at creases and corners of the surface.
#pragma once
#include "surface_patches.h"

namespace mpuvdb
{

class PatchIndex;

/// Which patches are not smooth, or are of a voxel with a neighbour whose patch is not.
std::vector<bool> besideCreases(const SurfacePatches& patches, const PatchIndex& index);

/// Let the @a patches @a beside a crease end where their faces meet, if the values of @a tree,
/// which they were made from, are about zero there; rough ones that lie on one of those become a
/// part of it. @throws Interrupted.
void endAtCreases(SurfacePatches& patches, const PatchIndex& index, const std::vector<bool>& beside,
                  const openvdb::FloatTree& tree, Progress& progress);

} // namespace mpuvdb
