// The zero set as it looks from one side, for distances far from it.
#pragma once
#include "surface_patches.h"

namespace mpuvdb
{

/// Where @a patches of the zero set do not tell the distances that @a tree has on @a side (1
/// outside, -1 inside), ridges too blunt or too near to each other for facets, supersede them by
/// patches that voxels of a shell one to two voxels off are nearest to: good for distances farther
/// off. @returns whether they are good for that; else nothing is changed: the band is narrower than
/// three voxels or values are no distances, such as beside edges the larger of two planes'.
/// @param voxelSize  world units. @throws LimitError, Interrupted.
bool amendBySight(SurfacePatches& patches, const openvdb::FloatTree& tree, double voxelSize,
                  float side, Progress& progress);

} // namespace mpuvdb
