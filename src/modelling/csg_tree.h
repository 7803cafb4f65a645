// The Boolean of two level sets' trees, with distances about the creases.
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

/// The thickest part that a ball has removed for lack of room between opposed surfaces.
struct RemovedPart {
    float depth = 0; ///< of its deepest voxel, in voxels: a ball of that radius has room there
    openvdb::Coord deepest;
};

struct CsgTree {
    openvdb::FloatTree::Ptr tree;
    /// The voxels that a fillet changes. A leaf may come more than once.
    std::vector<LeafVoxels> filleted;
    std::vector<KnownVoxels> known; ///< for restoreDistance(), in order
    /// Whether parts of a fillet do not come from creases: measured, or filled as cavities.
    bool isUncertain = false;
    RemovedPart removed; ///< of an intersection or difference
};

/// The Boolean of two narrow bands on one lattice with equal backgrounds, not pruned. Where both
/// bands are active, values are distances to the rolling ball's fillet or, for @a radius 0, to the
/// crease, where that is nearest.
/// @param voxelSize, radius  world units.
/// @param halfWidth  voxels from the result's surface within which values are distances; a fillet
/// reads bands that are wider by its radius.
/// @throws Interrupted.
CsgTree csgTree(Boolean kind, const openvdb::FloatTree& a, const openvdb::FloatTree& b,
                double voxelSize, double halfWidth, double radius, Interrupter& progress);

} // namespace mpuvdb
