// How far particles lie apart that fill a solid.
#pragma once
#include <mpuvdb/vec.h>

#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Spacing of particles whose balls have the volume that each takes, radii. [derived: cube root of
/// 4 pi / 3]
constexpr double kSpacingOfBall = 1.6119920;

/// The edge of the cube that each of the particles takes where they lie close, world units, or in a
/// layer or a row of them the distance from one to the next: the lower quartile over a thousand of
/// them, as those at the surface have fewer neighbors.
/// @throws InputError for fewer than two distinct positions, Interrupted.
double particleSpacing(const std::vector<Vec3f>& positions, Interrupter& progress);

} // namespace mpuvdb
