// A level set held against the mesh that it was made of.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"
#include <mpuvdb/explained.h>

namespace mpuvdb
{

/// Compares them, and names what the voxel size does not explain. @throws Interrupted.
MeshExplained explainMesh(const SolidBoundary& solid, const PlacedTriangles& triangles,
                          const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
