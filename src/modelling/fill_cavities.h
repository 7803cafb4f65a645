// Corrects single voxels of a fillet whose distances err.
#pragma once
#include <openvdb/openvdb.h>

#include <functional>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The voxels that a rolling ball has filled.
struct Fill {
    std::vector<openvdb::Coord> voxels; ///< in any order, all with one sign
    std::size_t ball = 0;               ///< volume of the ball, in voxels
    /// Whether a voxel may change: nearer to both solids than the ball's radius.
    std::function<bool(const openvdb::Coord&)> isBetween;
};

/// Changes the sides of filled voxels that are not connected to the solids, and of cavities where
/// the ball has no room, both by faces of voxels: they come from rounding between surfaces that are
/// nearly parallel.
/// @return the changed voxels. @throws Interrupted.
std::vector<openvdb::Coord> fillCavities(openvdb::FloatTree& tree, Fill fill,
                                         Interrupter& progress);

} // namespace mpuvdb
