// The band in which solids are measured.
#pragma once
#include "surface/surface_integrals.h"

namespace mpuvdb
{

/// @a levelSet, in a wider band where it has less than kMeasuredHalfWidth.
LevelSet measurable(const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
