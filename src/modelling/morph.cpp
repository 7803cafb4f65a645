// Surfaces between two others.
#include "grid/band_limits.h"
#include "grid/prune.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>
#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tree/LeafManager.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::BoolTree;
using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;
using LeafManager = openvdb::tree::LeafManager<FloatTree>;
using ConstAccess = openvdb::tree::ValueAccessor<const FloatTree>;

/// @a levelSet in a band of twice @a halfWidth voxels, which is doubled.
LevelSet wider(const LevelSet& levelSet, double& halfWidth, Interrupter& progress)
{
    if (halfWidth >= kMaxHalfWidth)
        throw LimitError(fmt::format("morph: the shapes differ by more than {} voxels of {:g}, "
                                     "more than a band can be wide. Use larger voxels",
                                     kMaxHalfWidth, levelSet.voxelSize()));
    halfWidth = std::min(2 * halfWidth, kMaxHalfWidth);
    return withHalfWidth(levelSet, halfWidth, &progress);
}

/// The voxels and tiles that are inside one of the two only.
BoolTree::Ptr difference(const LevelSet& a, const LevelSet& b)
{
    const auto inA = openvdb::tools::sdfInteriorMask(a.grid(), 0.0f);
    const auto inB = openvdb::tools::sdfInteriorMask(b.grid(), 0.0f);
    auto differ = std::make_shared<BoolTree>(inA->tree());
    differ->topologyDifference(inB->tree());
    BoolTree& onlyB = inB->tree();
    onlyB.topologyDifference(inA->tree());
    differ->topologyUnion(onlyB);
    return differ;
}

bool hasActive(const BoolTree& tree)
{
    openvdb::CoordBBox box;
    return tree.evalActiveVoxelBoundingBox(box);
}

/// @a f(value of a, value of b) where either band is active, with the background of @a halfWidth
/// voxels: values beyond it are inactive. Elsewhere both have one sign, and so has the result.
template <typename F>
FloatTree::Ptr joined(const LevelSet& a, const LevelSet& b, double halfWidth, Interrupter& progress,
                      F f)
{
    const auto tree = std::make_shared<FloatTree>(a.grid().tree());
    tree->topologyUnion(b.grid().tree());
    const float background = float(halfWidth * a.voxelSize());
    LeafManager leaves(*tree);
    leaves.foreach ([&](Leaf& leaf, std::size_t) {
        progress.check();
        ConstAccess other(b.grid().tree());
        const Leaf* const otherLeaf = other.probeConstLeaf(leaf.origin());
        const float tile = other.getValue(leaf.origin());
        for (auto voxel = leaf.beginValueOn(); voxel; ++voxel) {
            const float v = f(*voxel, otherLeaf ? otherLeaf->getValue(voxel.pos()) : tile);
            if (std::abs(v) < background)
                voxel.setValue(v);
            else
                leaf.setValueOff(voxel.pos(), std::copysign(background, v));
        }
    });
    openvdb::tools::changeLevelSetBackground(*tree, background);
    pruneBand(*tree);
    return tree;
}

/// The function (1-t) a + t b, and whether bands of this width determine its zero set: where the
/// solids differ, the sign of a value beyond its band must be that of the result, and no value
/// beside a crossing may lie beyond its band.
class LinearMorph
{
public:
    LinearMorph(const LevelSet& a, const LevelSet& b, double t, Interrupter& progress)
        : mA(a), mB(b), mT(float(t)), mProgress(progress)
    {
    }

    bool isKnown() const
    {
        const BoolTree::Ptr unknown = difference(mA, mB);
        mProgress.check();
        unknown->topologyDifference(mA.grid().tree());
        unknown->topologyDifference(mB.grid().tree());
        if (hasActive(*unknown)) return false;
        return isKnown(mA.grid().tree(), mB.grid().tree()) &&
               isKnown(mB.grid().tree(), mA.grid().tree());
    }

