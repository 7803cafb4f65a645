// Correction of fits for the bias of noise about a curved surface.
#pragma once
#include "mpu/octree/octree.h"

namespace mpuvdb
{

/// Least noise that is corrected for, in tolerances: the bias of less is below a voxel's precision.
/// [tuned: noise_bench]
constexpr double kMinBiasNoise = 2;

/// Remove the bias of noise from the fits of @a tree. Noise along the normals makes points sparse
/// outside of a curved surface and dense inside: a fit lies inside by about the sum of the
/// principal curvatures times the square of the noise. Noise along lines of sight has no such bias.
/// The points' mean offset from the fits per curvature is measured over the whole tree, and each
/// fit without an edge is moved by it times its curvature. The same for any number of threads.
/// @param noise  standard deviation of the points, world units, > 0.
void removeNoiseBias(Octree& tree, const SortedPoints& points, double noise);

} // namespace mpuvdb
