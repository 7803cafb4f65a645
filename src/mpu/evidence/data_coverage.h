// Support of a surface by points: distances to them in units of their own spacing.
#pragma once
#include "mpu/octree/sorted_points.h"

#include <mpuvdb/field.h>

namespace mpuvdb
{

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
    /// The points nearest to a place, nearest first.
    class Neighbors;
    /// The point that supports a place best so far.
    struct Support {
        float ratio = 0;
        std::uint32_t point = 0;
        float spacing = 0;
    };

    Vec3f position(std::size_t n) const { return {mPoints.x[n], mPoints.y[n], mPoints.z[n]}; }
    void measureSpacings(Interrupter& progress);
    void gather(Neighbors& neighbors) const;
    float ratioOf(std::uint32_t point, float spacing, const Vec3f& p, const Vec3f& normal) const;
    Support bestSupport(const Vec3f& p, const Vec3f& normal) const;

    PointArrays mPoints;
    Vec3d mFrame;
    BucketTree mTree;
    std::vector<float> mSpacings; ///< of the tree's nodes: the largest of their buckets
    double mSpacing = 0;
};

} // namespace mpuvdb
