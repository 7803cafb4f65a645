// Which voxels near a mesh are inside.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"

namespace mpuvdb
{

/// Puts signs right that contradict each other: no triangle of the boundary passes between two
/// neighbors whose distances are more than a voxel together, and of a mesh with holes none that is
/// seen from both sides. Winding numbers decide.
/// @param band  active: the distances, signed.
/// @throws InputError where a hole wider than a voxel leaves no inside to tell, Interrupted.
void settleSigns(openvdb::FloatTree& band, const PlacedTriangles& triangles,
                 const SolidBoundary& solid, Interrupter& progress);

} // namespace mpuvdb
