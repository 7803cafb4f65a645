// How wide a band may be.
#pragma once
#include <mpuvdb/vec.h>

namespace mpuvdb
{

/// Voxels: farther off no band goes, and none that operations take ends nearer.
constexpr double kWidestBand = 1000, kNarrowestBand = 1.5;

/// @throws UsageError unless kNarrowestBand <= @a halfWidth <= kWidestBand, voxels.
void demandHalfWidth(double halfWidth);

/// @throws UsageError unless @a radius (world units) is a number from 0 on.
void demandBlendRadius(double radius);

/// @throws LimitError unless bands that are @a radius (world units) wider than @a halfWidth
/// (voxels) can be made.
void demandBandForBlend(double radius, double voxelSize, double halfWidth);

/// @throws LimitError where the ball of a blend is larger than all that it rolls along, and than
/// 100 voxels: its bands would be the larger part of the work. @param solids  their box.
void demandBallForSolids(double radius, double voxelSize, const Box3d& solids);

} // namespace mpuvdb
