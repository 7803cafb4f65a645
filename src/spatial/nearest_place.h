// The place of a triangle that is nearest to a given place.
#pragma once
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{

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
