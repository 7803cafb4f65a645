#include "bucket_tree.h"

namespace mpuvdb
{

BucketTree::BucketTree(const Coordinates& points, std::vector<Bucket>&& buckets)
    : mBuckets(std::move(buckets))
{
    mNodes.reserve(2 * mBuckets.size());
    if (!mBuckets.empty()) build(points, 0, mBuckets.size());
}

std::uint32_t BucketTree::build(const Coordinates& points, std::size_t begin, std::size_t end)
{
    const auto at = std::uint32_t(mNodes.size());
    mNodes.push_back({});
    Node node{};
    node.leaf = end - begin == 1;
    if (node.leaf) {
        node.second = std::uint32_t(begin);
        for (std::size_t n = mBuckets[begin].begin; n < mBuckets[begin].end; ++n)
            node.box.extend(points[n]);
    } else {
        const std::size_t middle = (begin + end) / 2;
        const std::uint32_t first = build(points, begin, middle);
        node.second = build(points, middle, end);
        node.box = mNodes[first].box.merged(mNodes[node.second].box);
    }
    mNodes[at] = node;
    return at;
}

} // namespace mpuvdb
