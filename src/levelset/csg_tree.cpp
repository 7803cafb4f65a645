#include "csg_tree.h"

#include "ball_centres.h"
#include "crease.h"
#include "fill_specks.h"

#include <mpuvdb/progress.h>

#include <openvdb/tools/Merge.h>
#include <openvdb/tree/NodeManager.h>

#include <tbb/concurrent_vector.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// The signs that make a union of a Boolean's solids, and it of the union.
struct Signs {
    float a, b, result;
};

Signs signsOf(Boolean kind)
{
    switch (kind) {
    case Boolean::Union:
        return {1, 1, 1};
    case Boolean::Intersection:
        return {-1, -1, -1};
    case Boolean::Difference:
        break;
    }
    return {-1, 1, -1};
}

/// Voxels of one leaf.
struct LeafVoxels {
    Coord origin;
    Leaf::NodeMaskType voxels;
};

/// Leaves of which both trees have one.
class LeafCombiner
{
public:
    LeafCombiner(Boolean kind, const FloatTree& a, const FloatTree& b, double voxelSize,
                 double radius)
        : mA(a), mB(b), mSigns(signsOf(kind)), mBackground(a.background()),
          mVoxelSize(float(voxelSize)), mRadius(float(radius / voxelSize)),
          mReach(mRadius + mBackground / mVoxelSize)
    {
    }

    void combine(Leaf& leaf) const
    {
        const Leaf* const a = mA.probeConstLeaf(leaf.origin());
        const Leaf* const b = mB.probeConstLeaf(leaf.origin());
        if (!a || !b) return;
        Leaf::NodeMaskType inBoth = a->getValueMask();
        inBoth &= b->getValueMask();
        mergeValues(*a, *b, leaf);
        if (!inBoth.isOff()) fillWedges(*a, *b, inBoth, leaf);
    }

    /// What is known, in order.
    std::vector<KnownVoxels> known() const
    {
        std::vector<KnownVoxels> inOrder(mKnown.begin(), mKnown.end());
        std::sort(inOrder.begin(), inOrder.end(),
                  [](const KnownVoxels& a, const KnownVoxels& b) { return a.origin < b.origin; });
        return inOrder;
    }
    bool isFilletDoubtful() const { return !mUnsettled.empty(); }

    /// Give the voxels of a fillet that no crease tells the distance to what is the nearest place
    /// for the ball of all.
    void settleFillet(FloatTree& tree, Progress& progress) const
    {
        if (mUnsettled.empty()) return;
        std::vector<Coord> origins;
        for (const LeafVoxels& leaf : mUnsettled) origins.push_back(leaf.origin);
        const BallCentres::Solid a{mA, mSigns.a / mVoxelSize}, b{mB, mSigns.b / mVoxelSize};
        const auto centres = [&](const BallCentres::Solid& one, const BallCentres::Solid& other) {
            return BallCentres(one, other, mRadius, mReach, origins, progress);
        };
        const BallCentres centresA = centres(a, a), centresB = centres(b, b),
                          between = centres(a, b);
        tbb::parallel_for(std::size_t(0), mUnsettled.size(), [&](std::size_t n) {
            const Coord& origin = mUnsettled[n].origin;
            Leaf& leaf = *tree.probeLeaf(origin);
            BallCentres::Search besideA(centresA, origin), besideB(centresB, origin),
                inBetween(between, origin);
            for (auto it = mUnsettled[n].voxels.beginOn(); it; ++it) {
                progress.check();
                settle(besideA, besideB, inBetween, it.pos(), leaf);
            }
        });
    }

