#include "csg_tree.h"

#include "crease.h"
#include "distance/room_distances.h"
#include "fill_cavities.h"

#include <mpuvdb/interrupter.h>

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
using openvdb::CoordBBox;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// The distance from the surface, in voxels, beyond which a value does not move it.
/// [derived: above sqrt(2), the diagonal of a voxel's face]
constexpr float kDeep = 1.5f;

/// The cosine between gradients below which surfaces are opposed. [derived: edges sharper than 30
/// degrees]
constexpr float kOpposedCosine = -0.87f;

/// The signs that turn a Boolean's solids into those of a union, and the union into its result.
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

/// A box that holds the solid.
CoordBBox boxOf(const FloatTree& tree)
{
    CoordBBox box;
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) {
        const float* const values = leaf->buffer().data();
        if (std::any_of(values, values + Leaf::SIZE, [](float v) { return v < 0; }))
            box.expand(leaf->getNodeBoundingBox());
    }
    auto tile = tree.cbeginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile)
        if (*tile < 0) box.expand(tile.getBoundingBox());
    return box;
}

/// A box that holds all changes by a fillet of any radius, and @a halfWidth voxels about them: a
/// ball fills no more than the solids' hull, and removes only parts of them.
CoordBBox filletBox(Boolean kind, const FloatTree& a, const FloatTree& b, double halfWidth)
{
    CoordBBox box = boxOf(a);
    if (kind == Boolean::Union) box.expand(boxOf(b));
    if (kind == Boolean::Intersection) box.intersect(boxOf(b));
    box.expand(int(std::ceil(halfWidth)));
    return box;
}

/// Combines the leaves of both trees.
class LeafCombiner
{
public:
    LeafCombiner(Boolean kind, const FloatTree& a, const FloatTree& b, double voxelSize,
                 double halfWidth, double radius)
        : mA(a), mB(b), mSigns(signsOf(kind)), mBackground(a.background()),
          mVoxelSize(float(voxelSize)), mDeepest(float(halfWidth * voxelSize)),
          mRadius(float(radius / voxelSize)), mReach(mRadius + float(halfWidth)),
          mFilletBox(radius > 0 ? filletBox(kind, a, b, halfWidth) : CoordBBox::inf()),
          mObstacleBoxA(obstacleBox(a, mSigns.a)), mObstacleBoxB(obstacleBox(b, mSigns.b))
    {
    }

    void combine(Leaf& leaf) const
    {
        const Leaf* const a = mA.probeConstLeaf(leaf.origin());
        const Leaf* const b = mB.probeConstLeaf(leaf.origin());
        if (a && b) mergeValues(*a, *b, leaf);
        const CoordBBox box = leaf.getNodeBoundingBox();
        if (!mFilletBox.hasOverlap(box)) return;
        if (a && b && mRadius == 0) {
            Leaf::NodeMaskType inBoth = a->getValueMask();
            inBoth &= b->getValueMask();
            if (!inBoth.isOff()) fillCreases(inBoth, leaf);
        } else if (mRadius > 0 && (a || mObstacleBoxA.hasOverlap(box)) &&
                   (b || mObstacleBoxB.hasOverlap(box))) {
            Leaf::NodeMaskType inEither;
            if (a) inEither |= a->getValueMask();
            if (b) inEither |= b->getValueMask();
            if (!inEither.isOff()) fillCreases(inEither, leaf);
        }
    }

    /// The voxels with known values, in order.
    std::vector<KnownVoxels> known() const
    {
        std::vector<KnownVoxels> inOrder(mKnown.begin(), mKnown.end());
        std::sort(inOrder.begin(), inOrder.end(),
                  [](const KnownVoxels& a, const KnownVoxels& b) { return a.origin < b.origin; });
        return inOrder;
    }
    bool isFilletUncertain() const { return !mUnsettled.empty(); }
    std::vector<LeafVoxels> filleted() const { return {mFilleted.begin(), mFilleted.end()}; }

    /// Where creases do not give all of a fillet, the rest may be wrong, too: give its voxels
    /// measured distances to the nearest place of all for the ball.
    void settleFillet(FloatTree& tree, Interrupter& progress) const
    {
        if (mUnsettled.empty()) return;
        const std::vector<FilletLeaf> fillet = filletByLeaf();
        std::vector<Coord> origins;
        origins.reserve(fillet.size());
        for (const FilletLeaf& leaf : fillet) origins.push_back(leaf.origin);
        const ScaledSolid a{mA, mSigns.a / mVoxelSize}, b{mB, mSigns.b / mVoxelSize};
        const auto room = [&](const ScaledSolid& one, const ScaledSolid& other) {
            return roomDistances(one, other, mRadius, mReach + mRadius, origins, progress);
        };
        const auto besideA = room(a, a), besideB = room(b, b), between = room(a, b);
        mFilleted.clear();
        mFilled.clear();
        tbb::parallel_for(std::size_t(0), fillet.size(), [&](std::size_t n) {
            progress.check();
            Leaf& leaf = *tree.probeLeaf(origins[n]);
            LeafVoxels filleted{origins[n], {}};
            for (auto it = fillet[n].voxels.beginOn(); it; ++it) {
                const openvdb::Index i = it.pos();
                const float farther = between[n][i] - std::max(besideA[n][i], besideB[n][i]);
                filleted.voxels.set(i, settle(farther, fillet[n].byCrease.isOn(i), i, leaf));
            }
            if (!filleted.voxels.isOff()) mFilleted.push_back(filleted);
        });
    }

