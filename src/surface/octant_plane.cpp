#include "octant_plane.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Error of prediction, voxels, from which on a plane has no weight. [tuned: sharp_mesh_test]
constexpr float kMaxPlaneError = 0.4f;

} // namespace

float OctantPlane::weight() const
{
    const float trust = std::max(1 - error / kMaxPlaneError, 0.0f);
    return trust * trust;
}

OctantPlane octantPlane(const float* value, const std::array<int, 3>& stride, float scale)
{
    const auto [sx, sy, sz] = stride;
    const float here = scale * *value;
    // Octant o lies up the axes of its bits: 1 is x, 2 y, 4 z; likewise for its corners but the
    // voxel.
    std::array<std::array<float, 8>, 8> corner;
    for (int o = 0; o < 8; ++o) {
        const int x = o & 1 ? sx : -sx, y = o & 2 ? sy : -sy, z = o & 4 ? sz : -sz;
        for (int at = 1; at < 8; ++at)
            corner[std::size_t(at)][std::size_t(o)] =
                value[(at & 1 ? x : 0) + (at & 2 ? y : 0) + (at & 4 ? z : 0)];
    }
    std::array<std::array<float, 8>, 3> rise;
    std::array<float, 8> error;
    for (std::size_t o = 0; o < 8; ++o) {
        const float a = scale * corner[1][o] - here, b = scale * corner[2][o] - here,
                    c = scale * corner[4][o] - here;
        // Errors of the plane through these three at the octant's other corners.
        const float ab = scale * corner[3][o] - here - a - b,
                    ac = scale * corner[5][o] - here - a - c,
                    bc = scale * corner[6][o] - here - b - c,
                    abc = scale * corner[7][o] - here - a - b - c;
        error[o] =
            std::max(std::max(std::abs(ab), std::abs(ac)), std::max(std::abs(bc), std::abs(abc)));
        rise[0][o] = a;
        rise[1][o] = b;
        rise[2][o] = c;
    }
    for (std::size_t o = 0; o < 8; ++o) {
        const float slope =
            std::sqrt(rise[0][o] * rise[0][o] + rise[1][o] * rise[1][o] + rise[2][o] * rise[2][o]);
        // Steeper values are a multiple of distances, or mix two sides of a crease; then the errors
        // at the other corners are large.
        error[o] = slope > 1 ? error[o] / slope : std::max(error[o], 1 - slope);
    }
    const auto best = std::size_t(std::min_element(error.begin(), error.end()) - error.begin());
    OctantPlane plane;
    plane.error = error[best];
    for (std::size_t axis = 0; axis < 3; ++axis)
        plane.normal[Eigen::Index(axis)] = best >> axis & 1 ? rise[axis][best] : -rise[axis][best];
    const float slope = plane.normal.norm();
    plane.distance = here;
    plane.steepness = std::max(slope, 1.0f);
    if (slope > 0) plane.normal /= slope;
    return plane;
}

PlaneCrossing crossingByPlanes(const OctantPlane& inner, const OctantPlane& outer,
                               const Vec3f& along)
{
    // Beside a crease one end alone may look steep; a multiple of distances is steep at both.
    const float steepness = std::min(inner.steepness, outer.steepness);
    const auto crosses = [&](const OctantPlane& plane) {
        return plane.weight() != 0 && plane.normal.dot(along) > 0;
    };
    const auto at = [&](const OctantPlane& plane, float end) {
        return end - plane.distance / steepness / plane.normal.dot(along);
    };
    if (!crosses(inner))
        return crosses(outer) ? PlaneCrossing{&outer, at(outer, 1)} : PlaneCrossing{nullptr, 0};
    const float first = at(inner, 0);
    if (!crosses(outer)) return {&inner, first};
    const float last = at(outer, 1);
    const float rise = (outer.distance - inner.distance) / steepness;
    const bool convex = rise > inner.normal.dot(along);
    return (first < last) != convex ? PlaneCrossing{&outer, last} : PlaneCrossing{&inner, first};
}

} // namespace mpuvdb
