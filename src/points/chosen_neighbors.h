// Nearest neighbors of a few points chosen from a cloud of any size.
#pragma once
#include "spatial/point_index.h"

#include <mpuvdb/point_cloud.h>

#include <vector>

namespace mpuvdb
{

/// A point near a chosen one.
struct Neighbor {
    Vec3f position;
    Vec3f normal; ///< zero if the cloud has none
    double squaredDistance;
};

/// A chosen point and its neighbors.
struct Neighborhood {
    Vec3f center;
    Vec3f normal; ///< zero if the cloud has none
    /// Other positions, by (distance, x, y, z), without duplicates.
    std::vector<Neighbor> neighbors;
};

/// About @a count positions, all of them in a smaller cloud: those whose bits have the smallest
/// hash. Sorted by (x,y,z), without duplicates; the same for any order of the points.
std::vector<Vec3f> choosePositions(const PointIndex& index, std::size_t count,
                                   Interrupter& progress);

/// The @a k nearest other positions of every chosen one; fewer only where the index has no more.
/// @param index  of points of @a cloud.
std::vector<Neighborhood> nearestOfChosen(const PointCloud& cloud, const PointIndex& index,
                                          const std::vector<Vec3f>& chosen, std::size_t k,
                                          Interrupter& progress);

} // namespace mpuvdb
