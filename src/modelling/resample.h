// What resampling takes of a level set.
#pragma once
#include <mpuvdb/field.h>

namespace mpuvdb
{

/// Memory that resampling takes on its way, in grids like the one that it makes: measured, 1.5 to
/// 3, for its arrays double where they are full.
constexpr double kResamplingGrids = 3;

/// Half-width, in voxels of @a from, that a level set needs so that its surface is found on @a to
/// in a band of @a halfWidth voxels of that.
double widthToResample(const Lattice& from, const Lattice& to, double halfWidth);

} // namespace mpuvdb
