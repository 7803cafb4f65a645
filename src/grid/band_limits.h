// Limits of half-widths and blend radii.
#pragma once
#include <mpuvdb/vec.h>

namespace mpuvdb
{

/// Largest half-width of a band, voxels: beyond it a request is taken for a mistake of units.
/// [tuned: redistance_test]
constexpr double kMaxHalfWidth = 1000;
/// Smallest half-width, voxels: a voxel beside the surface and its face neighbors lie in the band.
/// [derived: half an edge that the surface crosses in its middle, and a neighbor one voxel on]
constexpr double kMinHalfWidth = 1.5;

/// @throws UsageError unless kMinHalfWidth <= @a halfWidth <= kMaxHalfWidth, voxels.
void requireHalfWidth(double halfWidth);

/// @throws UsageError unless @a radius (world units) is finite and at least 0.
void requireBlendRadius(double radius);

/// @throws LimitError if a band @a radius (world units) wider than @a halfWidth (voxels) exceeds
/// kMaxHalfWidth.
void requireBandForBlend(double radius, double voxelSize, double halfWidth);

/// @throws LimitError if the ball of a blend is larger than the solids' box @a solids and than 100
/// voxels: its bands would be most of the work.
void requireBallForSolids(double radius, double voxelSize, const Box3d& solids);

} // namespace mpuvdb
