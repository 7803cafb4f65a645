// Integrals over the surface of a level set.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// Half-width of the band that measuring needs, voxels. [derived: a corner of a crossed cell is up
/// to sqrt(3) from the surface, and its neighbor one more]
constexpr double kMeasuredHalfWidth = 3;

struct SurfaceIntegrals {
    double volume = 0, area = 0;
    Box3d bounds;
    std::int64_t eulerCharacteristic = 0;
    std::uint64_t surfaces = 0;  ///< connected parts
    std::uint64_t crossings = 0; ///< of the zero set with edges between face neighbors

    double genus() const { return double(surfaces) - 0.5 * double(eulerCharacteristic); }
};

/// Integrate over the surface of @a levelSet, whose half-width is at least kMeasuredHalfWidth.
/// Counts are those of the mesh; for volume and area (world units) triangles
/// are projected to the surface of the second-order expansion, which leaves errors of third order.
/// The same for any number of threads. @throws Interrupted.
SurfaceIntegrals integrateSurface(const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
