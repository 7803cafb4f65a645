// nanoflann over a vector of positions.
#pragma once
#include <mpuvdb/vec.h>

#include <nanoflann.hpp>

#include <vector>

namespace mpuvdb
{

/// What nanoflann asks of a set of points.
class PositionSet
{
public:
    explicit PositionSet(const std::vector<Vec3f>& positions) : mPositions(positions) {}
    std::size_t kdtree_get_point_count() const { return mPositions.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const
    {
        return mPositions[i][Eigen::Index(axis)];
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const
    {
        return false;
    }

private:
    const std::vector<Vec3f>& mPositions;
};

/// A kd-tree over positions that outlive it.
class KdTree
{
public:
    explicit KdTree(const std::vector<Vec3f>& positions)
        : mSet(positions), mTree(3, mSet, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize))
    {
    }

    /// Indices and squared distances of the nearest to @a p, nearest first; as many as there are,
    /// at most the vectors' size, to which they are cut.
    void nearest(const Vec3f& p, std::vector<std::uint32_t>& indices,
                 std::vector<float>& squared) const
    {
        const std::size_t n =
            mTree.knnSearch(p.data(), indices.size(), indices.data(), squared.data());
        indices.resize(n);
        squared.resize(n);
    }

private:
    static constexpr std::size_t kLeafSize = 16; ///< [free: the same distances]
    using Metric = nanoflann::L2_Simple_Adaptor<float, PositionSet>;
    PositionSet mSet;
    nanoflann::KDTreeSingleIndexAdaptor<Metric, PositionSet, 3, std::uint32_t> mTree;
};

} // namespace mpuvdb
