// Which values of a band may be no distances, by a voxel and its neighbors, for eight in a row.
#pragma once
#include <array>
#include <cstddef>

namespace mpuvdb
{

/// Distances between neighbors by face, edge and corner, voxels. [derived: square roots of 1, 2, 3]
constexpr float kNeighborDistance[4] = {0, 1, 1.4142135f, 1.7320508f};
/// Depth inside the band, voxels, by a neighbor's value, from which on an inactive voxel is
/// examined. [tuned: sample_field_test]
constexpr float kMissingDepth = 0.3f;

/// Properties of eight voxels in a row: one bit each.
struct RowFlags {
    unsigned suspect = 0;       ///< active, and the value may be wrong
    unsigned flat = 0;          ///< the same, except at the tip of an edge
    unsigned cornerMissing = 0; ///< active, and the band lacks a corner neighbor
    unsigned missing = 0;       ///< inactive, and a neighbor's value puts it inside the band
    unsigned steep = 0;         ///< active, and values rise too fast on both sides
    std::array<float, 8> slope; ///< of steep voxels
};

/// The row's voxels that a neighbor's value puts well inside the band, a bit each.
/// @param row  the first of eight values in a LeafHalo, voxels. @param halfWidth  voxels.
unsigned missingInRow(const float* row, float halfWidth);

/// The flags of the row's voxels, as if all were active. Parameters as those of missingInRow().
/// @param minSlope  the smallest upwind gradient of a voxel that is not flat.
RowFlags examineRow(const float* row, float halfWidth, float minSlope);

/// The magnitude of a value, voxels, scaled down where values rise by @a slope per voxel. Its
/// neighbors are scaled alike, so that the surface stays in place.
float scaledDown(float value, float slope);

} // namespace mpuvdb
