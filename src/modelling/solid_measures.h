// The band in which solids are measured.
#pragma once
#include "surface/surface_integrals.h"

namespace mpuvdb
{

/// @a levelSet in a band of at least kMeasuredHalfWidth voxels.
LevelSet measurable(const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
