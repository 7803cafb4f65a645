// The distance from a point to a triangle.
#pragma once
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>

namespace mpuvdb
{

/// Squared distance from @a p to the segment from @a a to @a b.
inline double squaredDistance(const Vec3d& p, const Vec3d& a, const Vec3d& b)
{
    const Vec3d along = b - a;
    const double square = along.squaredNorm();
    const double t = square > 0 ? std::clamp((p - a).dot(along) / square, 0.0, 1.0) : 0;
    return (a + t * along - p).squaredNorm();
}

/// Squared distance from @a p to a triangle.
inline double squaredDistance(const Vec3d& p, const std::array<Vec3d, 3>& triangle)
{
    const auto& [a, b, c] = triangle;
    const Vec3d normal = (b - a).cross(c - a);
    const bool above = normal.cross(b - a).dot(p - a) >= 0 && normal.cross(c - b).dot(p - b) >= 0 &&
                       normal.cross(a - c).dot(p - c) >= 0;
    const double square = normal.squaredNorm();
    if (above && square > 0) {
        const double height = normal.dot(p - a);
        return height * height / square;
    }
    return std::min({squaredDistance(p, a, b), squaredDistance(p, b, c), squaredDistance(p, c, a)});
}

} // namespace mpuvdb
