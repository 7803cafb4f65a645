// The parts of open surfaces that lie outside of a solid.
#pragma once
#include "oriented_triangles.h"

namespace mpuvdb
{

class Interrupter;

/// Open surfaces, cut where they enter a solid.
struct OuterWalls {
    Mesh mesh;                              ///< what is outside
    std::vector<std::uint8_t> hasOutside;   ///< by triangle of the surfaces
    double areaOutside = 0, areaWithin = 0; ///< world units squared
};

/// Cut @a walls where they cross @a solid, to a voxel, and keep what is outside: where the winding
/// number of @a solid is at most 1/2. @throws Interrupted.
OuterWalls outerWalls(const Mesh& walls, const OrientedTriangles& solid, double voxelSize,
                      Interrupter& progress);

} // namespace mpuvdb
