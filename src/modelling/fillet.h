// Fillets of the creases of a Boolean, as a ball that rolls along them leaves them.
#pragma once
#include "distance/restore_distance.h"

#include <mpuvdb/operations.h>

#include <vector>

namespace mpuvdb
{

/// What a fillet has done.
struct FilletReport {
    bool hasChanged = false;
    /// Leaves with new values that are no distances, in order.
    std::vector<KnownVoxels> suspects;
    /// Whether a ball of the radius does not fit into a hollow of one solid beside the other.
    bool isTooNarrow = false;
    /// The radius, in voxels, of the largest ball with room in a part that has gone because the
    /// fillet's ball has none between its opposed surfaces; and the voxel at its center.
    float removedRadius = 0;
    openvdb::Coord removed;
};

/// Close a union by a ball, or open an intersection or difference by it, as far as both solids
/// touch the ball. All other values stay, to the bit.
/// @param sharp  the Boolean of @a a and @a b; becomes the blend, not pruned.
/// @param halfWidth  of its band, voxels. @param voxelSize, radius  world units.
/// @throws LimitError, Interrupted.
FilletReport fillet(openvdb::FloatTree& sharp, Boolean kind, const openvdb::FloatTree& a,
                    const openvdb::FloatTree& b, double voxelSize, double halfWidth, double radius,
                    Interrupter& progress);

} // namespace mpuvdb
