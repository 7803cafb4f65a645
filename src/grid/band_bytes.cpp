#include "band_bytes.h"

#include <mpuvdb/field.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{

double offsetArea(double area, double distance)
{
    if (!(distance > 0) || !(area > 0)) return area;
    const double radii = std::sqrt(area) + std::sqrt(4 * M_PI) * distance;
    return radii * radii;
}

double distanceBytes(double area, double voxelSize)
{
    constexpr double kBytes = 370; // for a voxel's face of surface [tuned: plan_bench]
    return kBytes * area / (voxelSize * voxelSize);
}

double gridBytes(double area, double voxelSize, double halfWidth)
{
    constexpr double kBytesPerVoxel = 2200.0 / kBlockVoxels; // of a leaf [derived: its size]
    constexpr double kNodeBytes = 2.2e6; // [derived: eight upper nodes about the origin]
    constexpr double kLeafSlack = 6;     // voxels [tuned: plan_bench; about a leaf's half diagonal]
    const double faces = area / (voxelSize * voxelSize), width = halfWidth + kLeafSlack;
    // The volumes within the width of a ball of that area: outside of it, and inside at most all.
    const double outside =
        width * (faces + width * (std::sqrt(4 * M_PI * faces) + width * 4 * M_PI / 3));
    const double inside = std::min(faces * width, std::pow(faces, 1.5) / (6 * std::sqrt(M_PI)));
    return kBytesPerVoxel * (faces > 0 ? outside + inside : 0) + kNodeBytes;
}

} // namespace mpuvdb
