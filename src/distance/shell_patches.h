// The zero set as it looks from one side, for distances far from it.
#pragma once
#include "surface/surface_patches.h"

namespace mpuvdb
{

/// What the values one to two voxels off the zero set are.
enum class Sight {
    Distances,
    NoDistances, ///< such as beside edges the larger of two planes'
    TooNarrow    ///< the band, less than three voxels, to tell where the nearest places are
};

/// The values that @a tree has on @a side: 1 outside, -1 inside. @param voxelSize  world units.
/// @throws Interrupted.
Sight sightFrom(const openvdb::FloatTree& tree, double voxelSize, float side,
                Interrupter& progress);

/// Where @a patches of the zero set do not tell the distances that @a tree has on @a side, ridges
/// too blunt or too near to each other for facets, supersede them by patches that voxels of a shell
/// one to two voxels off are nearest to: good for distances farther off. @returns what it has seen;
/// nothing is changed if these are no distances. @throws LimitError, Interrupted.
Sight refineByShellProjection(SurfacePatches& patches, const openvdb::FloatTree& tree,
                              double voxelSize, float side, Interrupter& progress);

} // namespace mpuvdb
