// Weighted sums of points' attributes and of their products with the normals, which separate the
// sides of a surface; of single points and of groups.
#pragma once
#include "mpu/octree/sorted_points.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace mpuvdb
{

/// Sums over points of their weights (confidences, of a mean of 1, times the area that is theirs)
/// and of weight times each channel, each of them as it is and times the three components of the
/// normals. Four such quantities fill a group of lanes: the four as they are, then times each
/// component; zeros where there are fewer.
class MomentTree
{
public:
    /// Lanes of a group. [derived: four quantities times 1 and three components]
    static constexpr std::size_t kLanes = 16;
    /// One vector for each channel, as long as the points.
    using Channels = std::vector<const float*>;

    /// @param points, channels  have to outlive this.
    MomentTree(const SortedPoints& points, const Channels& channels);

    /// Count of numbers in one set of sums.
    std::size_t length() const { return mLength; }
    /// Reference value of a channel. Sums are of differences from it, so that a constant stays one.
    float reference(std::size_t channel) const { return mReferences[channel]; }
    /// Distance up to which points add to the nodes of a lattice of @a level, local units; twice as
    /// far a level up. Level 0 is the finest of points with the cloud's median spacing.
    float step(int level) const { return std::ldexp(mStep, level); }
    /// Nodes of a lattice in a step: two where steps are long, so that no cell shows.
    static int nodesPerStep(int level) { return level < kMinFineLevel ? 1 : 2; }
    /// The finest of the levels at which points that have them lie within two steps of @a box.
    int finestLevel(const Eigen::AlignedBox3f& box) const;

    /// Whether a step is so long that all points count at @a place.
    bool coversAll(const Vec3f& place, float step) const
    {
        return step >
               2 * mTree.nodes()[0].box.merged(Eigen::AlignedBox3f(place)).sizes().maxCoeff();
    }
    /// Whether coversAll() may be true for any place.
    bool mayCoverAll(float step) const
    {
        return step > 2 * mTree.nodes()[0].box.sizes().maxCoeff();
    }
    /// Store the sums of the points in @a box, and perhaps more, in the memory that add(position)
    /// returns, if any: of each point, or of a node no larger than a step of @a level, at its
    /// center of weight. Which of both, and the order, does not depend on the box.
    template <typename F>
    void forEach(const Eigen::AlignedBox3f& box, int level, F add) const
    {
        if (!mTree.nodes().empty()) visit(0, box, level, step(level) * step(level), add);
    }

private:
    /// Level from which on lattices have two nodes in a step. [tuned: attributes_bench; 1 takes 10
    /// % more time, and waves of ten spacings are 1 % nearer]
    static constexpr int kMinFineLevel = 2;

    template <typename F>
    void visit(std::uint32_t at, const Eigen::AlignedBox3f& box, int level, float whole,
               F& add) const
    {
        const BucketTree::Node& node = mTree.nodes()[at];
        if (mFinest[at] > level || !node.box.intersects(box)) return;
        if (node.box.diagonal().squaredNorm() <= whole) {
            if (float* const sums = add(mMiddles[at]))
                std::copy_n(mSums.data() + at * mLength, mLength, sums);
        } else if (!node.leaf) {
            visit(at + 1, box, level, whole, add);
            visit(node.second, box, level, whole, add);
        } else {
            const BucketTree::Bucket& bucket = mTree.bucketOf(at);
            const float area = areaAt(at);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n)
                if (float* const sums = add(position(n))) sumsOf(n, area, sums);
        }
    }

    Vec3f position(std::uint32_t n) const { return {mPoints.x[n], mPoints.y[n], mPoints.z[n]}; }
    float areaAt(std::size_t leaf) const { return std::ldexp(1.0f, 2 * mFinest[leaf]); }
    void sumsOf(std::uint32_t point, float area, float* sums) const;
    void sumUp();
    void findLevels();
    float spacingIn(const BucketTree::Bucket& bucket) const;

    PointArrays mPoints;
    Channels mChannels;
    BucketTree mTree;
    std::size_t mLength;
    float mStep = 1, mPerConfidence = 1;
    std::vector<float> mReferences;
    std::vector<int> mFinest;    ///< of the nodes: the finest level of their points
    std::vector<Vec3f> mMiddles; ///< of the nodes' points
    std::vector<float> mSums;    ///< of the nodes
};

} // namespace mpuvdb
