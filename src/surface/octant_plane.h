// The plane that the values about a voxel are distances to.
#pragma once
#include <mpuvdb/vec.h>

#include <array>

namespace mpuvdb
{

/// The plane through a voxel's nearest place on the surface, from the values in one octant.
struct OctantPlane {
    Vec3f normal = Vec3f::Zero(); ///< unit; 0: the values are alike
    float distance = 0;           ///< signed, from the voxel, voxels times the steepness
    float steepness = 1;          ///< slope of the values, at least 1
    float error = 0;              ///< largest error of the values it predicts, voxels

    /// From 1 for an exact plane to 0.
    float weight() const;
};

/// The plane of the octant about a voxel whose values are nearest to the distance to a plane:
/// creases, and other walls, lie in others.
/// @param value  of the voxel, among those of its 26 neighbors. @param stride  steps from a value
/// to the next along x, y, z. @param scale  of values to voxels.
OctantPlane octantPlane(const float* value, const std::array<int, 3>& stride, float scale);

/// Where an edge between two voxels crosses the surface, by the plane of one of its ends.
struct PlaneCrossing {
    const OctantPlane* plane; ///< null: neither plane crosses the edge's line outward
    float at;                 ///< along the edge, voxels from the inner end
};

/// The crossing of the edge along the unit vector @a along by the planes of its @a inner and
/// @a outer end: the one that is met first from inside if the surface is convex there, else the
/// last.
PlaneCrossing crossingByPlanes(const OctantPlane& inner, const OctantPlane& outer,
                               const Vec3f& along);

/// That of a tree's voxel @a at, by an accessor to it.
template <typename Access, typename Coord>
OctantPlane octantPlaneAt(const Access& access, const Coord& at, float scale)
{
    std::array<float, 27> around;
    for (int n = 0; n < 27; ++n)
        around[std::size_t(n)] = access.getValue(at.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
    return octantPlane(&around[13], std::array<int, 3>{9, 3, 1}, scale);
}

} // namespace mpuvdb
