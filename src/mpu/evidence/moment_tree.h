// Weighted sums of points' attributes and of their products with the normals, which separate the
// sides of a surface; of single points and of groups.
#pragma once
#include "mpu/octree/sorted_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace mpuvdb
{

class Interrupter;

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

    /// @param points, channels  have to outlive this. @throws Interrupted.
    MomentTree(const SortedPoints& points, const Channels& channels, Interrupter& progress);

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
        if (!mTree.nodes().empty()) visit({}, box, level, step(level) * step(level), add);
    }

private:
    /// Level from which on lattices have two nodes in a step. [tuned: attributes_bench; 1 takes 10
    /// % more time, and waves of ten spacings are 1 % nearer]
    static constexpr int kMinFineLevel = 2;

    /// A node of the tree and its group: the last of the nodes above, or itself, with at least
    /// kMinGroupBuckets buckets. Groups are numbered as in a heap: the children of g are 2g and
    /// 2g + 1.
    struct Place {
        std::uint32_t node = 0, group = 1;
        bool isGroup = true;
    };
    /// Least buckets of a group. [derived: eight points of each, 64, give the spacing to an eighth]
    static constexpr std::uint32_t kMinGroupBuckets = 8;

    std::array<Place, 2> childrenOf(const Place& place) const
    {
        const std::uint32_t first = place.node + 1, second = mTree.nodes()[place.node].second;
        if (place.isGroup && 2 * place.group < mFinest.size())
            return {{{first, 2 * place.group, true}, {second, 2 * place.group + 1, true}}};
        return {{{first, place.group, false}, {second, place.group, false}}};
    }
    template <typename F>
    void visit(const Place& at, const Eigen::AlignedBox3f& box, int level, float whole,
               F& add) const
    {
        const BucketTree::Node& node = mTree.nodes()[at.node];
        if (mFinest[at.group] > level || !node.box.intersects(box)) return;
        if (node.box.diagonal().squaredNorm() <= whole) {
            if (at.isGroup) {
                if (float* const sums = add(mMiddles[at.group]))
                    std::copy_n(mSums.data() + at.group * mLength, mLength, sums);
            } else if (float* const sums = add(middleOf(at))) {
                sumsOf(at, sums);
            }
        } else if (!node.leaf) {
            for (const Place& child : childrenOf(at)) visit(child, box, level, whole, add);
        } else {
            const BucketTree::Bucket& bucket = mTree.bucketOf(at.node);
            const float area = areaAt(at.group);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n)
                if (float* const sums = add(position(n))) sumsOf(n, area, sums);
        }
    }

    Vec3f position(std::uint32_t n) const { return {mPoints.x[n], mPoints.y[n], mPoints.z[n]}; }
    float areaAt(std::uint32_t group) const { return std::ldexp(1.0f, 2 * mFinest[group]); }
    float confidenceOf(std::uint32_t point) const;
    template <bool kIsFirst>
    void addSums(std::uint32_t point, float area, float* sums) const;
    void sumsOf(std::uint32_t point, float area, float* sums) const;
    Vec3f middleOf(const Place& place) const;
    void sumsOf(const Place& place, float* sums) const;
    BucketTree::Bucket bucketsOf(std::uint32_t node) const;
    BucketTree::Bucket pointsOf(std::uint32_t node) const;
    std::vector<Place> lastGroups() const;
    void findLevels(Interrupter& progress);
    void sumUp(Interrupter& progress);
    float spacingIn(const BucketTree::Bucket& bucket) const;
    template <typename LevelOf>
    void lessen(int& best, const Place& at, const LevelOf& levelOf) const;

    PointArrays mPoints;
    Channels mChannels;
    BucketTree mTree;
    std::size_t mLength;
    float mStep = 1, mPerConfidence = 1;
    std::vector<float> mReferences;
    std::vector<int> mFinest;    ///< of the groups: the finest level of their points
    std::vector<Vec3f> mMiddles; ///< of the groups' points
    std::vector<float> mSums;    ///< of the groups
};

} // namespace mpuvdb
