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
    constexpr double kBytes = 370; // where a voxel's face of the surface is
    return kBytes * area / (voxelSize * voxelSize);
}

double gridBytes(double area, double voxelSize, double halfWidth)
{
    constexpr double kBytesPerVoxel = 2200.0 / kBlockVoxels; // of a leaf
    constexpr double kNodeBytes = 2.2e6; // eight of OpenVDB's upper nodes, about the origin
    constexpr double kLeafSlack = 6;     // a leaf is touched from its half diagonal off
    const double faces = area / (voxelSize * voxelSize), width = halfWidth + kLeafSlack;
    // What lies within the width of a ball: outside of it, and inside, where it has an end.
    const double outside =
        width * (faces + width * (std::sqrt(4 * M_PI * faces) + width * 4 * M_PI / 3));
    const double inside = std::min(faces * width, std::pow(faces, 1.5) / (6 * std::sqrt(M_PI)));
    return kBytesPerVoxel * (faces > 0 ? outside + inside : 0) + kNodeBytes;
}

} // namespace mpuvdb
