// The path of a ball's center that rolls along two solids.
#pragma once
#include "rolled_surface.h"

#include <array>
#include <memory>
#include <vector>

namespace mpuvdb
{

/// The curves on which both solids are a radius away. Lengths are voxels, places count from the
/// solids' frame. All members are safe to call from many threads.
class BallPath
{
public:
    /// The nearest place of the path.
    struct Near {
        float distance;
        bool isFound = false;
        /// Whether the path is smooth there, and its normal plane holds the place that asked.
        bool isBeside = false;
        /// Whether the place that asked lies in the wedge from the center to where both solids
        /// touch the ball, continued beyond.
        bool isBetween = false;
    };

    /// @param seeds  places near the path. @throws Interrupted.
    BallPath(const RolledSurface& a, const RolledSurface& b, float radius, std::vector<Vec3f> seeds,
             Interrupter& progress);

    bool isEmpty() const { return mCenters.empty(); }
    /// The nearest place to @a p; none if all are at least as far as @a most.
    Near nearest(const Vec3f& p, float most) const;

private:
    /// Where the ball's center is, with what it touches.
    struct Contact {
        Vec3f center;
        Vec3f toA, toB; ///< unit
        bool isFound = false;
    };
    /// A place of the path with how it goes on.
    struct Center {
        Vec3f center, tangent, toA, toB; ///< all but the center unit; the last lead to the solids
        bool isSmooth = false;           ///< else the path has a corner or an end
        /// Of a smooth path: its second derivative, and the derivatives of toA and toB.
        Vec3f bend = Vec3f::Zero(), turnA = Vec3f::Zero(), turnB = Vec3f::Zero();
        /// Else: both ways on, for a voxel; zero where there is none.
        std::array<Vec3f, 2> arms = {Vec3f::Zero(), Vec3f::Zero()};
    };

    Contact contactNear(Vec3f center) const;
    void trace(std::vector<Vec3f>&& seeds, Interrupter& progress);
    Center centerAt(const Vec3f& place) const;

    const RolledSurface &mA, &mB;
    float mRadius;
    std::vector<Center> mCenters; ///< in the tree's order
    Places mPlaces;
    std::unique_ptr<PlaceTree> mTree;
};

} // namespace mpuvdb
