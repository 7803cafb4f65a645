// Points about a place of a surface, seen along its normal.
#pragma once
#include <mpuvdb/vec.h>

#include <vector>

namespace mpuvdb
{

class PointsAround
{
public:
    /// Forget all points. @param normal  of the surface at the place, unit, or
    /// zero where it has none.
    void start(const Vec3f& normal);
    /// @param offset  of a point from the place. @return whether it is the first in its direction,
    /// of eight.
    bool add(const Vec3f& offset);

    /// Whether the points are known to lie all around the place: by the eighths of the circle that
    /// have points, so that it may be false where they do.
    bool surround() const;
    /// The distance in the tangent plane from the place to the convex hull of the points, of which
    /// there is at least one.
    float distanceToHull() const;

private:
    Vec3f mFirst, mSecond; ///< unit vectors that span the tangent plane
    unsigned mEighths = 0; ///< a bit for each eighth of the circle that has points
    std::vector<Eigen::Vector2f> mOffsets;
};

} // namespace mpuvdb
