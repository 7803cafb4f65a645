// Crossings of a surface's faces with the edges between voxels beside creases.
#pragma once
#include "crease_zone.h"

#include <algorithm>
#include <array>
#include <optional>

namespace mpuvdb
{

/// A crossing relative to the edge's first voxel, voxels.
struct FaceCrossing {
    Vec3f point = Vec3f::Zero();
    Vec3f normal = Vec3f::Zero(); ///< unit, outward; 0: unknown
};

/// Balls about voxels that by the voxels' values hold no surface.
class EmptyBalls
{
public:
    /// @param slope  upper bound of the values' slope, per voxel. @param allowance  reduction of
    /// the radii, voxels.
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

/// Finds crossings. For one thread.
class FaceCrossings
{
public:
    explicit FaceCrossings(const CreaseZone& zone)
        : mPatches(zone.patches()), mNumbers(zone.index()), mValues(zone)
    {
    }

    /// The crossing of the edge from @a voxel along @a axis, whose ends differ in sign.
    FaceCrossing find(const openvdb::Coord& voxel, int axis);

private:
    struct Candidate {
        float at;    ///< place along the edge, from inside to outside
        float aside; ///< distance from the patch's foot along its plane, voxels
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
