// Comparison of a level set with the mesh that it was made from.
#pragma once
#include "solid_boundary.h"
#include <mpuvdb/explained.h>

namespace mpuvdb
{

/// Compare them; findings are the deviations that the voxel size does not explain.
/// @param shift  of voxel (0,0,0) from the mesh's frame. @throws Interrupted.
MeshExplained explainMesh(const SolidBoundary& solid, const Vec3d& shift, const LevelSet& levelSet,
                          Interrupter& progress);

} // namespace mpuvdb
