// Booleans of level sets whose bands are wider than the result's is to be.
#pragma once
#include <mpuvdb/operations.h>

namespace mpuvdb
{

/// As combine(), in a band of @a halfWidth voxels. What the inputs know beyond it, a fillet uses.
LevelSet combineInBand(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                       double halfWidth, Interrupter& progress);

} // namespace mpuvdb
