#include "restore_distance.h"

#include "grid/leaf_halo.h"
#include "row_flags.h"
#include "surface/leaf_crossings.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <openvdb/tree/LeafManager.h>
#include <tbb/parallel_for.h>
#include <unordered_map>
#include <unordered_set>
#include <vector>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;
using Halo = LeafHalo; ///< in voxels
using openvdb::Coord;

/// Largest excess of the distance to the nearest crossing over the distance, voxels, between
/// crossings. [tuned: sample_field_test]
constexpr float kCrossingExcess = 0.5f;
/// Differences from that distance, upwards and downwards, voxels, with which an examined value
/// stays. [tuned: sample_field_test]
constexpr float kAbove = 0.2f, kBelow = 0.35f;
/// Values, voxels, at which the tip of an edge or corner may pass between voxels without a
/// crossing: they are raised no higher than their neighbors allow. [tuned: sharp_mesh_test]
constexpr float kTip = 0.5f;
/// Depth inside the band, voxels, by a neighbor's value, from which on a voxel is added however far
/// the nearest crossing is. [tuned: sample_field_test]
constexpr float kCertainDepth = 0.5f;
/// Smallest upwind gradients that are not examined, of approximate and of computed distances. A
/// field's errors are coherent: what a lower one let pass would be found later, beside what was
/// restored, voxel by voxel along an edge. [derived: over the three voxels of a band, the loss adds
/// up to kAbove]
constexpr float kMinFieldSlope = 0.93f;
/// [derived: 0.55 at a corner, rounded down]
constexpr float kMinSlope = 0.5f;
/// Times that a field's changed places are examined: what is changed tells on values up to two
/// voxels farther each time, and a leaf about a region that is sampled alone is examined with it.
/// [derived: 2 n - 1 voxels, and one more of those added in the end, are eight at most]
constexpr int kFieldRounds = 4;

class Restorer
{
public:
    Restorer(openvdb::FloatTree& tree, double voxelSize, ValuesFrom from, Interrupter& progress)
        : mTree(tree), mProgress(progress), mFrom(from), mVoxelSize(float(voxelSize)),
          mHalfWidth(tree.background() / float(voxelSize)),
          mMinSlope(from == ValuesFrom::Field ? kMinFieldSlope : kMinSlope),
          mRounds(from == ValuesFrom::Field ? kFieldRounds : std::numeric_limits<int>::max()),
          mFarthest(mHalfWidth + kCrossingExcess),
          mReach((int(std::ceil(mFarthest)) + kBlockDim - 1) / kBlockDim)
    {
    }

    std::uint64_t run(const openvdb::CoordBBox& among)
    {
        mAmong = among;
        std::vector<Leaf*> all;
        mTree.getNodes(all);
        return run(examinable(std::move(all)));
    }

    std::uint64_t run(const std::vector<KnownVoxels>& known)
    {
        mKnown = &known;
        LeafSet origins;
        for (const KnownVoxels& leaf : known) {
            if (!leaf.isSuspect) continue;
            addLeavesAround(leaf.origin, origins);
            addLeavesAround(leaf.origin.offsetBy(kBlockDim - 1), origins);
        }
        return run(leavesAt(origins));
    }

private:
    std::uint64_t run(std::vector<Leaf*> work)
    {
        std::uint64_t changed = 0;
        for (int round = 0; !work.empty() && round < mRounds; ++round) {
            std::vector<std::vector<Examined>> found(work.size());
            forEach(work, [&](std::size_t n) { found[n] = examine(*work[n]); });
            collectCrossings(found);
            forEach(work, [&](std::size_t n) {
                for (Examined& voxel : found[n]) voxel.distance = nearestCrossing(voxel.at);
            });
            work = apply(found, changed);
        }
        std::size_t added = addCertain();
        for (changed += added; added > 0 && mFrom == ValuesFrom::Distances; changed += added)
            added = addCertain();
        return changed;
    }

    using LeafSet = std::unordered_set<Coord>; ///< by origin

    struct Examined {
        Coord at;
        float distance;                                        ///< voxels
        float scaled = std::numeric_limits<float>::infinity(); ///< value, voxels; infinite: none
    };

