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

} // namespace mpuvdb
