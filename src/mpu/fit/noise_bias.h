// Noise about a curved surface moves the fits to it.
#pragma once
#include "mpu/octree/octree.h"

namespace mpuvdb
{

/// Least noise, in tolerances, that moves a surface by what voxels can tell.
constexpr double kMinBiasNoise = 2;

/// Points thrown along the normals off a curved surface spread out on its outside and crowd on its
/// inside: any window across it holds more of these, and a fit lies inside by about the sum of the
/// principal curvatures times the square of the noise. Noise along lines of sight does no such
/// thing. So the points are asked: each counted once, their mean offset from the fits per curvature
/// is found over the whole @a tree, and each fit without an edge is moved by its curvature's share.
/// The same for any number of threads.
/// @param noise  standard deviation of the points, world units, > 0.
void removeNoiseBias(Octree& tree, const SortedPoints& points, double noise);

} // namespace mpuvdb
