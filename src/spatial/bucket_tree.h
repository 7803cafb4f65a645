// A tree of boxes over small buckets of points, for searches among all points.
#pragma once
#include <mpuvdb/vec.h>

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace mpuvdb
{

/// Positions as one array per coordinate, which somebody else owns.
struct Coordinates {
    const float *x, *y, *z;

    Vec3f operator[](std::size_t n) const { return {x[n], y[n], z[n]}; }
};

class BucketTree
{
public:
    /// A run of points that are near each other.
    struct Bucket {
        std::uint32_t begin, end;
    };
    /// A run of buckets. The first child of an inner node is the node after it.
    struct Node {
        Eigen::AlignedBox3f box;
        std::uint32_t second; ///< second child; of a leaf, its bucket
        bool leaf;
    };

    BucketTree() = default;
    /// @param buckets  that hold all the points, one after the other.
    BucketTree(const Coordinates& points, std::vector<Bucket>&& buckets);

    const std::vector<Bucket>& buckets() const { return mBuckets; }
    /// The nodes, children after their parents.
    const std::vector<Node>& nodes() const { return mNodes; }
    /// The bucket of a leaf.
    const Bucket& bucketOf(std::uint32_t leaf) const { return mBuckets[mNodes[leaf].second]; }

    /// A value for each node: fromLeaf(bucket) at leaves, join(first child, second child) above.
    template <typename T, typename FromLeaf, typename Join>
    std::vector<T> perNode(FromLeaf fromLeaf, Join join) const
    {
        std::vector<T> values(mNodes.size());
        for (std::size_t n = mNodes.size(); n-- > 0;) {
            const Node& node = mNodes[n];
            values[n] =
                node.leaf ? fromLeaf(node.second) : join(values[n + 1], values[node.second]);
        }
        return values;
    }

    /// Call atLeaf(node) for all leaves with distance(node) <= reach(), near ones first. atLeaf()
    /// may lessen the reach.
    /// @param distance  lower bound of the distance to a node's points, by its index.
    template <typename Distance, typename Reach, typename AtLeaf>
    void search(Distance distance, Reach reach, AtLeaf atLeaf) const
    {
        if (!mNodes.empty()) searchBelow(0, distance, reach, atLeaf);
    }

private:
    std::uint32_t build(const Coordinates& points, std::size_t begin, std::size_t end);

    template <typename Distance, typename Reach, typename AtLeaf>
    void searchBelow(std::uint32_t at, Distance& distance, Reach& reach, AtLeaf& atLeaf) const
    {
        const Node& node = mNodes[at];
        if (node.leaf) {
            atLeaf(at);
            return;
        }
        using Value = decltype(distance(at));
        std::pair<Value, std::uint32_t> nearer{distance(at + 1), at + 1},
            farther{distance(node.second), node.second};
        if (farther.first < nearer.first) std::swap(nearer, farther);
        if (nearer.first <= reach()) searchBelow(nearer.second, distance, reach, atLeaf);
        if (farther.first <= reach()) searchBelow(farther.second, distance, reach, atLeaf);
    }

    std::vector<Bucket> mBuckets;
    std::vector<Node> mNodes;
};

} // namespace mpuvdb
