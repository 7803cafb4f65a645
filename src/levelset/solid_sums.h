// The volume and the area of a level set's solid, in one quick pass.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

struct SolidSums {
    double volume = 0, area = 0; ///< world units cubed, squared
};

/// Sums of what each voxel has of them, of which the surface's place between voxels is taken from
/// their distances; second order where these are true, and blind to what passes between voxels.
/// The same for any number of threads. @throws Interrupted.
SolidSums sumSolid(const LevelSet& levelSet, Progress& progress);

} // namespace mpuvdb
