// Bands that are wider on one side than on the other.
#pragma once
#include "distance_front.h"
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// The tree of withHalfWidth(), with distances as far as @a reach (at least the band on both sides)
/// and the larger reach as background. @throws LimitError, Interrupted.
openvdb::FloatTree::ConstPtr treeReaching(const LevelSet& levelSet, const Reach& reach,
                                          Interrupter& progress);

} // namespace mpuvdb
