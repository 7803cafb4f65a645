// Handles: narrow tunnels through the inside, and narrow bridges across the outside, that no data
// hold up.
//
// A tunnel is found where closing the narrow gaps of the inside, and opening them again from their
// middle on as long as the topology stays, leaves a plug; a bridge is a tunnel through the outside.
#include "band.h"
#include "block_mosaic.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <map>
#include <queue>
#include <set>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

namespace mpuvdb
{
namespace
{

constexpr int kReach = 2; ///< half the width of a handle, voxels
/// Voxels: to move the surface by less takes no detail away that the voxels show.
constexpr double kShallow = 0.5;
/// So many points at a plug hold up what it would turn, however shallow it is. A wire that shallow
/// is as thin as a voxel: points as dense as voxels tell it from sheets that nearly touch.
constexpr std::size_t kManyPoints = 20;
/// A deep plug turns if it has fewer points than one in as many voxels.
constexpr std::size_t kVoxelsPerPoint = 8;
/// A wire is an object, even if it is thin. A bridge joins parts that are thicker: from each of its
/// ends so many steps lead to a voxel that lies so deep in them, in voxels.
constexpr int kBridgeSteps = 6;
constexpr double kDeep = 1.5;

/// Voxels whose turn to the other sign takes a handle away.
struct Plug {
    std::vector<VoxelId> voxels;
    bool inside;        ///< the voxels' sign before
    bool wire = false;  ///< part of something that is thin for longer than a bridge
    double cost = 0;    ///< how deep the voxels are in their side, together
    double deepest = 0; ///< of them
};

using BlockVoxels = std::map<std::size_t, SignWords>;

BlockVoxels byBlock(const std::vector<VoxelId>& voxels)
{
    BlockVoxels blocks;
    for (const VoxelId v : voxels)
        blocks[v / kBlockVoxels][v % kBlockVoxels / 64] |= std::uint64_t(1) << (v % 64);
    return blocks;
}

std::vector<SignWords> inverse(std::vector<SignWords> set)
{
    for (SignWords& words : set)
        for (std::uint64_t& w : words) w = ~w;
    return set;
}

/// What turning @a voxels, none of which is in @a set, adds to the set's Euler characteristic. They
/// are in the set afterwards.
int changeBy(const BlockMosaic& mosaic, std::vector<SignWords>& set,
             const std::vector<VoxelId>& voxels)
{
    int change = 0;
    for (const VoxelId v : voxels) {
        change += eulerChange(mosaic.neighborhood(set, v));
        turn(set, v);
    }
    return change;
}

/// The narrow gaps of a set, reduced to what keeps them closed.
class Gaps
{
public:
    Gaps(const BlockMosaic& mosaic, std::vector<SignWords> set, std::vector<SignWords> gaps)
        : mMosaic(mosaic), mSet(std::move(set)), mGaps(std::move(gaps))
    {
    }

    /// Open the gaps as long as the topology stays, from their middle on.
    /// @param depth  of a voxel outside of the set.
    template <typename Depth>
    void open(Depth depth, Interrupter& progress)
    {
        using Entry = std::pair<float, VoxelId>;
        std::vector<Entry> all;
        forEach(mGaps, [&](VoxelId v) { all.push_back({depth(v), v}); });
        std::sort(all.begin(), all.end(), std::greater<Entry>());
        for (const auto& [d, v] : all) turn(mSet, v);
        std::vector<SignWords> tried(mGaps.size());
        std::priority_queue<Entry> again;
        for (std::size_t n = 0; n < all.size(); ++n) {
            if (n % 4096 == 0) progress.check();
            for (again.push(all[n]); !again.empty();) {
                const VoxelId v = again.top().second;
                again.pop();
                const Neighborhood around = mMosaic.neighborhood(mSet, v);
                if (!isSimple(around)) {
                    turn(tried, v);
                    continue;
                }
                turn(mSet, v);
                turn(mGaps, v);
                mMosaic.forEachAround(v, around & ~kCenter, [&](VoxelId other) {
                    if (!contains(tried, other)) return;
                    turn(tried, other);
                    again.push({depth(other), other});
                });
            }
        }
        forEach(mGaps, [&](VoxelId v) { turn(mSet, v); });
    }