    /// What the ball has filled outside both solids.
    Fill fill() const
    {
        const auto ball = std::size_t(4.0 / 3 * M_PI * double(mRadius) * mRadius * mRadius);
        return {{mFilled.begin(), mFilled.end()}, ball, [this](const Coord& at) {
                    const float u = mSigns.a * mA.getValue(at), v = mSigns.b * mB.getValue(at);
                    return std::max(u, v) < mRadius * mVoxelSize;
                }};
    }

private:
    void mergeValues(const Leaf& a, const Leaf& b, Leaf& leaf) const
    {
        const float *const as = a.buffer().data(), *const bs = b.buffer().data();
        float* const values = leaf.buffer().data();
        const float background = mSigns.result * mBackground;
        Leaf::NodeMaskType active;
        for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) {
            const float u = mSigns.a * as[i], v = mSigns.b * bs[i];
            const bool on = (u <= v && a.isValueOn(i)) || (v <= u && b.isValueOn(i));
            active.set(i, on);
            // No zero below zero: its sign counts where distances are restored.
            values[i] = on ? mSigns.result * std::min(u, v) + 0.0f
                           : std::copysign(background, mSigns.result * std::min(u, v));
        }
        leaf.setValueMask(active);
    }

    void fillWedges(const Leaf& a, const Leaf& b, const Leaf::NodeMaskType& inBoth,
                    Leaf& leaf) const
    {
        const float highest = (mRadius + kTouching) * mVoxelSize;
        const CreaseFinder finder(SolidReader(mA, mSigns.a / mVoxelSize),
                                  SolidReader(mB, mSigns.b / mVoxelSize), mRadius, mReach);
        KnownVoxels known{leaf.origin(), Leaf::NodeMaskType(mRadius == 0)};
        LeafVoxels unsettled{leaf.origin(), {}};
        for (auto it = inBoth.beginOn(); it; ++it) {
            const openvdb::Index i = it.pos();
            const float least = std::min(mSigns.a * a.getValue(i), mSigns.b * b.getValue(i));
            if (least > highest) continue;
            const CreaseFinder::Answer answer = finder.find(leaf.offsetToGlobalCoord(i));
            if (mRadius == 0 && !isPlaced(answer)) {
                known.unplaced.setOn(i);
                known.exact.setOff(i);
                known.isDoubtful = true;
                // Where two solids touch, values are 0, and all is inside.
                if (answer.place == CreaseFinder::Place::Buried && least >= 0)
                    leaf.setValueOnly(i, -mSigns.result * std::numeric_limits<float>::min());
                continue;
            }
            known.placed.setOn(i);
            const bool isKnown = place(answer, i, leaf);
            if (!isKnown && mRadius > 0 && answer.place != CreaseFinder::Place::Crease)
                unsettled.voxels.setOn(i);
            known.isDoubtful |= !isKnown;
            known.exact.set(i, isKnown && (mRadius == 0 || answer.isSure));
            if (least >= 0 && mSigns.result * leaf.getValue(i) < 0)
                mFilled.push_back(leaf.offsetToGlobalCoord(i));
        }
        mKnown.push_back(known);
        if (!unsettled.voxels.isOff()) mUnsettled.push_back(unsettled);
    }

    /// Whether a sharp union's value is known by the answer.
    static bool isPlaced(const CreaseFinder::Answer& answer)
    {
        return answer.place == CreaseFinder::Place::Surface ||
               (answer.place == CreaseFinder::Place::Crease && answer.isSure);
    }

    /// @return whether the value is known.
    bool place(const CreaseFinder::Answer& answer, openvdb::Index voxel, Leaf& leaf) const
    {
        using Place = CreaseFinder::Place;
        if (answer.place == Place::Surface) return true;
        const float deepest = -mSigns.result * mBackground;
        const bool isCrease = answer.place == Place::Crease;
        if (isCrease && answer.distance < mReach) {
            leaf.setValueOn(voxel, mSigns.result * (mRadius - answer.distance) * mVoxelSize);
            return true;
        }
        if (isCrease) leaf.setValueOff(voxel, deepest);
        return false;
    }

    /// The ball also bridges the hollows of either solid alone: only by how much farther it keeps
    /// off both is the fillet's.
    void settle(BallCentres::Search& besideA, BallCentres::Search& besideB,
                BallCentres::Search& between, openvdb::Index voxel, Leaf& leaf) const
    {
        const Coord at = leaf.offsetToGlobalCoord(voxel);
        const float least = std::min(mSigns.a * mA.getValue(at), mSigns.b * mB.getValue(at));
        const float sharp = mRadius - least / mVoxelSize;
        const float both = between.distanceFrom(at, mReach, sharp);
        if (both <= sharp) return;
        const float fromA = besideA.distanceFrom(at, both);
        if (fromA >= both) return;
        const float fromB = besideB.distanceFrom(at, both);
        if (fromB >= both) return;
        const float farther = both - std::max(fromA, fromB);
        const float value = least - farther * mVoxelSize;
        if (value > -mBackground)
            leaf.setValueOn(voxel, mSigns.result * value);
        else
            leaf.setValueOff(voxel, -mSigns.result * mBackground);
        if (least >= 0 && value < 0) mFilled.push_back(at);
    }

    const FloatTree &mA, &mB;
    Signs mSigns;
    float mBackground, mVoxelSize;                         ///< world units
    float mRadius, mReach;                                 ///< voxels
    mutable tbb::concurrent_vector<KnownVoxels> mKnown;    ///< in any order
    mutable tbb::concurrent_vector<LeafVoxels> mUnsettled; ///< of a fillet, in any order
    mutable tbb::concurrent_vector<Coord> mFilled;         ///< in any order
};

/// OpenVDB's merge of nodes and tiles, with leaves of our own, and stoppable.
template <typename Merge>
struct Merger {
    const Merge& merge;
    const LeafCombiner& leaves;
    Progress& progress;

    template <typename Node>
    bool operator()(Node& node, std::size_t index) const
    {
        progress.check();
        return merge(node, index);
    }
    bool operator()(Leaf& leaf, std::size_t) const
    {
        progress.check();
        leaves.combine(leaf);
        return false;
    }
};

template <typename Merge>
void mergeInto(FloatTree& tree, const FloatTree& other, const LeafCombiner& leaves,
               Progress& progress)
{
    const Merge merge(other, openvdb::DeepCopy());
    openvdb::tree::DynamicNodeManager<FloatTree> nodes(tree);
    nodes.foreachTopDown(Merger<Merge>{merge, leaves, progress});
}

} // namespace

CsgTree csgTree(Boolean kind, const FloatTree& a, const FloatTree& b, double voxelSize,
                double radius, Progress& progress)
{
    const LeafCombiner leaves(kind, a, b, voxelSize, radius);
    progress.check();
    // The copy cannot be stopped: it takes less than the 30 ms of a whole union of 8 M voxels.
    auto tree = std::make_shared<FloatTree>(a);
    progress.check();
    using namespace openvdb::tools;
    switch (kind) {
    case Boolean::Union:
        mergeInto<CsgUnionOp<FloatTree>>(*tree, b, leaves, progress);
        break;
    case Boolean::Intersection:
        mergeInto<CsgIntersectionOp<FloatTree>>(*tree, b, leaves, progress);
        break;
    case Boolean::Difference:
        mergeInto<CsgDifferenceOp<FloatTree>>(*tree, b, leaves, progress);
        break;
    }
    leaves.settleFillet(*tree, progress);
    const bool isMended = mendFill(*tree, leaves.fill(), progress);
    return {tree, leaves.known(), isMended || leaves.isFilletDoubtful()};
}

} // namespace mpuvdb
