// A level set as a field that is a distance beyond its band, too.
#pragma once
#include <mpuvdb/fields.h>
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

class Interrupter;

/// Interpolation of @a levelSet within @a trusted voxels of the surface, and the distance to it
/// elsewhere: searched at each place, so that no band is made for a lattice of few voxels.
/// @param levelSet  not empty, with values that are distances. @throws Interrupted.
FieldPtr makeFarField(const LevelSet& levelSet, double trusted, Interrupter& progress);

} // namespace mpuvdb