    /// Connected parts of the gaps that take handles away where they are closed.
    std::vector<std::vector<VoxelId>> plugs()
    {
        std::vector<std::vector<VoxelId>> found;
        const std::vector<SignWords> all = mGaps;
        forEach(all, [&](VoxelId seed) {
            if (!contains(mGaps, seed)) return;
            std::vector<VoxelId> part = {seed};
            turn(mGaps, seed);
            for (std::size_t n = 0; n < part.size(); ++n)
                mMosaic.forEachAround(part[n], mMosaic.neighborhood(mGaps, part[n]) & ~kCenter,
                                      [&](VoxelId next) {
                                          if (!contains(mGaps, next)) return;
                                          turn(mGaps, next);
                                          part.push_back(next);
                                      });
            const int change = changeBy(mMosaic, mSet, part);
            for (const VoxelId v : part) turn(mSet, v);
            if (change > 0) found.push_back(std::move(part));
        });
        return found;
    }

private:
    template <typename F>
    static void forEach(const std::vector<SignWords>& set, F f)
    {
        for (std::size_t n = 0; n < set.size(); ++n)
            for (std::size_t x = 0; x < kBlockDim; ++x)
                for (std::uint64_t rest = set[n][x]; rest; rest &= rest - 1)
                    f(VoxelId(n * kBlockVoxels + x * 64 + std::size_t(__builtin_ctzll(rest))));
    }

