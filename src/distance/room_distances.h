// How far it is to the nearest place where a ball that touches neither of two solids, or one from
// outside, can have its center.
#pragma once
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// One solid: @a scale makes voxels of its values; negative for the complement.
struct ScaledSolid {
    const openvdb::FloatTree& tree;
    float scale;
};

/// By voxel of a leaf, in voxels: 0 where the center can be.
using RoomDistances = std::vector<float>;

/// The distances in the leaves at @a origins (in order), for a ball of @a radius voxels; @a reach
/// where nothing is nearer. The solids may be one and the same. Bands of them have to reach as far
/// outside as the radius and the band of a level set. @throws LimitError, Interrupted.
std::vector<RoomDistances> roomDistances(const ScaledSolid& a, const ScaledSolid& b, float radius,
                                         float reach, const std::vector<openvdb::Coord>& origins,
                                         Interrupter& progress);

} // namespace mpuvdb
