// Distances of some of a band's voxels, measured from its zero set.
#pragma once
#include "restore_distance.h"

namespace mpuvdb
{

/// Give the voxels of @a tree (a narrow band, closed, signs right) that are not placed the distance
/// to its zero set, as patches and facets tell it (surface_patches.h); beyond the band they become
/// inactive. So do placed voxels about them that have no surface as near as their values say: where
/// solids touch, what looks like a crease may be none. Voxels that were measured count as exact.
/// @param voxelSize  world units. @param known  leaves of the tree by origin, in order.
/// @throws LimitError, Interrupted.
void measureUnplaced(openvdb::FloatTree& tree, double voxelSize, std::vector<KnownVoxels>& known,
                     Interrupter& progress);

} // namespace mpuvdb
