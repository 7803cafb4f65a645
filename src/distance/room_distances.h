// Distances to the nearest possible center of a ball that lies outside one or two solids.
#pragma once
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A solid: @a scale turns its values into voxels; negative for the complement.
struct ScaledSolid {
    const openvdb::FloatTree& tree;
    float scale;
};

/// Distances of a leaf's voxels, in voxels: 0 where the center can be.
using RoomDistances = std::vector<float>;

/// The distances in the leaves at @a origins (in order), for a ball of @a radius voxels; at most
/// @a reach, voxels. The solids may be the same. Their bands extend outside by at least the radius
/// and a level set's half-width. @throws LimitError, Interrupted.
std::vector<RoomDistances> roomDistances(const ScaledSolid& a, const ScaledSolid& b, float radius,
                                         float reach, const std::vector<openvdb::Coord>& origins,
                                         Interrupter& progress);

} // namespace mpuvdb
