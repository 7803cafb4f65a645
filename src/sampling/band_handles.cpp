// Removal of handles: narrow tunnels through the inside, and narrow bridges across the outside,
// that data do not support.
//
// A tunnel is found by a topology-preserving thinning: the narrow gaps of the inside are closed,
// and opened again from their middle on as long as the topology stays; the rest is a cut across the
// tunnel. A bridge is a tunnel through the outside.
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

constexpr int kHalfHandle = 2; ///< half the largest width of a handle, voxels [tuned: handles_test]
/// Depth of a cut, voxels, up to which its turn removes no detail that voxels resolve.
/// [tuned: handles_test]
constexpr double kShallow = 0.5;
/// Smallest number of points on a shallow cut that keep a handle. In thin parts it is one per
/// voxel, which distinguishes them from sheets that nearly touch. [tuned: handles_test]
constexpr std::size_t kMinPoints = 20;
/// Largest number of voxels per point of a deep cut that points keep. [tuned: handles_test]
constexpr std::size_t kVoxelsPerPoint = 8;
/// Largest number of steps from the ends of a bridge to a voxel deep in a thicker part, and its
/// depth, voxels; what is thin for longer is an object. [tuned: handles_test]
constexpr int kBridgeSteps = 6;
constexpr double kMinPartDepth = 1.5;

/// Voxels that remove a handle when they change sign.
struct Cut {
    std::vector<VoxelId> voxels;
    bool inside;             ///< the voxels' sign before
    bool isThinPart = false; ///< part of something that is thin for longer than a bridge
    double cost = 0;         ///< sum of the voxels' depths, world units
    double deepest = 0;      ///< largest of the depths
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

/// Add @a voxels to @a set, which holds none of them. Returns the change of its Euler
/// characteristic.
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

/// The narrow gaps of a set, thinned to the cuts that keep them closed.
class Gaps
{
public:
    /// @param isAtBorder  of each block, whether what is beside it is unknown; empty where none is.
    Gaps(const BlockMosaic& mosaic, std::vector<SignWords> set, std::vector<SignWords> gaps,
         const std::vector<char>& isAtBorder)
        : mMosaic(mosaic), mSet(std::move(set)), mGaps(std::move(gaps)), mIsAtBorder(isAtBorder),
          mTried(mGaps.size()), mDoubtful(isAtBorder.size())
    {
    }

    /// Open the gaps from their middle on, as long as the topology stays.
    /// @param depth  depth(voxel) of a voxel outside of the set, world units.
    template <typename Depth>
    void open(Depth depth, Interrupter& progress)
    {
        using Entry = std::pair<float, VoxelId>;
        std::vector<Entry> all;
        forEach(mGaps, [&](VoxelId v) { all.push_back({depth(v), v}); });
        std::sort(all.begin(), all.end(), std::greater<Entry>());
        for (const auto& [d, v] : all) turn(mSet, v);
        doubtTheBorder();
        std::priority_queue<Entry> again;
        for (std::size_t n = 0; n < all.size(); ++n) {
            if (n % 4096 == 0) progress.check();
            for (again.push(all[n]); !again.empty();) {
                const VoxelId v = again.top().second;
                again.pop();
                if (isDoubtful(v)) doubtAround(v);
                const Neighborhood around = mMosaic.neighborhood(mSet, v);
                if (!isSimple(around)) {
                    turn(mTried, v);
                    continue;
                }
                turn(mSet, v);
                turn(mGaps, v);
                mMosaic.forEachAround(v, around & ~kCenter, [&](VoxelId other) {
                    if (!contains(mTried, other)) return;
                    turn(mTried, other);
                    again.push({depth(other), other});
                });
            }
        }
        forEach(mGaps, [&](VoxelId v) { turn(mSet, v); });
    }

    /// Voxels of the gaps, opened or not, that what is unknown may have settled otherwise; empty
    /// where all is known.
    std::vector<SignWords> takeDoubtful() { return std::move(mDoubtful); }

    /// Connected parts of the gaps whose closing removes handles.
    std::vector<std::vector<VoxelId>> cuts()
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

    bool isDoubtful(VoxelId v) const { return !mDoubtful.empty() && contains(mDoubtful, v); }

    /// Doubt the gaps that the blocks at the border touch.
    void doubtTheBorder()
    {
        if (mDoubtful.empty()) return;
        const std::vector<SignWords> all = mGaps;
        forEach(all, [&](VoxelId v) {
            bool touches = false;
            mMosaic.forEachAround(v, kEverywhere, [&](VoxelId next) {
                touches |= mIsAtBorder[next / kBlockVoxels] != 0;
            });
            if (touches) turn(mDoubtful, v);
        });
    }
    /// Doubt the closed gaps about @a voxel, whose turn has come and is in doubt: theirs depends on
    /// it. Where theirs has come already they are tried again as it opens, and so on.
    void doubtAround(VoxelId voxel)
    {
        std::vector<VoxelId> rest{voxel};
        while (!rest.empty()) {
            const VoxelId v = rest.back();
            rest.pop_back();
            const Neighborhood around = mMosaic.neighborhood(mGaps, v) & ~kCenter;
            mMosaic.forEachAround(v, around, [&](VoxelId next) {
                if (contains(mDoubtful, next)) return;
                turn(mDoubtful, next);
                if (contains(mTried, next)) rest.push_back(next);
            });
        }
    }

