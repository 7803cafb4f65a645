// The box of a level set's solid.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// Box of the solid, world units, by the distances of the active voxels; empty without any. It is
/// exact where a face lies along its side. At corners it is too small by up to an eighth of a
/// voxel, in bands of three voxels; more in narrower ones.
Box3d solidBounds(const LevelSet& levelSet);

} // namespace mpuvdb
