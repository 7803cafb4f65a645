// Signs of the voxels near a mesh.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"

namespace mpuvdb
{

/// Correct contradicting signs by winding numbers: neighbors whose distances sum to more than a
/// voxel have no triangle between them, and so the same sign.
/// @param band  its active values are signed distances.
/// @throws InputError if a hole is wider than a voxel, Interrupted.
void repairSigns(openvdb::FloatTree& band, const PlacedTriangles& triangles,
                 const SolidBoundary& solid, Interrupter& progress);

} // namespace mpuvdb
