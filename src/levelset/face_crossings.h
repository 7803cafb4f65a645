// Where faces of a surface cross the edges between voxels beside creases.
#pragma once
#include "crease_zone.h"

#include <optional>

namespace mpuvdb
{

/// Relative to the edge's first voxel.
struct FaceCrossing {
    Vec3f point = Vec3f::Zero();
    Vec3f normal = Vec3f::Zero(); ///< unit, outward; 0: not known
};

/// For one thread.
class FaceCrossings
{
public:
    explicit FaceCrossings(const CreaseZone& zone)
        : mPatches(zone.patches()), mNumbers(zone.index()), mValues(zone)
    {
    }

    /// Where the edge from @a voxel along @a axis, which crosses the surface, does so.
    FaceCrossing find(const openvdb::Coord& voxel, int axis);

    /// By how much @a place, relative to @a voxel, is nearer to some of the @a count voxels at
    /// @a around it than the values allow the surface to be; 0 for a place on the surface.
    float tooNear(const openvdb::Coord& voxel, const Vec3f& place, float slope,
                  const openvdb::Coord* around, int count) const;
    const CreaseValues& values() const { return mValues; }

private:
    struct Candidate {
        float at;    ///< from inside to outside
        float aside; ///< of the patch's foot
        Vec3f foot, point, normal;
    };
    std::optional<Candidate> candidate(const openvdb::Coord& voxel, int axis, bool rising,
                                       const SurfacePatch& patch) const;
    FaceCrossing interpolated(const openvdb::Coord& voxel, int axis) const;
    void collect(const openvdb::Coord& voxel, int axis, bool rising);

    const SurfacePatches& mPatches;
    VoxelNumbers mNumbers;
    CreaseValues mValues;
    std::vector<Candidate> mCandidates;
};

} // namespace mpuvdb
