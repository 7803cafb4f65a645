#include "points_around.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Vec2f = Eigen::Vector2f;

/// The least share of a squared distance by which a step lessens it. [derived: roundings of float]
constexpr float kLeastStep = 1e-6f;

float cross(const Vec2f& a, const Vec2f& b)
{
    return a[0] * b[1] - a[1] * b[0];
}

bool holdsOrigin(const Vec2f& a, const Vec2f& b, const Vec2f& c)
{
    const float ab = cross(a, b), bc = cross(b, c), ca = cross(c, a);
    return (ab > 0 && bc > 0 && ca > 0) || (ab < 0 && bc < 0 && ca < 0);
}

/// The place of the segment from @a a to @a b that is nearest to the origin.
Vec2f nearestOf(const Vec2f& a, const Vec2f& b)
{
    const Vec2f side = b - a;
    const float length2 = side.squaredNorm();
    const float t = length2 > 0 ? std::clamp(-a.dot(side) / length2, 0.0f, 1.0f) : 0;
    return a + t * side;
}

} // namespace

void PointsAround::start(const Vec3f& normal)
{
    const Vec3f axis = normal.isZero() ? Vec3f::UnitZ() : normal;
    mFirst = axis.unitOrthogonal();
    mSecond = axis.cross(mFirst);
    mEighths = 0;
    mOffsets.clear();
}

bool PointsAround::add(const Vec3f& offset)
{
    const Vec2f at(mFirst.dot(offset), mSecond.dot(offset));
    mOffsets.push_back(at);
    const bool left = at[0] < 0, below = at[1] < 0, steep = std::abs(at[0]) < std::abs(at[1]);
    // Eighths are numbered around the circle: in every other quarter the steep one is the first.
    const unsigned quarter = below ? (left ? 2u : 3u) : (left ? 1u : 0u);
    const unsigned bit = 1u << (2 * quarter + unsigned(steep != (left != below)));
    const bool first = !(mEighths & bit);
    mEighths |= bit;
    return first;
}

/// No three eighths in a row are empty, so that less than half a turn lies between points.
bool PointsAround::surround() const
{
    const unsigned none = ~mEighths & 0xffu, twice = none | none << 8;
    return (twice & twice >> 1 & twice >> 2) == 0;
}

/// Gilbert, Johnson and Keerthi's method: a side of a triangle of points, made nearer as long as
/// there is a point beyond it.
float PointsAround::distanceToHull() const
{
    Vec2f a =
        *std::min_element(mOffsets.begin(), mOffsets.end(), [](const Vec2f& p, const Vec2f& q) {
            return p.squaredNorm() < q.squaredNorm();
        });
    Vec2f b = a, nearest = a;
    for (float least2 = nearest.squaredNorm(); least2 > 0;) {
        const Vec2f& beyond = *std::min_element(
            mOffsets.begin(), mOffsets.end(),
            [&](const Vec2f& p, const Vec2f& q) { return p.dot(nearest) < q.dot(nearest); });
        if (holdsOrigin(a, b, beyond)) return 0;
        const Vec2f byA = nearestOf(a, beyond), byB = nearestOf(b, beyond);
        const bool keepsA = byA.squaredNorm() < byB.squaredNorm();
        const Vec2f next = keepsA ? byA : byB;
        if (!(next.squaredNorm() < (1 - kLeastStep) * least2)) break;
        (keepsA ? b : a) = beyond;
        nearest = next;
        least2 = nearest.squaredNorm();
    }
    return nearest.norm();
}

} // namespace mpuvdb
