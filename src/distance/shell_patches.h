// Patches of the zero set by projection of a shell of voxels on one side, for distances far from
// it.
#pragma once
#include "surface/surface_patches.h"

namespace mpuvdb
{

/// Kind of the values one to two voxels from the zero set.
enum class ShellValues {
    Distances,
    NoDistances, ///< for example the maximum of two planes' distances beside an edge
    TooNarrow    ///< the band, less than three voxels, does not determine the nearest places
};

/// The kind of the values that @a tree has on @a side: 1 outside, -1 inside. @param voxelSize world
/// units. @throws Interrupted.
ShellValues shellValues(const openvdb::FloatTree& tree, double voxelSize, float side,
                        Interrupter& progress);

/// Supersede @a patches of the zero set whose distances differ from those of @a tree on @a side,
/// such as at ridges too blunt or too close for facets, by the projections of a shell of voxels one
/// to two voxels from the surface: suited to distances farther off. @returns the kind of the
/// values; unless they are distances nothing changes. @throws LimitError, Interrupted.
ShellValues refineByShellProjection(SurfacePatches& patches, const openvdb::FloatTree& tree,
                                    double voxelSize, float side, Interrupter& progress);

} // namespace mpuvdb
