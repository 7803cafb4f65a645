// How one voxel holds a set of voxels together. The set is connected through faces, what is not in
// it through faces, edges and corners: what the set shuts is shut however a mesh joins diagonals.
#pragma once
#include <cstdint>

namespace mpuvdb
{

/// A voxel and the 26 around it: bit 9 (dx + 1) + 3 (dy + 1) + (dz + 1) is on in the set.
using Neighborhood = std::uint32_t;

constexpr Neighborhood kCenter = 1u << 13;
/// The voxels that share a face with the center.
constexpr Neighborhood kFaceNeighbors =
    1u << 4 | 1u << 10 | 1u << 12 | 1u << 14 | 1u << 16 | 1u << 22;

/// Whether the set with the center and without it are the same to a topologist.
bool isSimple(Neighborhood around);

/// What the center adds to the Euler characteristic of the set (parts - handles + hollows).
int eulerChange(Neighborhood around);

} // namespace mpuvdb
