// Where the centre of a ball can be that touches neither of two solids, or one from outside.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class Progress;

/// The boundary of the places where the ball has room: where it crosses the edges between voxels,
/// and how it lies there. Lengths in voxels.
class BallCentres
{
public:
    /// One of the solids: @a scale makes voxels of its values; negative for the complement.
    struct Solid {
        const openvdb::FloatTree& tree;
        float scale;
    };

    /// Look within @a reach of the leaves at @a origins, as far as the solids' bands go there.
    /// @throws Interrupted.
    BallCentres(const Solid& a, const Solid& b, float radius, float reach,
                const std::vector<openvdb::Coord>& origins, Progress& progress);

    /// From a voxel of the leaves to the nearest of the places; the reach if none is nearer.
    float distanceFrom(const openvdb::Coord& voxel) const;

private:
    struct Place {
        Vec3f point;  ///< relative to the leaf's origin
        Vec3f normal; ///< unit; 0: not known
    };
    class Reader;

    float mReach;
    std::vector<openvdb::Coord> mAround; ///< of a leaf, the nearest first
    std::unordered_map<openvdb::Coord, std::vector<Place>> mPlaces; ///< by leaf origin
};

} // namespace mpuvdb
