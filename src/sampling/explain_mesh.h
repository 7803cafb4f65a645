// Comparison of a level set with the mesh that it was made from.
#pragma once
#include "distance/triangle_band.h"
#include "solid_boundary.h"
#include <mpuvdb/explained.h>

namespace mpuvdb
{

/// Compare them; findings are the deviations that the voxel size does not explain.
/// @throws Interrupted.
MeshExplained explainMesh(const SolidBoundary& solid, const PlacedTriangles& triangles,
                          const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