    float operator()(float a, float b) const { return (1 - mT) * a + mT * b; }

private:
    /// Whether it is known on the active voxels of @a band, one of the two.
    bool isKnown(const FloatTree& band, const FloatTree& other) const
    {
        std::vector<const Leaf*> leaves;
        band.getNodes(leaves);
        std::atomic<bool> known{true};
        tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
            mProgress.check();
            if (!known.load(std::memory_order_relaxed)) return;
            ConstAccess ofA(mA.grid().tree()), ofB(mB.grid().tree()), beyond(other);
            if (const Leaf* twin = beyond.probeConstLeaf(leaves[n]->origin()))
                if (leaves[n]->getValueMask() == twin->getValueMask()) return;
            for (auto voxel = leaves[n]->cbeginValueOn(); voxel; ++voxel)
                if (!beyond.isValueOn(voxel.getCoord()) &&
                    !isSettled(ofA, ofB, beyond, voxel.getCoord())) {
                    known = false;
                    return;
                }
        });
        return known;
    }

    /// Whether the result's sign is known at a voxel with a value beyond the band of @a beyond.
    bool isSettled(const ConstAccess& ofA, const ConstAccess& ofB, const ConstAccess& beyond,
                   const Coord& at) const
    {
        const bool inside = (*this)(ofA.getValue(at), ofB.getValue(at)) < 0;
        const bool differ = (ofA.getValue(at) < 0) != (ofB.getValue(at) < 0);
        if (differ && inside != (beyond.getValue(at) < 0)) return false;
        for (int n = 0; n < 6; ++n) {
            Coord next = at;
            next[n / 2] += n % 2 ? 1 : -1;
            if (((*this)(ofA.getValue(next), ofB.getValue(next)) < 0) != inside) return false;
        }
        return true;
    }

    const LevelSet &mA, &mB;
    float mT;
    Interrupter& mProgress;
};

/// The largest |distance| of @a a over the voxels of @a where, all of which are in its band.
double largestDistance(const LevelSet& a, const BoolTree& where, Interrupter& progress)
{
    std::vector<const Leaf*> leaves;
    a.grid().tree().getNodes(leaves);
    return double(tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, leaves.size(), 64), 0.0f,
        [&](const tbb::blocked_range<std::size_t>& range, float largest) {
            openvdb::tree::ValueAccessor<const BoolTree> chosen(where);
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                progress.check();
                for (auto voxel = leaves[n]->cbeginValueOn(); voxel; ++voxel)
                    if (chosen.isValueOn(voxel.getCoord()))
                        largest = std::max(largest, std::abs(*voxel));
            }
            return largest;
        },
        [](float u, float v) { return std::max(u, v); }));
}

/// The linear morph, from bands as wide as its zero set at @a t needs: about the largest distance
/// of either input on that zero set. They take about 8 bytes per voxel between the shapes.
FloatTree::Ptr linear(LevelSet a, LevelSet b, double t, double halfWidth, Interrupter& progress)
{
    for (double width = halfWidth;;) {
        const LinearMorph at(a, b, t, progress);
        if (at.isKnown()) return joined(a, b, halfWidth, progress, at);
        double same = width;
        a = wider(a, width, progress);
        b = wider(b, same, progress);
    }
}

/// The front that starts at the surface of @a a at speed one and stops at that of @a b, in closed
/// form: b clamped to within s of a after the time s. Only a's band is widened, to the largest
/// distance that the front travels.
FloatTree::Ptr advected(LevelSet a, const LevelSet& b, double t, double halfWidth,
                        Interrupter& progress)
{
    const BoolTree::Ptr between = difference(a, b);
    for (double width = halfWidth;; a = wider(a, width, progress)) {
        BoolTree beyond(*between);
        beyond.topologyDifference(a.grid().tree());
        if (!hasActive(beyond)) break;
    }
    const double farthest = largestDistance(a, *between, progress), h = a.voxelSize();
    // Voxels beyond those that the front passes. [derived: the neighbors of its crossings, and one
    // for rounding]
    constexpr double kFrontMargin = 2;
    if (const double width = farthest / h + kFrontMargin; width > a.halfWidth())
        a = withHalfWidth(a, width, &progress);
    const auto s = float(t * farthest);
    return joined(a, b, halfWidth, progress,
                  [s](float u, float v) { return std::clamp(v, u - s, u + s); });
}

} // namespace

LevelSet morph(const LevelSet& a, const LevelSet& b, double t, Morphing how,
               Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!(t >= 0 && t <= 1))
        throw UsageError(fmt::format("morph: t is {}; it must be in [0, 1], 0 for the first shape "
                                     "and 1 for the second",
                                     t));
    std::vector<LevelSet> both = onOneLattice({a, b}, 0, &progress).levelSets;
    const double halfWidth = std::max(both[0].halfWidth(), both[1].halfWidth());
    for (LevelSet& one : both)
        if (one.halfWidth() < halfWidth) one = withHalfWidth(one, halfWidth, &progress);
    if (t == 0) return both[0];
    if (t == 1) return both[1];
    const FloatGrid::Ptr grid =
        openvdb::gridPtrCast<FloatGrid>(both[0].grid().copyGridWithNewTree());
    // An empty solid is infinitely far from everything.
    const bool nothing = both[0].grid().empty() || both[1].grid().empty();
    if (nothing)
        grid->setTree(std::make_shared<FloatTree>(both[0].grid().background()));
    else if (how == Morphing::Linear)
        grid->setTree(linear(both[0], both[1], t, halfWidth, progress));
    else
        grid->setTree(advected(both[0], both[1], t, halfWidth, progress));
    return nothing ? LevelSet(grid) : redistance(*grid, halfWidth, &progress);
}

} // namespace mpuvdb
