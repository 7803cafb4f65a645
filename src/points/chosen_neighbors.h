// Exact nearest neighbors of a few points chosen from a cloud of any size, in one pass over it.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
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
std::vector<Vec3f> choosePositions(const std::vector<Vec3f>& positions, std::size_t count,
                                   Interrupter& progress);

/// The @a k nearest other positions of every chosen one; fewer only where the cloud has not more.
/// A kd-tree over all points would take longer than all else that is done to them: a thinned
/// cloud bounds the balls that hold k neighbors, and one pass collects what lies in the balls.
std::vector<Neighborhood> nearestOfChosen(const PointCloud& cloud, const std::vector<Vec3f>& chosen,
                                          std::size_t k, Interrupter& progress);

} // namespace mpuvdb