    template <typename F>
    void forEach(const std::vector<Leaf*>& leaves, F f)
    {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 16),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              mProgress.check();
                              for (std::size_t n = range.begin(); n < range.end(); ++n) f(n);
                          });
    }

    /// Voxels in the leaf, or in missing leaves beside it, whose values may be wrong.
    std::vector<Examined> examine(const Leaf& leaf) const
    {
        openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(mTree);
        Halo halo;
        halo.load(access, leaf.origin(), 1 / mVoxelSize);
        const Leaf::NodeMaskType exact = exactIn(leaf.origin());
        std::vector<Examined> found, suspects; // exact voxels of the first stay
        for (int x = 0; x < kBlockDim; ++x) {
            for (int y = 0; y < kBlockDim; ++y) {
                const int row = Halo::index(x, y, 0);
                const float* const values = &halo.value[row];
                const auto inLeaf = openvdb::Index(x * kBlockDim + y);
                const unsigned active = leaf.getValueMask().getWord<std::uint8_t>(inLeaf);
                RowFlags flags;
                if (active != 0) flags = examineRow(values, mHalfWidth, mMinSlope);
                if (active != 0xff) flags.missing = missingInRow(values, mHalfWidth);
                flags.suspect |= flags.flat & ~unsigned(exact.getWord<std::uint8_t>(inLeaf));
                flags.suspect &= active;
                flags.cornerMissing &= active;
                flags.missing &= ~active;
                flags.steep &= mFrom == ValuesFrom::Field ? active : 0;
                flags.suspect &= ~flags.steep;
                if ((flags.suspect | flags.cornerMissing | flags.missing | flags.steep) == 0)
                    continue;
                for (int z = 0; z < kBlockDim; ++z) {
                    const Coord at = leaf.origin() + Coord(x, y, z);
                    if (flags.cornerMissing >> z & 1u) addCorners(at, found);
                    if (flags.suspect >> z & 1u) suspects.push_back({at, 0});
                    if (flags.steep >> z & 1u)
                        suspects.push_back(
                            {at, 0, scaledDown(values[z], flags.slope[std::size_t(z)])});
                    if (flags.missing >> z & 1u) addMissing(halo, at, row + z, found);
                }
            }
        }
        addMissingBeside(access, leaf, found);
        const auto byPlace = [](const Examined& a, const Examined& b) {
            return a.at != b.at ? a.at < b.at : a.scaled < b.scaled;
        };
        const auto same = [](const Examined& a, const Examined& b) { return a.at == b.at; };
        std::sort(found.begin(), found.end(), byPlace);
        found.erase(std::unique(found.begin(), found.end(), same), found.end());
        const auto drop = [&](const auto& which) {
            found.erase(std::remove_if(found.begin(), found.end(), which), found.end());
        };
        drop([&](const Examined& v) { return isExact(access, v.at); });
        found.insert(found.end(), suspects.begin(), suspects.end());
        std::sort(found.begin(), found.end(), byPlace);
        found.erase(std::unique(found.begin(), found.end(), same), found.end());
        drop([&](const Examined& v) { return isSettled(v.at); });
        found.shrink_to_fit(); // most were found several times, and all leaves' are kept
        return found;
    }

    /// Add voxels of tiles beside the leaf that belong to the band.
    void addMissingBeside(const openvdb::tree::ValueAccessor<const openvdb::FloatTree>& access,
                          const Leaf& leaf, std::vector<Examined>& found) const
    {
        for (int n = 0; n < 27; ++n) {
            const Coord side(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            if (n == 13 || access.probeConstLeaf(leaf.origin() + Coord(side[0] * kBlockDim,
                                                                       side[1] * kBlockDim,
                                                                       side[2] * kBlockDim)))
                continue;
            // The leaf's voxels that touch that side, each with its neighbors there.
            const auto first = [&](int axis) { return side[axis] > 0 ? kBlockDim - 1 : 0; };
            const auto last = [&](int axis) { return side[axis] < 0 ? 0 : kBlockDim - 1; };
            for (int x = first(0); x <= last(0); ++x)
                for (int y = first(1); y <= last(1); ++y)
                    for (int z = first(2); z <= last(2); ++z)
                        addBeyond(leaf, Coord(x, y, z), side, found);
        }
    }

    void addBeyond(const Leaf& leaf, const Coord& in, const Coord& side,
                   std::vector<Examined>& found) const
    {
        const float a = std::abs(leaf.getValue(leaf.origin() + in)) / mVoxelSize;
        if (a + 1 >= mHalfWidth - kMissingDepth) return;
        for (int n = 0; n < 27; ++n) {
            const Coord to = in + Coord(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            if (Coord(to[0] >> 3, to[1] >> 3, to[2] >> 3) == side)
                found.push_back({leaf.origin() + to, 0});
        }
    }

    /// The voxels of a leaf that are known to be exact.
    Leaf::NodeMaskType exactIn(const Coord& origin) const
    {
        if (!mKnown) return {};
        const auto found = std::lower_bound(
            mKnown->begin(), mKnown->end(), origin,
            [](const KnownVoxels& leaf, const Coord& place) { return leaf.origin < place; });
        if (found == mKnown->end() || found->origin != origin) return Leaf::NodeMaskType(true);
        return found->exact;
    }

    bool isExact(const openvdb::tree::ValueAccessor<const openvdb::FloatTree>& access,
                 const Coord& at) const
    {
        return mKnown && access.isValueOn(at) && exactIn(at & ~7).isOn(Leaf::coordToOffset(at));
    }

    bool isSettled(const Coord& at) const
    {
        const auto found = mSettled.find(at & ~7);
        return found != mSettled.end() && found->second.isOn(Leaf::coordToOffset(at));
    }

    static void addCorners(const Coord& at, std::vector<Examined>& found)
    {
        found.push_back({at, 0});
        for (int n = 0; n < 8; ++n)
            found.push_back({at + Coord(n & 1 ? 1 : -1, n & 2 ? 1 : -1, n & 4 ? 1 : -1), 0});
    }

    /// Add an inactive voxel that its neighbors' values put inside the band, and those neighbors,
    /// one of which may be wrong.
    void addMissing(const Halo& halo, const Coord& at, int in, std::vector<Examined>& found) const
    {
        for (int n = 0; n < 27; ++n) {
            const Coord d(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            const float u =
                std::abs(halo[in + d[0] * Halo::kStride[0] + d[1] * Halo::kStride[1] + d[2]]);
            if (u + kNeighborDistance[std::abs(d[0]) + std::abs(d[1]) + std::abs(d[2])] <
                mHalfWidth - kMissingDepth)
                found.push_back({at + d, 0});
        }
        found.push_back({at, 0});
    }

    /// Collect the crossings that may be nearest to the found voxels.
    void collectCrossings(const std::vector<std::vector<Examined>>& found)
    {
        LeafSet homes, wanted;
        for (const auto& voxels : found)
            for (const Examined& voxel : voxels) homes.insert(voxel.at & ~7);
        for (const Coord& home : homes)
            forEachWithinReach(home, [&](const Coord& origin) {
                if (!mCrossings.count(origin)) wanted.insert(origin);
            });
        const std::vector<Leaf*> leaves = leavesAt(wanted);
        std::vector<Crossings> crossings(leaves.size());
        forEach(leaves, [&](std::size_t n) { crossings[n] = crossingsOf(mTree, *leaves[n]); });
        for (std::size_t n = 0; n < leaves.size(); ++n)
            mCrossings.emplace(leaves[n]->origin(), std::move(crossings[n]));
    }

    template <typename F>
    void forEachWithinReach(const Coord& home, F f) const
    {
        for (int x = -mReach; x <= mReach; ++x)
            for (int y = -mReach; y <= mReach; ++y)
                for (int z = -mReach; z <= mReach; ++z)
                    f(home + Coord(x * kBlockDim, y * kBlockDim, z * kBlockDim));
    }

    /// Distance from a voxel to the nearest crossing, voxels; mFarthest if none is nearer.
    float nearestCrossing(const Coord& at) const
    {
        const Coord home = at & ~7;
        float best2 = mFarthest * mFarthest;
        forEachWithinReach(home, [&](const Coord& origin) {
            const Coord r = at - origin;
            if (squaredGap(r) >= best2) return;
            const auto crossings = mCrossings.find(origin);
            if (crossings == mCrossings.end()) return;
            const Vec3f here = toVec(r);
            for (const Vec3f& p : crossings->second)
                best2 = std::min(best2, (p - here).squaredNorm());
        });
        return std::sqrt(best2);
    }

    /// Write the new values; returns the leaves to examine again.
    std::vector<Leaf*> apply(const std::vector<std::vector<Examined>>& found,
                             std::uint64_t& changed)
    {
        openvdb::tree::ValueAccessor<openvdb::FloatTree> access(mTree);
        LeafSet touched;
        Coord home;
        Leaf::NodeMaskType* settled = nullptr; // of the leaf at home
        for (const auto& voxels : found) {
            for (const Examined& voxel : voxels) {
                if (!settled || (voxel.at & ~7) != home) {
                    home = voxel.at & ~7;
                    settled = &mSettled[home];
                }
                settled->setOn(Leaf::coordToOffset(voxel.at));
                float old = 0;
                const bool active = access.probeValue(voxel.at, old);
                const float a = std::abs(old) / mVoxelSize;
                const float distance = active ? corrected(a, voxel) : voxel.distance;
                const bool beyond = distance >= mHalfWidth * (1 - 1e-6f);
                if (active ? distance == a : beyond) continue;
                if (!beyond) access.setValueOn(voxel.at, std::copysign(distance * mVoxelSize, old));
                // At the band's rim others stay, unless nothing crosses near them.
                else if (a < mHalfWidth - 0.5f || voxel.distance >= mFarthest)
                    access.setValueOff(voxel.at, std::copysign(mTree.background(), old));
                else
                    continue;
                ++changed;
                addLeavesAround(voxel.at, touched);
            }
        }
        return examinable(leavesAt(touched));
    }

    std::vector<Leaf*> examinable(std::vector<Leaf*> leaves) const
    {
        const auto isBeyond = [&](const Leaf* l) { return !mAmong.isInside(l->origin()); };
        leaves.erase(std::remove_if(leaves.begin(), leaves.end(), isBeyond), leaves.end());
        return leaves;
    }

    /// The existing leaves at @a origins, in order.
    std::vector<Leaf*> leavesAt(const LeafSet& origins)
    {
        std::vector<Coord> inOrder(origins.begin(), origins.end());
        std::sort(inOrder.begin(), inOrder.end());
        openvdb::tree::ValueAccessor<openvdb::FloatTree> access(mTree);
        std::vector<Leaf*> leaves;
        for (const Coord& origin : inOrder)
            if (Leaf* leaf = access.probeLeaf(origin)) leaves.push_back(leaf);
        return leaves;
    }

    /// Add voxels that are too far from crossings, but well inside the band by their neighbors'
    /// values. Returns their number.
    std::size_t addCertain()
    {
        openvdb::tree::ValueAccessor<openvdb::FloatTree> access(mTree);
        std::vector<Examined> certain;
        for (const auto& [origin, settled] : mSettled) {
            mProgress.check();
            for (auto it = settled.beginOn(); it; ++it) {
                const Coord at = origin + Leaf::offsetToLocalCoord(it.pos());
                if (access.isValueOn(at)) continue;
                float least = mHalfWidth;
                for (int n = 0; n < 27; ++n) {
                    const Coord d(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
                    least = std::min(least, std::abs(access.getValue(at + d)) / mVoxelSize +
                                                d.asVec3s().length());
                }
                if (least < mHalfWidth - kCertainDepth) certain.push_back({at, least});
            }
        }
        for (const Examined& voxel : certain)
            access.setValueOn(
                voxel.at, std::copysign(voxel.distance * mVoxelSize, access.getValue(voxel.at)));
        return certain.size();
    }

    /// Origins of the leaves that hold a voxel or one of its neighbors.
    static void addLeavesAround(const Coord& at, LeafSet& origins)
    {
        const Coord low = at.offsetBy(-1) & ~7, high = at.offsetBy(1) & ~7;
        for (int x = low.x(); x <= high.x(); x += kBlockDim)
            for (int y = low.y(); y <= high.y(); y += kBlockDim)
                for (int z = low.z(); z <= high.z(); z += kBlockDim) origins.emplace(x, y, z);
    }

    /// The corrected value, voxels, given the distance to the nearest crossing.
    static float corrected(float value, const Examined& voxel)
    {
        const float distance = voxel.distance;
        if (std::isfinite(voxel.scaled)) {
            const float least =
                std::max(distance / kNeighborDistance[3], distance - kCrossingExcess);
            return std::clamp(voxel.scaled, least, distance);
        }
        if (value <= distance + kAbove && value >= distance - kBelow) return value;
        return value < kTip ? std::max(value, distance - kCrossingExcess) : distance;
    }

    openvdb::FloatTree& mTree;
    Interrupter& mProgress;
    ValuesFrom mFrom;
    const std::vector<KnownVoxels>* mKnown = nullptr;
    openvdb::CoordBBox mAmong = openvdb::CoordBBox::inf(); ///< of the leaves that are examined
    float mVoxelSize, mHalfWidth;                          ///< world units; voxels
    float mMinSlope;                                       ///< smallest that is not examined
    int mRounds;     ///< largest number of times that changed places are examined
    float mFarthest; ///< distance to crossings from which on a voxel is beyond the band, voxels
    int mReach;      ///< leaves that this is, around a voxel's own
    std::unordered_map<Coord, Crossings> mCrossings; ///< by leaf origin
    /// Voxels whose distance to the nearest crossing has been found: it will not change.
    std::unordered_map<Coord, Leaf::NodeMaskType> mSettled;
};

} // namespace

std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize, ValuesFrom from,
                              Interrupter& progress, const openvdb::CoordBBox& among)
{
    return Restorer(tree, voxelSize, from, progress).run(among);
}

std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize,
                              const std::vector<KnownVoxels>& known, Interrupter& progress)
{
    return Restorer(tree, voxelSize, ValuesFrom::Distances, progress).run(known);
}

std::uint64_t completeBand(openvdb::FloatTree& tree, double voxelSize, Interrupter& progress)
{
    std::vector<KnownVoxels> known;
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf)
        known.push_back({leaf->origin(), Leaf::NodeMaskType(true), true});
    std::sort(known.begin(), known.end(),
              [](const KnownVoxels& a, const KnownVoxels& b) { return a.origin < b.origin; });
    return restoreDistance(tree, voxelSize, known, progress);
}

} // namespace mpuvdb
