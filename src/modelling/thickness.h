// How thick a solid is.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

struct Thickness {
    double least = 0, mean = 0; ///< world units
};

/// The diameters of the largest balls inside @a levelSet that touch its surface, at places spread
/// over it: where @a crossings of the surface with edges between voxels are more than can be looked
/// at in bounded time, at a part of them. Beside creases nothing is measured. The least one is that
/// of the balls held between walls that face each other, for along convex edges balls shrink to
/// nothing. The band has at least kMeasuredHalfWidth. The same for any number of threads.
/// @throws Interrupted.
Thickness measureThickness(const LevelSet& levelSet, std::uint64_t crossings,
                           Interrupter& progress);

} // namespace mpuvdb