    /// The voxels outside both solids that the ball has filled.
    Fill fill() const
    {
        const auto ball = std::size_t(4.0 / 3 * M_PI * double(mRadius) * mRadius * mRadius);
        return {{mFilled.begin(), mFilled.end()}, ball, [this](const Coord& at) {
                    const float u = mSigns.a * mA.getValue(at), v = mSigns.b * mB.getValue(at);
                    return mFilletBox.isInside(at) && std::max(u, v) < mRadius * mVoxelSize;
                }};
    }

    /// The thickest part removed from an intersection or difference.
    RemovedPart removed() const
    {
        RemovedPart removed;
        if (mSigns.result > 0) return removed;
        const SolidReader a(mA, mSigns.a / mVoxelSize), b(mB, mSigns.b / mVoxelSize);
        for (const Coord& at : mFilled) {
            const Vec3f ga = a.gradientAt(at), gb = b.gradientAt(at);
            if (!a.isInBand(at) || !b.isInBand(at) || ga.dot(gb) > kOpposedCosine) continue;
            const float depth = std::min(a.valueAt(at), b.valueAt(at));
            const bool isFirst = depth == removed.depth && at < removed.deepest;
            if (!(depth > removed.depth) && !isFirst) continue;
            removed.depth = depth;
            removed.deepest = at;
        }
        return removed;
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
            // No negative zero: the sign counts where distances are restored.
            values[i] = on ? mSigns.result * std::min(u, v) + 0.0f
                           : std::copysign(background, mSigns.result * std::min(u, v));
        }
        leaf.setValueMask(active);
    }

    void fillCreases(const Leaf::NodeMaskType& voxels, Leaf& leaf) const
    {
        const float highest = mRadius + kTouchingGap, deepest = -mDeepest / mVoxelSize;
        const SolidReader a(mA, mSigns.a / mVoxelSize), b(mB, mSigns.b / mVoxelSize);
        const CreaseFinder finder(a, b, mRadius, mReach);
        KnownVoxels known{leaf.origin(), Leaf::NodeMaskType(mRadius == 0)};
        LeafVoxels unsettled{leaf.origin(), {}}, filleted{leaf.origin(), {}};
        for (auto it = voxels.beginOn(); it; ++it) {
            const openvdb::Index i = it.pos();
            const Coord at = leaf.offsetToGlobalCoord(i);
            const float least = std::min(a.valueAt(at), b.valueAt(at));
            if (least > highest) continue;
            if (least <= deepest) {
                known.exact.setOff(i);
                continue;
            }
            const CreaseFinder::Answer answer = finder.find(at);
            if (mRadius == 0 && !isPlaced(answer)) {
                known.unplaced.setOn(i);
                known.exact.setOff(i);
                known.isSuspect = true;
                // A guess, so deep that the surface is not measured by it.
                if (answer.place == CreaseFinder::Place::Crease && least < -kDeep)
                    place(answer, i, leaf);
                // Between two touching solids values are 0, and all is inside.
                if (answer.place == CreaseFinder::Place::Buried && least >= 0)
                    leaf.setValueOnly(i, -mSigns.result * std::numeric_limits<float>::min());
                continue;
            }
            known.placed.setOn(i);
            const bool isKnown = place(answer, i, leaf);
            const bool isCrease = answer.place == CreaseFinder::Place::Crease;
            if (mRadius > 0 && isCrease && answer.isSure)
                filleted.voxels.setOn(i);
            else if (mRadius > 0 && (isCrease || !isKnown))
                unsettled.voxels.setOn(i);
            known.isSuspect |= !isKnown;
            known.exact.set(i, isKnown && (mRadius == 0 || answer.isSure));
            if (least >= 0 && mSigns.result * leaf.getValue(i) < 0) mFilled.push_back(at);
        }
        if (mRadius == 0 || known.isSuspect || !filleted.voxels.isOff()) mKnown.push_back(known);
        if (!filleted.voxels.isOff()) mFilleted.push_back(filleted);
        if (!unsettled.voxels.isOff()) mUnsettled.push_back(unsettled);
    }

    /// Whether the answer gives a sharp union's value.
    static bool isPlaced(const CreaseFinder::Answer& answer)
    {
        return answer.place == CreaseFinder::Place::Surface ||
               (answer.place == CreaseFinder::Place::Crease && answer.isSure);
    }

    /// A box that holds all places where a solid, or its complement, can block a ball that touches
    /// the other one.
    CoordBBox obstacleBox(const FloatTree& tree, float sign) const
    {
        if (mRadius == 0) return {};
        if (sign < 0) return CoordBBox::inf();
        CoordBBox box = boxOf(tree);
        box.expand(int(std::ceil(2 * mRadius)));
        return box;
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

    /// A leaf's voxels of the fillet, and those of them with a value from a crease.
    struct FilletLeaf {
        Coord origin;
        Leaf::NodeMaskType voxels, byCrease;
    };

    /// The fillet's leaves, in order.
    std::vector<FilletLeaf> filletByLeaf() const
    {
        std::vector<FilletLeaf> parts;
        for (const LeafVoxels& leaf : mUnsettled) parts.push_back({leaf.origin, leaf.voxels, {}});
        for (const LeafVoxels& leaf : mFilleted)
            parts.push_back({leaf.origin, leaf.voxels, leaf.voxels});
        std::sort(parts.begin(), parts.end(),
                  [](const FilletLeaf& l, const FilletLeaf& r) { return l.origin < r.origin; });
        std::vector<FilletLeaf> leaves;
        for (const FilletLeaf& part : parts) {
            if (leaves.empty() || leaves.back().origin != part.origin)
                leaves.push_back({part.origin, {}, {}});
            leaves.back().voxels |= part.voxels;
            leaves.back().byCrease |= part.byCrease;
        }
        return leaves;
    }

    /// Sets a voxel of the fillet. The ball also bridges the hollows of either solid alone: the
    /// fillet is by how much @a farther, in voxels, it stays from both.
    /// @param isByCrease  whether the leaf has a value from a crease.
    /// @return whether the fillet changes the voxel.
    bool settle(float farther, bool isByCrease, openvdb::Index voxel, Leaf& leaf) const
    {
        // The error of the measured distances, voxels. [tuned: combine_test]
        constexpr float kMaxRoomError = 0.02f;
        // The difference, in voxels, up to which a crease's value, which is more exact, is kept.
        // [tuned: combine_test]
        constexpr float kMaxCreaseDifference = 0.3f;
        const Coord at = leaf.offsetToGlobalCoord(voxel);
        const float least = std::min(mSigns.a * mA.getValue(at), mSigns.b * mB.getValue(at));
        const float creaseValue = mSigns.result * leaf.getValue(voxel);
        const auto inBand = [&](float v) { return std::max(v, -mDeepest); };
        float value = farther > kMaxRoomError ? least - farther * mVoxelSize : least;
        if (isByCrease && inBand(value) - inBand(creaseValue) < kMaxCreaseDifference * mVoxelSize)
            value = creaseValue;
        if (value > -mDeepest)
            leaf.setValueOn(voxel, mSigns.result * value);
        else
            leaf.setValueOff(voxel, -mSigns.result * mBackground);
        if (least >= 0 && value < 0) mFilled.push_back(at);
        return value != least;
    }

    const FloatTree &mA, &mB;
    Signs mSigns;
    float mBackground, mVoxelSize;          ///< world units
    float mDeepest;                         ///< depth of the result's band, world units
    float mRadius, mReach;                  ///< voxels; the reach is to the ball's path
    CoordBBox mFilletBox;                   ///< holds all of the fillet
    CoordBBox mObstacleBoxA, mObstacleBoxB; ///< where a solid may block a ball; see obstacleBox()
    mutable tbb::concurrent_vector<KnownVoxels> mKnown;    ///< in any order
    mutable tbb::concurrent_vector<LeafVoxels> mUnsettled; ///< of a fillet, in any order
    mutable tbb::concurrent_vector<LeafVoxels> mFilleted;  ///< in any order
    mutable tbb::concurrent_vector<Coord> mFilled;         ///< in any order
};

