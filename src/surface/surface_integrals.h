// What can be summed over the surface of a level set.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// The band that measuring needs, voxels.
constexpr double kMeasuredHalfWidth = 3;

struct SurfaceIntegrals {
    double volume = 0, area = 0;
    Box3d bounds;
    std::int64_t eulerCharacteristic = 0;
    std::uint64_t surfaces = 0;  ///< connected parts
    std::uint64_t crossings = 0; ///< of the zero set with edges between voxels

    double genus() const { return double(surfaces) - 0.5 * double(eulerCharacteristic); }
};

/// Sum up the surface of @a levelSet, whose band has at least kMeasuredHalfWidth: the piecewise
/// linear one for what is counted; for volume and area each triangle is moved to where the second
/// derivatives put the surface, which leaves errors of third order and less. The same for any
/// number of threads. @throws Interrupted.
SurfaceIntegrals integrateSurface(const LevelSet& levelSet, Interrupter& progress);

} // namespace mpuvdb
