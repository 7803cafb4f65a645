// The thickness of a solid.
#pragma once
#include <mpuvdb/level_set.h>

#include <vector>

namespace mpuvdb
{

struct Thickness {
    double least = 0, mean = 0; ///< world units
};

/// For each of some places on the surface of @a levelSet the diameter, world units, of the largest
/// ball inside that touches the surface at the nearest of the crossings that measureThickness()
/// takes; 0 if there are none. @param levelSet, crossings  as for measureThickness().
/// @param places  world units. @throws Interrupted.
std::vector<float> thicknessAt(const LevelSet& levelSet, std::uint64_t crossings,
                               const std::vector<Vec3d>& places, Interrupter& progress);

/// The diameters of the largest balls inside @a levelSet that touch its surface, at its crossings
/// with edges between voxels, or at a part of them where there are many. Beside creases nothing is
/// measured. The least one is that of balls between walls that face each other, as balls shrink to
/// nothing along convex edges. The same for any number of threads.
/// @param levelSet  of a half-width of at least kMeasuredHalfWidth.
/// @param crossings  the number of those crossings.
/// @throws Interrupted.
Thickness measureThickness(const LevelSet& levelSet, std::uint64_t crossings,
                           Interrupter& progress);

} // namespace mpuvdb
