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

    class Search;

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

/// Distances from the voxels of one leaf of the origins, one after the other: the last one bounds
/// the next, for distances change no more than places do. For one thread.
class BallCentres::Search
{
public:
    Search(const BallCentres& centres, const openvdb::Coord& origin);

    /// To the nearest of the places; @a most, or the reach, if none is nearer. Where it is no more
    /// than @a enough, something between the two may be told instead.
    float distanceFrom(const openvdb::Coord& voxel, float most, float enough = 0);

private:
    struct Source {
        openvdb::Coord origin;
        const std::vector<Place>* places;
    };

    static float nearestIn(const Source& source, const openvdb::Coord& voxel, float best);

    float mReach;
    std::vector<Source> mSources; ///< the nearest first
    std::size_t mNearest = 0;     ///< of them, the last time
    openvdb::Coord mLast;
    float mLastDistance; ///< from there, or more
};

} // namespace mpuvdb
