// The box of a level set's solid.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// Box of the solid, world units, by the distances of the active voxels: exact where faces or
/// smooth extrema are near a voxel's line across the side, and up to an eighth of a voxel too small
/// at corners. Empty without active voxels.
Box3d solidBounds(const LevelSet& levelSet);

} // namespace mpuvdb
