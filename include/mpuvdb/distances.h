// Distances made anew where values are not, or where the band is too narrow.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// The same surface with a band of @a halfWidth voxels, in [1.5, 1000]: values that are there stay
/// as they are, new ones are distances to the nearest place on the surface.
LevelSet withHalfWidth(const LevelSet& levelSet, double halfWidth,
                       Interrupter* interrupter = nullptr);

/// The level set of the zero set of @a grid, whose values have the right sign and cross zero
/// between active voxels, but are no distances: the surface stays where it is. @a grid satisfies
/// what LevelSet demands of it. @param halfWidth  voxels, in [1.5, 1000].
LevelSet redistance(const openvdb::FloatGrid& grid, double halfWidth,
                    Interrupter* interrupter = nullptr);

} // namespace mpuvdb
