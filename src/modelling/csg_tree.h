// Two level sets' trees as one, with a distance about the creases.
#pragma once
#include "distance/restore_distance.h"

#include <mpuvdb/operations.h>

#include <vector>

namespace mpuvdb
{

/// Voxels of one leaf.
struct LeafVoxels {
    openvdb::Coord origin;
    openvdb::FloatTree::LeafNodeType::NodeMaskType voxels;
};

/// What a ball has taken away for lack of room, between surfaces that run against each other.
struct TakenAway {
    float depth = 0; ///< of the deepest voxel, in voxels: a ball of that radius has room there
    openvdb::Coord deepest;
};

struct CsgTree {
    openvdb::FloatTree::Ptr tree;
    /// Of a fillet: those that are not as without it. A leaf may come more than once.
    std::vector<LeafVoxels> filleted;
    /// For restoreDistance(), in order.
    std::vector<KnownVoxels> known;
    /// Whether creases do not tell all of a fillet, or some of it was mended.
    bool isDoubtful = false;
    /// Of an intersection or difference.
    TakenAway taken;
};

/// The Boolean of two narrow bands on one lattice with backgrounds of the same size, not pruned.
/// Where both bands are: the distance to the rolling ball's fillet or, for @a radius 0, to the
/// crease, where that is nearest. @param voxelSize, radius  world units. @param halfWidth  voxels
/// from the result's surface within which that counts; a fillet reads bands that are wider by its
/// radius. @throws Interrupted.
CsgTree csgTree(Boolean kind, const openvdb::FloatTree& a, const openvdb::FloatTree& b,
                double voxelSize, double halfWidth, double radius, Interrupter& progress);

} // namespace mpuvdb
