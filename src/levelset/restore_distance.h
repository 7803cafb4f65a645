// Makes a closed band a true distance again, only where it is none.
#pragma once
#include <openvdb/openvdb.h>

#include <cstdint>

namespace mpuvdb
{

class Progress;

/// Find voxels of @a tree (a narrow band, closed, signs right) whose upwind gradient is not about
/// 1, which jump from a neighbour, or which the band misses; give each the distance to the nearest
/// crossing of the zero set with an edge between voxels. All other values, and where the zero set
/// crosses, stay as they are. Returns the number of voxels changed.
/// @param voxelSize  world units. @param below  by how many voxels a value may be less than that
/// distance and stay, which overestimates by half a voxel between crossings (kBetween) and by up to
/// one beyond the tips of creases (kTips: for values that know where these are).
std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize, float below,
                              Progress& progress);

constexpr float kBetween = 0.35f, kTips = 0.95f;

} // namespace mpuvdb
