// Support of a surface by points: whether they lie all around a place of it.
#pragma once
#include "mpu/octree/sorted_points.h"

#include <mpuvdb/field.h>

namespace mpuvdb
{

class PointsAround;

/// Coverage by the formula of MpuField::coverage(). Points are in buckets of one spacing each,
/// under a tree of boxes.
class DataCoverage final : public Coverage
{
public:
    /// @param points  have to outlive this. @param frame  world position of their origin.
    DataCoverage(const SortedPoints& points, const Vec3d& frame, Interrupter& progress);

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override;
    double spacing() const override { return mSpacing; }

private:
    struct Neighbor {
        float squaredDistance;
        std::uint32_t bucket, point;
    };
    /// The points nearest to a place.
    class Neighbors;
    /// A point and its nearest. [derived: so many tell the spacing]
    static constexpr std::size_t kAbout = kSpacingNeighbors + 1;
    using BucketsAbout = std::array<std::uint32_t, kAbout>;
    /// A point, and the spacing of those about it.
    struct Spaced {
        std::uint32_t point;
        float spacing;
    };

    Vec3f position(std::size_t n) const { return {mPoints.x[n], mPoints.y[n], mPoints.z[n]}; }
    void measureSpacings(Interrupter& progress);
    float spacingOf(const BucketTree::Bucket& bucket, BucketsAbout& near) const;
    bool spansPlane(const Neighbors& neighbors) const;
    void gather(Neighbors& neighbors) const;
    float ratioOf(const Spaced& point, const Vec3f& offset, const Vec3f& normal) const;
    /// Add the points that count at @a p to @a around until they surround it, and append those
    /// that are the first in their direction to @a surrounding.
    /// @return distance of @a p beyond them, spacings.
    float search(const Vec3f& p, const Vec3f& normal, PointsAround& around,
                 std::vector<Spaced>& surrounding) const;

    PointArrays mPoints;
    Vec3d mFrame;
    BucketTree mTree;
    std::vector<float> mSpacings; ///< of the tree's nodes: the largest of their buckets
    double mSpacing = 0;
};

} // namespace mpuvdb
