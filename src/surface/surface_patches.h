// The zero set of a level set as small curved patches, one for each voxel beside it, and as flat
// facets beside creases.
#pragma once
#include "surface_patch.h"

namespace mpuvdb
{

/// The patches of some of a tree's leaves.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree,
                              std::vector<const SurfacePatches::Leaf*> leaves, double voxelSize,
                              Values values, Interrupter& progress);

/// The patches of @a tree. @param voxelSize  world units. @throws LimitError, Interrupted.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree, double voxelSize, Values values,
                              Interrupter& progress);

} // namespace mpuvdb