    const BlockMosaic& mMosaic;
    std::vector<SignWords> mSet, mGaps;
    const std::vector<char>& mIsAtBorder;
    std::vector<SignWords> mTried; ///< closed gaps whose turn has come
    std::vector<SignWords> mDoubtful;
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

/// Whether kBridgeSteps steps through faces lead from @a start to a deep voxel of @a set.
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

/// The narrow gaps of a side.
struct NarrowGaps {
    std::vector<SignWords> voxels;
    std::vector<SignWords> doubtful{}; ///< of them, after findCuts(); as in Gaps
};

/// The cuts of the narrow gaps of @a inside and of its complement, cheapest first.
/// @param depth  depth(voxel) in its side, world units.
/// @param tunnels, bridges  the narrow gaps of both.
/// @param isAtBorder  as in Gaps.
template <typename Depth>
std::vector<Cut> findCuts(const BlockMosaic& mosaic, const std::vector<SignWords>& inside,
                          NarrowGaps& tunnels, NarrowGaps& bridges,
                          const std::vector<char>& isAtBorder, double voxelSize, Depth depth,
                          Interrupter& progress)
{
    const auto isDeep = [&](VoxelId v) { return double(depth(v)) >= kMinPartDepth * voxelSize; };
    const auto cutsOf = [&](std::vector<SignWords> set, NarrowGaps& narrow, bool sign) {
        Gaps gaps(mosaic, std::move(set), narrow.voxels, isAtBorder);
        gaps.open(depth, progress);
        narrow.doubtful = gaps.takeDoubtful();
        std::vector<Cut> cuts;
        for (std::vector<VoxelId>& voxels : gaps.cuts()) {
            Cut cut{std::move(voxels), sign};
            for (const VoxelId v : cut.voxels) {
                cut.cost += double(depth(v));
                cut.deepest = std::max(cut.deepest, double(depth(v)));
            }
            cuts.push_back(std::move(cut));
        }
        return cuts;
    };
    std::vector<Cut> cuts, ofBridges;
    tbb::parallel_invoke([&] { cuts = cutsOf(inside, tunnels, false); },
                         [&] { ofBridges = cutsOf(inverse(inside), bridges, true); });
    std::vector<SignWords> rest = inside;
    for (Cut& cut : ofBridges) {
        for (const VoxelId v : cut.voxels) turn(rest, v);
        const std::vector<VoxelId> sides = sidesOf(mosaic, rest, cut.voxels);
        cut.isThinPart = !std::all_of(sides.begin(), sides.end(), [&](VoxelId v) {
            return reachesDeep(mosaic, rest, v, isDeep);
        });
        for (const VoxelId v : cut.voxels) turn(rest, v);
    }
    cuts.insert(cuts.end(), ofBridges.begin(), ofBridges.end());
    // The cheapest comes first: of a handle's tunnel and its bridge one is enough.
    std::sort(cuts.begin(), cuts.end(), [](const Cut& a, const Cut& b) {
        return std::make_tuple(a.cost, a.voxels.front()) <
               std::make_tuple(b.cost, b.voxels.front());
    });
    return cuts;
}

} // namespace

/// Whether data support the sign of @a voxels, the deepest of them @a deepest (world units) in its
/// side. Shallow cuts, tunnels and bridges need points; a deep thin part needs only supported fits.
bool Band::isSupported(const std::vector<VoxelId>& voxels, double deepest, bool isThinPart) const
{
    const double h = mLattice.voxelSize;
    if (deepest < kMinFeatureDepth * h) return false;
    std::size_t points = 0;
    for (const auto& [block, words] : byBlock(voxels))
        points += countData(mBlocks[block].at, words);
    if (deepest <= kShallow * h) return points >= (isThinPart ? voxels.size() : kMinPoints);
    if (points * kVoxelsPerPoint > voxels.size()) return true;
    return isThinPart && std::any_of(voxels.begin(), voxels.end(), [&](VoxelId v) {
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

/// Whether a connected part of @a narrow that data do not support reaches from the wanted blocks to
/// blocks whose neighbors are unknown, and its voxels there are in @a doubtful: how it is cut is
/// decided by what is not known.
bool Band::reachesFar(const BlockMosaic& mosaic, std::vector<SignWords> narrow,
                      const std::vector<SignWords>& doubtful) const
{
    for (std::size_t n = 0; n < narrow.size(); ++n) {
        if (!isAtBorder(mBlocks[n].at)) continue;
        for (VoxelId seed = n * kBlockVoxels; seed < (n + 1) * kBlockVoxels; ++seed) {
            if (!contains(narrow, seed)) continue;
            mProgress.check();
            std::vector<VoxelId> part = {seed};
            mpuvdb::turn(narrow, seed);
            bool reaches = false;
            for (std::size_t k = 0; k < part.size(); ++k) {
                reaches |=
                    contains(doubtful, part[k]) && isWanted(mBlocks[part[k] / kBlockVoxels].at);
                mosaic.forEachAround(part[k], mosaic.neighborhood(narrow, part[k]),
                                     [&](VoxelId next) {
                                         if (!contains(narrow, next)) return;
                                         mpuvdb::turn(narrow, next);
                                         part.push_back(next);
                                     });
            }
            std::size_t points = 0;
            if (reaches)
                for (const auto& [block, words] : byBlock(part))
                    points += countData(mBlocks[block].at, words);
            if (reaches && points * kVoxelsPerPoint <= part.size()) return true;
        }
    }
    return false;
}

std::size_t Band::removeHandles()
{
    if (!isFromData()) return 0;
    const BlockMosaic blocks = mosaic();
    std::vector<SignWords> inside(mBlocks.size());
    for (std::size_t n = 0; n < inside.size(); ++n) inside[n] = mBlocks[n].inside;
    const auto depth = [&](VoxelId v) {
        const Block& block = mBlocks[v / kBlockVoxels];
        return block.leaf ? std::abs(block.leaf->buffer().data()[v % kBlockVoxels]) : mBackground;
    };
    NarrowGaps tunnels{std::vector<SignWords>(inside.size())}, bridges = tunnels;
    tbb::parallel_for(std::size_t(0), inside.size(), [&](std::size_t n) {
        if (n % 1024 == 0) mProgress.check();
        blocks.findNarrow(inside, n, kHalfHandle, tunnels.voxels[n], bridges.voxels[n]);
    });
    std::vector<char> atBorder(mZone ? mBlocks.size() : 0);
    for (std::size_t n = 0; n < atBorder.size(); ++n) atBorder[n] = isAtBorder(mBlocks[n].at);
    const std::vector<Cut> cuts =
        findCuts(blocks, inside, tunnels, bridges, atBorder, mLattice.voxelSize, depth, mProgress);
    for (NarrowGaps* gaps : {&tunnels, &bridges})
        if (mZone && mIsCertain)
            mIsCertain = !reachesFar(blocks, std::move(gaps->voxels), gaps->doubtful);
    std::vector<SignWords> outside = inverse(inside), settled(inside.size());
    const auto turnAll = [&](const Cut& cut) {
        for (const VoxelId v : cut.voxels)
            for (auto* set : {&inside, &outside, &settled}) mpuvdb::turn(*set, v);
    };
    // A handle's tunnel and its bridge touch: one of the two cuts is enough.
    const auto isSettled = [&](VoxelId v) { return blocks.neighborhood(settled, v) != 0; };
    // A cut may be a piece of a larger one, which data support.
    const auto isDoubtful = [&](const Cut& cut) {
        const std::vector<SignWords>& doubtful = cut.inside ? bridges.doubtful : tunnels.doubtful;
        return mZone && std::any_of(cut.voxels.begin(), cut.voxels.end(), [&](VoxelId v) {
                   return contains(doubtful, v) && isWanted(mBlocks[v / kBlockVoxels].at);
               });
    };
    std::vector<const Cut*> taken;
    for (const Cut& cut : cuts) {
        mProgress.check();
        if (std::any_of(cut.voxels.begin(), cut.voxels.end(), isSettled)) continue;
        if (isSupported(cut.voxels, cut.deepest, cut.isThinPart)) continue;
        mIsCertain &= !isDoubtful(cut);
        turnAll(cut);
        taken.push_back(&cut);
    }
    if (taken.empty()) return 0;
    const auto turnVoxels = [&](const Cut& cut) {
        for (const auto& [block, voxels] : byBlock(cut.voxels)) turn(mBlocks[block], voxels);
    };
    for (const Cut* cut : taken) turnVoxels(*cut);
    // A cut that separates a part of its side has removed no handle, but made a bubble.
    const Regions regions = labelRegions();
    const auto separates = [&](const Cut* cut) {
        const auto sides = sidesOf(blocks, cut->inside ? inside : outside, cut->voxels);
        const auto rootOf = [&](VoxelId v) {
            return regions.rootOf(v / kBlockVoxels, int(v % kBlockVoxels));
        };
        if (sides.empty()) return true;
        bool oneRoot = true, allGoOn = true;
        for (const VoxelId v : sides) {
            oneRoot &= rootOf(v) == rootOf(sides.front());
            allGoOn &= regions.goesOn[rootOf(v)] != 0;
        }
        // Beyond a zone parts are taken to be connected.
        if (!oneRoot && allGoOn)
            for (const VoxelId v : cut->voxels)
                mIsCertain &= !isWanted(mBlocks[v / kBlockVoxels].at);
        return !oneRoot && !allGoOn;
    };
    const auto bad = std::stable_partition(taken.begin(), taken.end(),
                                           [&](const Cut* cut) { return !separates(cut); });
    std::for_each(bad, taken.end(), [&](const Cut* cut) { turnVoxels(*cut); });
    return std::size_t(bad - taken.begin());
}

} // namespace mpuvdb
