// Where data support a surface: distances to the points, measured in the points' own spacing.
#pragma once
#include "sorted_points.h"

#include <mpuvdb/field.h>

namespace mpuvdb
{

/// The formula stands with MpuField::coverage(). Points are kept in buckets of one spacing each,
/// under a tree of boxes.
class DataCoverage final : public Coverage
{
public:
    /// @param points  have to outlive this. @param frame  world position of their origin.
    DataCoverage(const SortedPoints& points, const Vec3d& frame, Progress& progress);

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override;
    double spacing() const override { return mSpacing; }

private:
    struct Bucket {
        std::uint32_t begin, end; ///< points
        float spacing;
    };
    /// A run of buckets. The first child of an inner node is the node after it.
    struct Node {
        Eigen::AlignedBox3f box;
        float spacing;        ///< largest of its buckets'
        std::uint32_t second; ///< second child; of a leaf, its bucket
        bool leaf;
    };
    /// The nearest points to some place, nearest first.
    class Neighbours;
    /// The point that supports a place best, found so far.
    struct Support {
        float ratio = 0;
        std::uint32_t point = 0;
        float spacing = 0;
    };

    Vec3f position(std::size_t n) const { return {mPoints.x[n], mPoints.y[n], mPoints.z[n]}; }
    std::uint32_t build(std::size_t begin, std::size_t end);
    void measureSpacings(Progress& progress);
    void gather(std::uint32_t node, Neighbours& neighbours) const;
    float ratioOf(std::uint32_t point, float spacing, const Vec3f& p, const Vec3f& normal) const;
    void improve(std::uint32_t node, const Vec3f& p, const Vec3f& normal, Support& best) const;

    const PointBatch& mPoints;
    Vec3d mFrame;
    std::vector<Bucket> mBuckets;
    std::vector<Node> mNodes;
    double mSpacing = 0;
};

} // namespace mpuvdb
