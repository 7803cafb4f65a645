// The distance from a point to a triangle, and the nearest place of the triangle.
#pragma once
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>
#include <cmath>
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

/// The place of a triangle that is nearest to a given place, and the angle of a small circle about
/// it that the triangle fills, radians: 2 pi within it, pi on an edge, the corner's angle at a
/// corner.
struct NearestPlace {
    Vec3d place;
    double angle;

    NearestPlace(const Vec3d& p, const std::array<Vec3d, 3>& t)
    {
        const Vec3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
        int outside = 0;
        double least = HUGE_VAL;
        for (std::size_t k = 0; k < 3; ++k) {
            const Vec3d &a = t[k], &b = t[(k + 1) % 3];
            if (normal.cross(b - a).dot(p - a) > 0) continue; // to the left of the edge
            ++outside;
            const double square = (b - a).squaredNorm();
            const double share = square > 0 ? std::clamp((p - a).dot(b - a) / square, 0.0, 1.0) : 0;
            const Vec3d at = a + share * (b - a);
            if (!((p - at).squaredNorm() < least)) continue;
            least = (p - at).squaredNorm();
            place = at;
            angle = share == 0 ? angleAt(t, k) : share == 1 ? angleAt(t, (k + 1) % 3) : M_PI;
        }
        if (outside > 0) return;
        place = p - normal.dot(p - t[0]) / normal.squaredNorm() * normal;
        angle = 2 * M_PI;
    }

private:
    static double angleAt(const std::array<Vec3d, 3>& t, std::size_t k)
    {
        const Vec3d a = t[(k + 1) % 3] - t[k], b = t[(k + 2) % 3] - t[k];
        return std::atan2(a.cross(b).norm(), a.dot(b));
    }
};

} // namespace mpuvdb
