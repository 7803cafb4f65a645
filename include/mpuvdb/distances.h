// Re-distancing and widening of level sets.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// The same surface with a band of @a halfWidth voxels: values in the old band stay unchanged, new
/// ones are distances (world units) to the surface. @param halfWidth  in [1.5, 1000].
/// @throws UsageError (half-width), LimitError (number of voxels beside the surface), Interrupted.
LevelSet withHalfWidth(const LevelSet& levelSet, double halfWidth,
                       Interrupter* interrupter = nullptr);

/// The level set of the zero set of @a grid, whose values have the right sign and cross zero
/// between active voxels, but need not be distances. The surface stays in place.
/// @param grid  satisfies LevelSet's constructor. @param halfWidth  voxels, in [1.5, 1000].
/// @throws UsageError (half-width), LimitError (number of voxels beside the surface), Interrupted.
LevelSet redistance(const openvdb::FloatGrid& grid, double halfWidth,
                    Interrupter* interrupter = nullptr);

} // namespace mpuvdb
