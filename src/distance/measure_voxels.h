// Distances of single voxels of a band, measured from its zero set.
#pragma once
#include "restore_distance.h"

namespace mpuvdb
{

/// Set the unplaced voxels of @a tree (a narrow band, closed, with the right signs) to the distance
/// to its zero set's patches (surface_patches.h); beyond the band they become inactive. So are
/// placed voxels in their leaves whose values are less than their distance: where solids touch,
/// creases may be spurious. Measured voxels count as exact.
/// @param voxelSize  world units. @param known  leaves of the tree by origin, in order.
/// @throws LimitError, Interrupted.
void measureUnplaced(openvdb::FloatTree& tree, double voxelSize, std::vector<KnownVoxels>& known,
                     Interrupter& progress);

} // namespace mpuvdb