    const BlockMosaic& mMosaic;
    std::vector<SignWords> mSet, mGaps;
};

/// Voxels of @a set that share a face with one of @a voxels.
std::vector<VoxelId> sidesOf(const BlockMosaic& mosaic, const std::vector<SignWords>& set,
                             const std::vector<VoxelId>& voxels)
{
    std::vector<VoxelId> sides;
    for (const VoxelId v : voxels)
        mosaic.forEachAround(v, kFaceNeighbors & mosaic.neighborhood(set, v),
                             [&](VoxelId next) { sides.push_back(next); });
    std::sort(sides.begin(), sides.end());
    sides.erase(std::unique(sides.begin(), sides.end()), sides.end());
    return sides;
}

/// Whether a few steps through faces lead from @a start to a deep voxel of @a set.
template <typename IsDeep>
bool reachesDeep(const BlockMosaic& mosaic, const std::vector<SignWords>& set, VoxelId start,
                 IsDeep isDeep)
{
    std::vector<VoxelId> front = {start};
    std::set<VoxelId> reached(front.begin(), front.end());
    for (int step = 0; step < kBridgeSteps; ++step)
        for (const VoxelId v : std::exchange(front, {})) {
            if (isDeep(v)) return true;
            mosaic.forEachAround(v, kFaceNeighbors & mosaic.neighborhood(set, v),
                                 [&](VoxelId next) {
                                     if (reached.insert(next).second) front.push_back(next);
                                 });
        }
    return false;
}

/// The plugs of the narrow gaps between @a inside, and of those between what is not in it.
/// @param depth  of a voxel in its side, world units.
template <typename Depth>
std::vector<Plug> findPlugs(const BlockMosaic& mosaic, const std::vector<SignWords>& inside,
                            double voxelSize, Depth depth, Interrupter& progress)
{
    const auto isDeep = [&](VoxelId v) { return double(depth(v)) >= kDeep * voxelSize; };
    std::vector<SignWords> tunnels(inside.size()), bridges(inside.size());
    tbb::parallel_for(std::size_t(0), inside.size(), [&](std::size_t n) {
        if (n % 1024 == 0) progress.check();
        mosaic.findNarrow(inside, n, kReach, tunnels[n], bridges[n]);
    });
    const auto plugsOf = [&](std::vector<SignWords> set, std::vector<SignWords> narrow, bool sign) {
        Gaps gaps(mosaic, std::move(set), std::move(narrow));
        gaps.open(depth, progress);
        std::vector<Plug> plugs;
        for (std::vector<VoxelId>& voxels : gaps.plugs()) {
            Plug plug{std::move(voxels), sign};
            for (const VoxelId v : plug.voxels) {
                plug.cost += double(depth(v));
                plug.deepest = std::max(plug.deepest, double(depth(v)));
            }
            plugs.push_back(std::move(plug));
        }
        return plugs;
    };
    std::vector<Plug> plugs, ofBridges;
    tbb::parallel_invoke([&] { plugs = plugsOf(inside, std::move(tunnels), false); },
                         [&] { ofBridges = plugsOf(inverse(inside), std::move(bridges), true); });
    std::vector<SignWords> rest = inside;
    for (Plug& plug : ofBridges) {
        for (const VoxelId v : plug.voxels) turn(rest, v);
        const std::vector<VoxelId> sides = sidesOf(mosaic, rest, plug.voxels);
        plug.wire = !std::all_of(sides.begin(), sides.end(),
                                 [&](VoxelId v) { return reachesDeep(mosaic, rest, v, isDeep); });
        for (const VoxelId v : plug.voxels) turn(rest, v);
    }
    plugs.insert(plugs.end(), ofBridges.begin(), ofBridges.end());
    // What changes least comes first: of a handle's tunnel and its bridge one is enough.
    std::sort(plugs.begin(), plugs.end(), [](const Plug& a, const Plug& b) {
        return std::make_tuple(a.cost, a.voxels.front()) <
               std::make_tuple(b.cost, b.voxels.front());
    });
    return plugs;
}

} // namespace

/// Whether data hold up the sign of @a voxels, the deepest of them @a deepest (world units) in
/// their side. What is shallow, a tunnel and a bridge need points for that, a deep wire only fits
/// that points support.
bool Band::isHeldUp(const std::vector<VoxelId>& voxels, double deepest, bool wire) const
{
    const double h = mLattice.voxelSize;
    if (deepest < kHair * h) return false;
    std::size_t points = 0;
    for (const auto& [block, words] : byBlock(voxels))
        points += countData(mBlocks[block].at, words);
    if (deepest <= kShallow * h) return points >= (wire ? voxels.size() : kManyPoints);
    if (points * kVoxelsPerPoint > voxels.size()) return true;
    return wire && std::any_of(voxels.begin(), voxels.end(), [&](VoxelId v) {
               const Vec3i local(int(v >> 6 & 7), int(v >> 3 & 7), int(v & 7));
               const Vec3i at = mBlocks[v / kBlockVoxels].at * kBlockDim + local;
               return mField.evaluate(mLattice.origin + h * at.cast<double>()).supported;
           });
}

BlockMosaic Band::mosaic() const
{
    std::vector<BlockMosaic::Around> around(mBlocks.size());
    tbb::parallel_for(std::size_t(0), mBlocks.size(), [&](std::size_t n) {
        if (n % 1024 == 0) mProgress.check();
        for (int k = 0; k < 27; ++k) {
            const auto found =
                mIndex.find(packed(mBlocks[n].at + Vec3i(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1)));
            around[n][std::size_t(k)] =
                found == mIndex.end() ? BlockMosaic::kNoBlock : found->second;
        }
    });
    return BlockMosaic(std::move(around));
}

std::size_t Band::removeHandles()
{
    // A field that is not made from data holds up all that it has.
    if (!isFromData()) return 0;
    const BlockMosaic blocks = mosaic();
    std::vector<SignWords> inside(mBlocks.size());
    for (std::size_t n = 0; n < inside.size(); ++n) inside[n] = mBlocks[n].inside;
    const auto depth = [&](VoxelId v) {
        const Block& block = mBlocks[v / kBlockVoxels];
        return block.leaf ? std::abs(block.leaf->buffer().data()[v % kBlockVoxels]) : mBackground;
    };
    const std::vector<Plug> plugs = findPlugs(blocks, inside, mLattice.voxelSize, depth, mProgress);
    std::vector<SignWords> outside = inverse(inside), settled(inside.size());
    const auto turnAll = [&](const Plug& plug) {
        for (const VoxelId v : plug.voxels)
            for (auto* set : {&inside, &outside, &settled}) mpuvdb::turn(*set, v);
    };
    // Of a handle's tunnel and its bridge, which meet, one is enough.
    const auto isSettled = [&](VoxelId v) { return blocks.neighborhood(settled, v) != 0; };
    std::vector<const Plug*> taken;
    for (const Plug& plug : plugs) {
        mProgress.check();
        if (std::any_of(plug.voxels.begin(), plug.voxels.end(), isSettled)) continue;
        if (isHeldUp(plug.voxels, plug.deepest, plug.wire)) continue;
        turnAll(plug);
        taken.push_back(&plug);
    }
    if (taken.empty()) return 0;
    const auto turnVoxels = [&](const Plug& plug) {
        for (const auto& [block, voxels] : byBlock(plug.voxels)) turn(mBlocks[block], voxels);
    };
    for (const Plug* plug : taken) turnVoxels(*plug);
    // One that shuts off a part of its side has made no handle less, but a bubble more.
    const Regions regions = labelRegions();
    const auto shutsOff = [&](const Plug* plug) {
        const auto sides = sidesOf(blocks, plug->inside ? inside : outside, plug->voxels);
        const auto rootOf = [&](VoxelId v) {
            return regions.rootOf(v / kBlockVoxels, int(v % kBlockVoxels));
        };
        return sides.empty() || std::any_of(sides.begin(), sides.end(), [&](VoxelId v) {
                   return rootOf(v) != rootOf(sides.front());
               });
    };
    const auto bad = std::stable_partition(taken.begin(), taken.end(),
                                           [&](const Plug* plug) { return !shutsOff(plug); });
    std::for_each(bad, taken.end(), [&](const Plug* plug) { turnVoxels(*plug); });
    return std::size_t(bad - taken.begin());
}

} // namespace mpuvdb
