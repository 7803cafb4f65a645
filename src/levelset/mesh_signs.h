// Which voxels near a mesh are inside.
#pragma once
#include "triangle_band.h"

namespace mpuvdb
{

/// Turns distances to a mesh into signed ones, negative inside.
/// @param band  active: the exact distances. @param guess  has the right sign nearly everywhere;
/// what is wrong is found where neighbours of two signs have no triangle between them, and beside
/// the mesh by the way that it faces.
void signDistances(openvdb::FloatTree& band, const openvdb::FloatTree& guess,
                   const PlacedTriangles& triangles);

} // namespace mpuvdb
