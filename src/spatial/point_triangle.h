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
    using Vec = Eigen::Matrix<T, 3, 1>;
    const auto& [a, b, c] = triangle;
    const Vec u = b - a, v = c - a, fromA = p - a, normal = u.cross(v);
    const T square = normal.squaredNorm();
    if (!(square > std::numeric_limits<T>::epsilon() * u.squaredNorm() * v.squaredNorm()))
        // Of a sliver, rounding leaves no plane, but its sides.
        return std::min(
            {squaredDistance(p, a, b), squaredDistance(p, b, c), squaredDistance(p, c, a)});
    const T au = u.dot(fromA), av = v.dot(fromA);
    if (au <= 0 && av <= 0) return fromA.squaredNorm();
    const Vec fromB = p - b;
    const T bu = u.dot(fromB), bv = v.dot(fromB);
    if (bu >= 0 && bv <= bu) return fromB.squaredNorm();
    const Vec fromC = p - c;
    const T cu = u.dot(fromC), cv = v.dot(fromC);
    if (cv >= 0 && cu <= cv) return fromC.squaredNorm();
    // Beyond one side or none.
    if (au >= 0 && bu <= 0 && au * bv <= bu * av) return (fromA - au / (au - bu) * u).squaredNorm();
    if (av >= 0 && cv <= 0 && cu * av <= au * cv) return (fromA - av / (av - cv) * v).squaredNorm();
    const T bw = bv - bu, cw = cu - cv;
    if (bw >= 0 && cw >= 0 && bu * cv <= cu * bv)
        return (fromB - bw / (bw + cw) * (c - b)).squaredNorm();
    const T height = normal.dot(fromA);
    return height * height / square;
}

} // namespace mpuvdb
