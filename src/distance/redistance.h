// Bands that are wider on one side.
#pragma once
#include "distance_front.h"
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// As withHalfWidth(), with distances as far as @a reach (not less than the band), and the wider
/// side's as background. @throws Interrupted.
openvdb::FloatTree::ConstPtr treeReaching(const LevelSet& levelSet, const Reach& reach,
                                          Interrupter& progress);

} // namespace mpuvdb
