// Places spread evenly over triangles.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace mpuvdb
{

/// A place on a surface of triangles.
struct TrianglePlace {
    Vec3d position, normal; ///< normal: unit
    std::size_t triangle;
};

/// Distribute @a places places over triangles, each for the same area, in the order of the
/// triangles; deterministic, and none where there is no area.
/// @param corners  corners(n) gives the three corners of triangle n, Vec3d.
template <class Corners>
std::vector<TrianglePlace> placesOn(std::size_t triangles, std::size_t places,
                                    const Corners& corners)
{
    const auto areaVector = [&](std::size_t n) { // twice the area
        const std::array<Vec3d, 3> t = corners(n);
        return Vec3d((t[1] - t[0]).cross(t[2] - t[0]));
    };
    double area = 0;
    for (std::size_t n = 0; n < triangles; ++n) area += areaVector(n).norm();
    std::vector<TrianglePlace> result;
    if (!(area > 0)) return result;
    double upTo = areaVector(0).norm();
    for (std::size_t n = 0, t = 0; n < places; ++n) {
        while (t + 1 < triangles && upTo < area * (double(n) + 0.5) / double(places))
            upTo += areaVector(++t).norm();
        // Low-discrepancy places in the triangle: multiples of two irrational numbers [Cranley76].
        double s = std::fmod(0.7548776662466927 * double(n), 1),
               r = std::fmod(0.5698402909980532 * double(n), 1);
        if (s + r > 1) s = 1 - s, r = 1 - r;
        const std::array<Vec3d, 3> c = corners(t);
        result.push_back(
            {c[0] + s * (c[1] - c[0]) + r * (c[2] - c[0]), areaVector(t).normalized(), t});
    }
    return result;
}

} // namespace mpuvdb
