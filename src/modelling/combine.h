// Booleans of level sets whose bands may be wider than the result's.
#pragma once
#include <mpuvdb/operations.h>

namespace mpuvdb
{

/// As combine(), in a band of @a halfWidth voxels; a fillet uses the inputs' values beyond it.
LevelSet combineInBand(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                       double halfWidth, Interrupter& progress);

} // namespace mpuvdb
