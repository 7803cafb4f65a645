// Signs of the voxels near a mesh.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"

namespace mpuvdb
{

/// Correct contradicting signs by winding numbers: neighbors whose distances sum to more than a
/// voxel have no triangle between them, and so the same sign.
/// Voxels beside the seams of closed holes get theirs first.
/// @param band  its active values are signed distances.
/// @throws InputError if a hole is wider than a voxel and none was closed, Interrupted.
void repairSigns(openvdb::FloatTree& band, const PlacedTriangles& triangles,
                 const SolidBoundary& solid, Interrupter& progress);

} // namespace mpuvdb
