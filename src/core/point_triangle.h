// The distance from a point to a triangle.
#pragma once
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>
#include <limits>

namespace mpuvdb
{

/// Squared distance from @a p to the segment from @a a to @a b.
template <typename T>
T squaredDistance(const Eigen::Matrix<T, 3, 1>& p, const Eigen::Matrix<T, 3, 1>& a,
                  const Eigen::Matrix<T, 3, 1>& b)
{
    const Eigen::Matrix<T, 3, 1> along = b - a;
    const T square = along.squaredNorm();
    const T t = square > 0 ? std::clamp((p - a).dot(along) / square, T(0), T(1)) : 0;
    return (a + t * along - p).squaredNorm();
}

/// Squared distance from @a p to a triangle.
template <typename T>
T squaredDistance(const Eigen::Matrix<T, 3, 1>& p,
                  const std::array<Eigen::Matrix<T, 3, 1>, 3>& triangle)
{
    const auto& [a, b, c] = triangle;
    const Eigen::Matrix<T, 3, 1> u = b - a, v = c - a, normal = u.cross(v);
    const T square = normal.squaredNorm();
    // Of a sliver, rounding leaves no plane, but its edges.
    const bool flat =
        square > std::numeric_limits<T>::epsilon() * u.squaredNorm() * v.squaredNorm();
    if (flat && normal.cross(u).dot(p - a) >= 0 && normal.cross(c - b).dot(p - b) >= 0 &&
        normal.cross(a - c).dot(p - c) >= 0) {
        const T height = normal.dot(p - a);
        return height * height / square;
    }
    return std::min({squaredDistance(p, a, b), squaredDistance(p, b, c), squaredDistance(p, c, a)});
}

} // namespace mpuvdb
