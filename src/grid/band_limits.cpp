#include "band_limits.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{

void requireHalfWidth(double halfWidth)
{
    if (!(halfWidth >= kMinHalfWidth && halfWidth <= kMaxHalfWidth))
        throw UsageError(fmt::format("half-width is {:.6g} voxels; it must be in [{}, {}], and "
                                     "most tools for level sets expect 3",
                                     halfWidth, kMinHalfWidth, kMaxHalfWidth));
}

void requireBlendRadius(double radius)
{
    if (!(radius >= 0) || !std::isfinite(radius))
        throw UsageError(
            fmt::format("blend radius is {:.6g}; it must be a length in world units, 0 for sharp "
                        "creases",
                        radius));
}

void requireBandForBlend(double radius, double voxelSize, double halfWidth)
{
    const double most = kMaxHalfWidth - halfWidth; // voxels
    if (radius <= most * voxelSize) return;
    throw LimitError(fmt::format(
        "blend radius {:.6g} is {:.4g} voxels of {:.6g}, and a fillet takes no more than {:.4g}: "
        "blend with a radius of at most {:.6g}, or use larger voxels",
        radius, radius / voxelSize, voxelSize, most, most * voxelSize));
}

void requireBallForSolids(double radius, double voxelSize, const Box3d& solids)
{
    constexpr double kMinLimit = 100; ///< limit for small solids, voxels [tuned: combine_test]
    if (solids.isEmpty()) return;
    const double across = solids.sizes().norm(), most = std::max(across, kMinLimit * voxelSize);
    if (!(radius > most)) return;
    throw LimitError(fmt::format(
        "blend radius {:.6g} ({:.4g} voxels) is larger than the solids together, which are {:.6g} "
        "across: blend with a radius of at most {:.6g}, or use larger voxels",
        radius, radius / voxelSize, across, most));
}

} // namespace mpuvdb
