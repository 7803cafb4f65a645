// The prism above and below a triangle.
#pragma once
#include "spatial/point_triangle.h"

#include <array>
#include <cmath>

namespace mpuvdb
{

/// The largest change of a color's channel, in [0,1]. [tuned: simplify_mesh_test]
constexpr float kMaxColorChange = 0.06f;

/// The prism above and below a triangle, and the colors on the triangle.
class Slab
{
public:
    Slab(const std::array<Vec3d, 3>& corners, const std::array<Vec3f, 3>& colors)
        : mCorners(corners), mColors(colors),
          mNormal((corners[1] - corners[0]).cross(corners[2] - corners[0]))
    {
        mNormal.normalize();
        for (std::size_t side = 0; side < 3; ++side)
            mInward[side] = mNormal.cross(corners[(side + 1) % 3] - corners[side]);
    }

    bool holds(const Vec3d& p, double reach) const
    {
        return std::abs(mNormal.dot(p - mCorners[0])) <= reach &&
               mInward[0].dot(p - mCorners[0]) >= 0 && mInward[1].dot(p - mCorners[1]) >= 0 &&
               mInward[2].dot(p - mCorners[2]) >= 0;
    }
    bool isNear(const Vec3d& p, double reach) const
    {
        return std::abs(mNormal.dot(p - mCorners[0])) <= reach &&
               squaredDistance(p, mCorners) <= reach * reach;
    }
    /// Whether the triangle has about @a color below @a p.
    bool isColored(const Vec3d& p, const Vec3f& color) const
    {
        const double whole = mInward[0].dot(mCorners[2] - mCorners[0]);
        if (!(whole > 0)) return true;
        Vec3f blended = Vec3f::Zero();
        for (std::size_t side = 0; side < 3; ++side) {
            const double share = mInward[side].dot(p - mCorners[side]) / whole;
            blended += float(share) * mColors[(side + 2) % 3];
        }
        return (blended - color).cwiseAbs().maxCoeff() <= kMaxColorChange;
    }

private:
    std::array<Vec3d, 3> mCorners;
    std::array<Vec3f, 3> mColors;
    Vec3d mNormal;
    std::array<Vec3d, 3> mInward; ///< across each side
};

} // namespace mpuvdb
