// Signs of the voxels near a mesh.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"

#include <optional>

namespace mpuvdb
{

/// A way through the mesh's triangles that is wider than a voxel.
struct WayThrough {
    Vec3d at;      ///< relative to the mesh's frame
    double across; ///< voxels: the sum of the distances of two neighbors on its sides
};

/// Correct contradicting signs by winding numbers: neighbors whose distances sum to more than a
/// voxel have no triangle between them, and so the same sign. Voxels beside the seams of closed
/// holes get theirs first.
/// @param band  its active values are signed distances. @return the widest way through, if there is
/// one. @throws Interrupted.
std::optional<WayThrough> repairSigns(openvdb::FloatTree& band, const PlacedTriangles& triangles,
                                      const SolidBoundary& solid, Interrupter& progress);

} // namespace mpuvdb
