// Digital topology of a voxel's neighborhood: the set is 6-connected, its complement 26-connected.
#pragma once
#include <cstdint>

namespace mpuvdb
{

/// A voxel and the 26 around it: bit 9 (dx + 1) + 3 (dy + 1) + (dz + 1) is set for those in the
/// set.
using Neighborhood = std::uint32_t;

constexpr Neighborhood kCenter = 1u << 13;           ///< mask of the voxel itself
constexpr Neighborhood kEverywhere = (1u << 27) - 1; ///< mask of all of them
/// Mask of the voxels that share a face with the center.
constexpr Neighborhood kFaceNeighbors =
    1u << 4 | 1u << 10 | 1u << 12 | 1u << 14 | 1u << 16 | 1u << 22;

/// Whether the center is simple: adding or removing it does not change the set's topology.
bool isSimple(Neighborhood around);

/// What the center adds to the Euler characteristic of the set (components - handles + cavities).
int eulerChange(Neighborhood around);

} // namespace mpuvdb
