// The Boolean of two level sets' trees, with distances about the creases.
#pragma once
#include "distance/restore_distance.h"

#include <mpuvdb/operations.h>

#include <vector>

namespace mpuvdb
{

struct CsgTree {
    openvdb::FloatTree::Ptr tree;
    std::vector<KnownVoxels> known; ///< for restoreDistance(), in order
};

/// The Boolean of two narrow bands on one lattice with equal backgrounds, not pruned. Where both
/// bands are active, values are distances to the crease, where that is nearest.
/// @param voxelSize  world units.
/// @param halfWidth  voxels from the result's surface within which values are distances.
/// @throws Interrupted.
CsgTree csgTree(Boolean kind, const openvdb::FloatTree& a, const openvdb::FloatTree& b,
                double voxelSize, double halfWidth, Interrupter& progress);

} // namespace mpuvdb
