// Blocks under surfaces that are seen from above.
#pragma once
#include <mpuvdb/triangle_mesh.h>
#include <mpuvdb/vec.h>

namespace mpuvdb
{

class Interrupter;

/// The block under an open surface that is seen from above, such as a terrain: walls from its outer
/// rims straight down to a flat base. Holes of the surface stay open, for voxelize() with repair,
/// and the base under them is closed. A surface that faces down as a whole is turned.
/// @param up  of any length but zero. @param depth  of the base below the surface's lowest vertex,
/// world units, > 0.
/// @return without attributes. @throws InputError (no triangles, not finite, without a rim or seen
/// from its side, so that nothing is below), UsageError (up, depth), Interrupted.
Mesh blockUnder(const Mesh& surface, const Vec3d& up, double depth,
                Interrupter* interrupter = nullptr);

} // namespace mpuvdb
