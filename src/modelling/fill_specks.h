// Where a fillet's distances err.
#pragma once
#include <openvdb/openvdb.h>

#include <functional>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What a rolling ball has filled, and what is known of it.
struct Fill {
    std::vector<openvdb::Coord> voxels; ///< in any order, all with one sign
    std::size_t ball = 0;               ///< voxels that the ball holds
    /// Whether a voxel may be filled, and is nearer to both solids than the ball's radius; others
    /// stay as they are.
    std::function<bool(const openvdb::Coord&)> isBetween;
};

/// The fill covers the surfaces that it lies on, so it hangs together with the solids; and what it
/// leaves open, the ball has room in. Let voxels change sides that are not so, by the faces of
/// voxels: they are rounding, where surfaces run nearly parallel.
/// @return those. @throws Interrupted.
std::vector<openvdb::Coord> mendFill(openvdb::FloatTree& tree, Fill fill, Interrupter& progress);

} // namespace mpuvdb
