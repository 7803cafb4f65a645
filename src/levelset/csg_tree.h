// Two level sets' trees as one, with a distance about the creases.
#pragma once
#include "restore_distance.h"

#include <mpuvdb/operations.h>

#include <vector>

namespace mpuvdb
{

struct CsgTree {
    openvdb::FloatTree::Ptr tree;
    /// For restoreDistance(), in order.
    std::vector<KnownVoxels> known;
    /// Whether that has to look at all voxels instead, for a fillet may err.
    bool isFilletDoubtful = false;
};

/// The Boolean of two narrow bands on one lattice with backgrounds of the same size, not pruned.
/// Where both bands are: the distance to the rolling ball's fillet or, for @a radius 0, to the
/// crease, where that is nearest. @param voxelSize, radius  world units.
/// @throws Interrupted.
CsgTree csgTree(Boolean kind, const openvdb::FloatTree& a, const openvdb::FloatTree& b,
                double voxelSize, double radius, Progress& progress);

} // namespace mpuvdb
