// An opening is the closing of the complements: everything here is about unions.
#include "fillet.h"

#include "ball_room.h"
#include "core/parallel_each.h"

#include <algorithm>
#include <cmath>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

constexpr int kDim = int(Leaf::DIM); ///< edge of a leaf, voxels [derived: OpenVDB's leaves]

/// A part that the ball has removed for lack of room.
struct Removed {
    float radius = 0;
    Coord middle;

    void add(float itsRadius, const Coord& at)
    {
        if (itsRadius < radius || (itsRadius == radius && !(at < middle))) return;
        radius = itsRadius;
        middle = at;
    }
};

/// What has become of a leaf.
struct FilledLeaf {
    std::unique_ptr<Leaf> leaf; ///< null: unchanged, or a tile
    bool isTile = false;        ///< all solid
    openvdb::CoordBBox changed;
    KnownVoxels known; ///< suspect where values are no distances
    Removed removed;
};

/// Fills leaves of a union.
class Filler
{
public:
    /// @param side  by which values of @a sharp become those of a union.
    Filler(FloatTree& sharp, const BallRoom& room, float side, double voxelSize, float halfWidth)
        : mSharp(sharp), mRoom(room), mSide(side), mVoxelSize(float(voxelSize)),
          mHalfWidth(halfWidth)
    {
    }

    FilledLeaf fill(const Coord& origin) const
    {
        FilledLeaf filled;
        filled.known = {origin, KnownVoxels::Mask(true)};
        const Leaf* const old = mSharp.probeConstLeaf(origin);
        if (!old && mSide * mSharp.getValue(origin) < 0) return filled;
        const BallRoom::Whole whole = mRoom.wholeLeaf(origin);
        if (whole == BallRoom::Whole::Kept) return filled;
        filled.isTile = whole == BallRoom::Whole::Full;
        auto leaf = old ? std::make_unique<Leaf>(*old)
                        : std::make_unique<Leaf>(origin, mSharp.getValue(origin));
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
            const Coord at = leaf->offsetToGlobalCoord(n);
            const float sharp = mSide * leaf->getValue(n) / mVoxelSize;
            if (sharp <= -mHalfWidth) continue;
            const std::optional<BallRoom::Fill> fill =
                filled.isTile ? BallRoom::Fill{-mHalfWidth, true} : mRoom.fillAt(at, sharp);
            if (!fill) continue;
            filled.changed.expand(at);
            if (!fill->isDistance) filled.known.exact.setOff(n);
            if (fill->value > -mHalfWidth)
                leaf->setValueOn(n, mSide * fill->value * mVoxelSize);
            else
                leaf->setValueOff(n, -mSide * mSharp.background());
            if (mSide < 0 && sharp >= 0 && fill->value < 0)
                filled.removed.add(mRoom.roomBetween(at), at);
        }
        filled.known.isSuspect = !filled.known.exact.isOn();
        if (!filled.isTile && !filled.changed.empty()) filled.leaf = std::move(leaf);
        return filled;
    }

    /// Put the leaf into the tree.
    void put(const Coord& origin, FilledLeaf& filled)
    {
        if (filled.isTile)
            mSharp.addTile(1, origin, -mSide * mSharp.background(), false);
        else if (filled.leaf)
            mSharp.addLeaf(filled.leaf.release());
    }

private:
    FloatTree& mSharp;
    const BallRoom& mRoom;
    float mSide, mVoxelSize, mHalfWidth;
};

/// Call f(origin) for the leaf at @a origin and those beside voxels of it in @a changed.
template <typename F>
void forEachReached(const Coord& origin, const openvdb::CoordBBox& changed, F f)
{
    Coord low, high;
    for (int axis = 0; axis < 3; ++axis) {
        low[axis] = changed.min()[axis] == origin[axis] ? -1 : 0;
        high[axis] = changed.max()[axis] == origin[axis] + kDim - 1 ? 1 : 0;
    }
    for (int x = low[0]; x <= high[0]; ++x)
        for (int y = low[1]; y <= high[1]; ++y)
            for (int z = low[2]; z <= high[2]; ++z)
                f(origin.offsetBy(x * kDim, y * kDim, z * kDim));
}

/// An order of two trees that depends on their values alone.
bool before(const FloatTree& a, const FloatTree& b)
{
    auto leafA = a.cbeginLeaf(), leafB = b.cbeginLeaf();
    for (; leafA && leafB; ++leafA, ++leafB) {
        if (leafA->origin() != leafB->origin()) return leafA->origin() < leafB->origin();
        const float *const as = leafA->buffer().data(), *const bs = leafB->buffer().data();
        if (!std::equal(as, as + Leaf::SIZE, bs))
            return std::lexicographical_compare(as, as + Leaf::SIZE, bs, bs + Leaf::SIZE);
    }
    return bool(leafB);
}

} // namespace

FilletReport fillet(FloatTree& sharp, Boolean kind, const FloatTree& a, const FloatTree& b,
                    double voxelSize, double halfWidth, double radius, Interrupter& progress)
{
    const float side = kind == Boolean::Union ? 1 : -1;
    BallSolid one{a, side}, other{b, kind == Boolean::Intersection ? -1.0f : 1.0f};
    // The same to the bit if the solids change places.
    const bool swaps = kind != Boolean::Difference && before(b, a);
    const BallRoom room(swaps ? other : one, swaps ? one : other, voxelSize,
                        float(radius / voxelSize), float(halfWidth), progress);
    Filler filler(sharp, room, side, voxelSize, float(halfWidth));
    FilletReport report;
    report.isTooNarrow = room.isTooNarrow();
    Removed removed;
    std::vector<Coord> wave = room.unreached();
    std::unordered_set<Coord> seen(wave.begin(), wave.end());
    while (!wave.empty()) {
        std::vector<FilledLeaf> filled(wave.size());
        forEachParallel(wave.size(), 1, progress,
                        [&](std::size_t n) { filled[n] = filler.fill(wave[n]); });
        std::vector<Coord> next;
        for (std::size_t n = 0; n < wave.size(); ++n) {
            filler.put(wave[n], filled[n]);
            if (filled[n].changed.empty()) continue;
            report.hasChanged = true;
            if (filled[n].known.isSuspect) report.suspects.push_back(filled[n].known);
            removed.add(filled[n].removed.radius, filled[n].removed.middle);
            forEachReached(wave[n], filled[n].changed, [&](const Coord& origin) {
                if (seen.insert(origin).second) next.push_back(origin);
            });
        }
        wave.swap(next);
    }
    std::sort(report.suspects.begin(), report.suspects.end(),
              [](const KnownVoxels& l, const KnownVoxels& r) { return l.origin < r.origin; });
    report.removedRadius = removed.radius;
    report.removed = removed.middle;
    return report;
}

} // namespace mpuvdb