/// OpenVDB's merge of nodes and tiles, with LeafCombiner's leaves, and interruptible.
template <typename Merge>
struct Merger {
    const Merge& merge;
    const LeafCombiner& leaves;
    Interrupter& progress;

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
               Interrupter& progress)
{
    const Merge merge(other, openvdb::DeepCopy());
    openvdb::tree::DynamicNodeManager<FloatTree> nodes(tree);
    nodes.foreachTopDown(Merger<Merge>{merge, leaves, progress});
}

} // namespace

CsgTree csgTree(Boolean kind, const FloatTree& a, const FloatTree& b, double voxelSize,
                double halfWidth, double radius, Interrupter& progress)
{
    const LeafCombiner leaves(kind, a, b, voxelSize, halfWidth, radius);
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
    const std::vector<Coord> corrected = fillCavities(*tree, leaves.fill(), progress);
    CsgTree result{tree, leaves.filleted(), leaves.known(),
                   !corrected.empty() || leaves.isFilletUncertain(), leaves.removed()};
    for (const Coord& at : corrected) {
        result.filleted.push_back({at & ~(int(Leaf::DIM) - 1), {}});
        result.filleted.back().voxels.setOn(Leaf::coordToOffset(at));
    }
    return result;
}

} // namespace mpuvdb
