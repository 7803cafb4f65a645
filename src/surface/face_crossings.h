// Where faces of a surface cross the edges between voxels beside creases.
#pragma once
#include "crease_zone.h"

#include <algorithm>
#include <array>
#include <optional>

namespace mpuvdb
{

/// Relative to the edge's first voxel.
struct FaceCrossing {
    Vec3f point = Vec3f::Zero();
    Vec3f normal = Vec3f::Zero(); ///< unit, outward; 0: not known
};

/// Balls about voxels that the surface cannot reach into, by their values.
class EmptyBalls
{
public:
    /// @param slope  by which the values rise, at most. @param allowance  by which the balls are
    /// smaller than the values say, voxels.
    EmptyBalls(float slope, float allowance)
        : mScale(1 / std::max(slope, 1e-6f)), mAllowance(allowance)
    {
    }
    void add(const openvdb::Coord& voxel, float value)
    {
        const float radius = std::max(std::abs(value) * mScale - mAllowance, 0.0f);
        if (radius == 0) return;
        mBalls[mCount++] = {float(voxel[0]), float(voxel[1]), float(voxel[2]), radius * radius};
    }
    bool contain(const Vec3f& place) const
    {
        for (std::size_t n = 0; n < mCount; ++n) {
            const Ball& b = mBalls[n];
            const float x = b.x - place.x(), y = b.y - place.y(), z = b.z - place.z();
            if (x * x + y * y + z * z < b.radius2) return true;
        }
        return false;
    }

private:
    struct Ball {
        float x, y, z, radius2;
    };
    std::array<Ball, 18> mBalls; ///< as many as there are voxels of the cells about an edge
    std::size_t mCount = 0;
    float mScale, mAllowance;
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
