// Subdivision of a triangle along segments.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <vector>

namespace mpuvdb
{

using Vec2d = Eigen::Vector2d;
using PlanePolygon = std::vector<Vec2d>; ///< convex, counter-clockwise
using PlaneSegment = std::array<Vec2d, 2>;

/// Convex pieces of @a polygon that no segment crosses, by binary space partition. Segments and
/// parts shorter or thinner than @a point (length) are not cut.
std::vector<PlanePolygon> cutAlong(PlanePolygon polygon, std::vector<PlaneSegment> segments,
                                   double point);

} // namespace mpuvdb
