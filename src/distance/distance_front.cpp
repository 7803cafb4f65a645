// Closest-point propagation: each voxel has the closest patch found so far, and propagates changes
// to its neighbors. Leaves exchange updates in waves: a wave reads only what the wave before has
// sent, so that nothing depends on the order of threads. Waves continue until the front has passed
// a bound; then all nearer voxels are settled, and the bound moves on.
#include "distance_front.h"
#include "core/lanes.h"
#include "core/release.h"

#include "known_distances.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using Leaf = SurfacePatches::Leaf;
using openvdb::Coord;

constexpr std::uint32_t kNoNode = ~std::uint32_t(0); ///< number of none [derived: type's largest]
/// Step of the bound, voxels. [tuned: offset_bench]
constexpr float kBoundStep = 4;
/// Step, voxels, in which a leaf propagates its nearer voxels first. [tuned: offset_bench]
constexpr float kOrderStep = 0.75f;
/// Largest difference between the distances to a patch's foot, which orders the front, and to the
/// patch, voxels. [tuned: redistance_test]
constexpr float kFootMargin = 0.3f;

/// Number of a leaf among the 27 around and including one.
constexpr int sideOf(int x, int y, int z)
{
    return (x + 1) * 9 + (y + 1) * 3 + z + 1;
}

/// For each voxel of a leaf the leaves that it touches, a bit of sideOf() each.
constexpr std::array<std::uint32_t, kBlockVoxels> sidesOfVoxels()
{
    std::array<std::uint32_t, kBlockVoxels> sides{};
    for (int n = 0; n < kBlockVoxels; ++n) {
        const int at[3] = {n / (kBlockDim * kBlockDim), n / kBlockDim % kBlockDim, n % kBlockDim};
        int low[3] = {}, high[3] = {};
        for (int a = 0; a < 3; ++a) {
            low[a] = at[a] == 0 ? -1 : 0;
            high[a] = at[a] == kBlockDim - 1 ? 1 : 0;
        }
        for (int x = low[0]; x <= high[0]; ++x)
            for (int y = low[1]; y <= high[1]; ++y)
                for (int z = low[2]; z <= high[2]; ++z)
                    sides[std::size_t(n)] |= 1u << sideOf(x, y, z);
    }
    return sides;
}

constexpr std::array<std::uint32_t, kBlockVoxels> kSidesOfVoxels =
    sidesOfVoxels(); ///< [derived: kBlockDim]

/// The new closest patch of a voxel at the side of its leaf.
struct Update {
    std::uint16_t voxel;
    std::uint32_t patch;
};

struct Node {
    Coord origin;
    const Leaf* signs = nullptr;
    std::unique_ptr<ClosestPatches> closest; ///< null before the first update, and once finished
    std::vector<Update> sent, sending;
    std::vector<std::uint32_t> senders; ///< nodes with updates for this one
    std::uint32_t touched = 0;          ///< bits of the neighbors that the updates concern
    std::array<std::uint32_t, 27> beside;
    bool active = false, finished = false;
    FinishedLeaf result;

    /// Free what a finished node does not need.
    void releaseScratch()
    {
        closest.reset();
        release(sent);
        release(sending);
        release(senders);
    }
};

using Floats = float __attribute__((vector_size(16)));
using Ints = std::int32_t __attribute__((vector_size(16)));

bool anyOf(const Ints& flags)
{
    std::uint64_t halves[2];
    std::memcpy(halves, &flags, sizeof halves);
    return (halves[0] | halves[1]) != 0;
}

class Front
{
public:
    Front(const openvdb::FloatTree& signs, const SurfacePatches& patches, const Reach& reach,
          const FinishLeaf& finish, Interrupter& progress)
        : mSigns(signs), mSurface(patches), mPatches(patches.patches), mFinish(finish),
          mProgress(progress), mReach{std::max(reach.outside, 0.0f), std::max(reach.inside, 0.0f)}
    {
        for (int side = 0; side < 2; ++side) {
            const float reached = mReach[side] > 0 ? mReach[side] + kFootMargin : 0;
            mLimit2[side] = reached * reached;
            mBeyond2[side] = std::nextafter(mLimit2[side], kInfinity);
        }
        addSources(patches);
    }

    /// @param units  of progress.
    std::vector<FinishedLeaf> run(double units)
    {
        const float last = std::max(mReach[0], mReach[1]) + kFootMargin;
        for (float bound = kBoundStep; !mLive.empty(); bound += kBoundStep) {
            mBound2 = bound * bound;
            std::vector<std::uint32_t> work = mLive;
            while (!work.empty()) work = wave(work);
            finishSettled(bound >= last ? kInfinity : bound);
            mProgress.advance(units * double(std::min(kBoundStep / last, 1.0f)));
        }
        std::vector<FinishedLeaf> results;
        results.reserve(mNodes.size());
        for (auto& node : mNodes) results.push_back(std::move(node->result));
        return results;
    }

private:
    template <typename F>
    void forEach(const std::vector<std::uint32_t>& nodes, F f)
    {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, nodes.size(), 8),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              mProgress.check();
                              for (std::size_t n = range.begin(); n < range.end(); ++n)
                                  f(*mNodes[nodes[n]]);
                          });
    }

    void addSources(const SurfacePatches& patches)
    {
        std::vector<std::size_t> leafOf;
        for (std::size_t n = 0; n < patches.leaves.size(); ++n) {
            if (patches.first[n] == patches.first[n + 1]) continue;
            addNode(patches.leaves[n]->origin());
            leafOf.push_back(n);
        }
        tbb::parallel_for(std::size_t(0), leafOf.size(), [&](std::size_t at) {
            if (at % 256 == 0) mProgress.check();
            Node& node = *mNodes[at];
            prepare(node);
            const std::size_t leaf = leafOf[at];
            for (std::uint32_t n = patches.first[leaf]; n < patches.first[leaf + 1]; ++n) {
                if (patches.isSuperseded(n)) continue;
                const int voxel = int(Leaf::coordToOffset(mPatches[n].voxel));
                node.closest->set(voxel, n, mPatches[n].foot.squaredNorm());
            }
        });
        for (std::uint32_t n = patches.voxelPatches(); n < mPatches.size(); ++n) {
            if (patches.isSuperseded(n)) continue;
            Node& node = *mNodes[addNode(mPatches[n].voxel & ~7)];
            if (!node.closest) prepare(node);
            spread(node, int(Leaf::coordToOffset(mPatches[n].voxel)), n);
        }
        publish(std::vector<std::uint32_t>(mLive));
    }

    std::uint32_t addNode(const Coord& origin)
    {
        const auto number = std::uint32_t(mNodes.size());
        const auto added = mIndex.emplace(origin, number);
        if (!added.second) return added.first->second;
        mNodes.push_back(std::make_unique<Node>());
        mNodes.back()->origin = origin;
        mNodes.back()->beside.fill(kNoNode);
        mLive.push_back(number);
        return number;
    }

    /// Initialize the closest patches of the leaf: none.
    void prepare(Node& node) const
    {
        node.closest = std::make_unique<ClosestPatches>();
        ClosestPatches& known = *node.closest;
        known.patch.fill(kNoPatch);
        node.signs = mSigns.probeConstLeaf(node.origin);
        if (!node.signs) {
            const bool negative = mSigns.getValue(node.origin) < 0;
            known.negative.fill(negative ? ~std::uint64_t(0) : 0);
            known.distance2.fill(mBeyond2[negative]);
            return;
        }
        const float* const values = node.signs->buffer().data();
        known.negative = {};
        for (int n = 0; n < kBlockVoxels; ++n) {
            const bool negative = values[n] < 0;
            known.negative[std::size_t(n >> 6)] |= std::uint64_t(negative) << (n & 63);
            known.distance2[std::size_t(n)] = mBeyond2[negative];
        }
    }

    /// Let the nodes of @a work receive and propagate updates; returns those to receive them next.
    std::vector<std::uint32_t> wave(const std::vector<std::uint32_t>& work)
    {
        forEach(work, [&](Node& node) {
            if (!node.closest) prepare(node);
            for (const std::uint32_t from : node.senders) receive(*mNodes[from], node);
            node.senders.clear();
            node.touched = 0;
            propagate(node);
        });
        return publish(work);
    }

    /// Publish the updates of @a work for the next wave; returns the nodes that they concern.
    std::vector<std::uint32_t> publish(const std::vector<std::uint32_t>& work)
    {
        for (const std::uint32_t n : mSenders) mNodes[n]->sent.clear();
        mSenders.clear();
        std::vector<std::uint32_t> next;
        for (const std::uint32_t n : work) {
            mNodes[n]->sent.swap(mNodes[n]->sending);
            if (mNodes[n]->sent.empty()) continue;
            mSenders.push_back(n);
            for (int side = 0; side < 27; ++side)
                if (mNodes[n]->touched >> side & 1u) notify(n, side, next);
        }
        for (const std::uint32_t n : next) mNodes[n]->active = false;
        std::sort(next.begin(), next.end());
        return next;
    }

    /// Add the node beside node @a n to @a next, to receive the updates of @a n.
    void notify(std::uint32_t n, int side, std::vector<std::uint32_t>& next)
    {
        std::uint32_t to = mNodes[n]->beside[std::size_t(side)];
        if (to == kNoNode) {
            const Coord step(side / 9 - 1, side / 3 % 3 - 1, side % 3 - 1);
            to = addNode(mNodes[n]->origin +
                         Coord(step[0] * kBlockDim, step[1] * kBlockDim, step[2] * kBlockDim));
            mNodes[n]->beside[std::size_t(side)] = to;
        }
        Node& node = *mNodes[to];
        if (node.finished) return;
        node.senders.push_back(n);
        if (!node.active) next.push_back(to);
        node.active = true;
    }

    void receive(const Node& from, Node& node)
    {
        const Coord shift = from.origin - node.origin;
        const int side =
            sideOf(-shift[0] / kBlockDim, -shift[1] / kBlockDim, -shift[2] / kBlockDim);
        for (const Update& m : from.sent) {
            if (!(kSidesOfVoxels[m.voxel] >> side & 1u)) continue;
            const Coord at = shift + ClosestPatches::coordOf(m.voxel);
            offer(node, at, m.patch, mPatches[m.patch].to(node.origin + at));
        }
    }

    /// Propagate the pending voxels within the bound, the nearest first.
    void propagate(Node& node)
    {
        ClosestPatches& known = *node.closest;
        float least2 = kInfinity;
        forEachPending(known, [&](int n) { least2 = std::min(least2, known.distance2[n]); });
        if (least2 > mBound2) return;
        for (float at = std::sqrt(least2);;) {
            at += kOrderStep;
            const float now2 = std::min(at * at, mBound2);
            for (bool again = true; again;) {
                again = false;
                forEachPending(known, [&](int n) {
                    if (known.distance2[n] > now2) return;
                    known.pending[std::size_t(n >> 6)] &= ~(std::uint64_t(1) << (n & 63));
                    spread(node, n, known.patch[n]);
                    again = true;
                });
            }
            if (now2 >= mBound2) return;
        }
    }

    template <typename F>
    static void forEachPending(const ClosestPatches& known, F f)
    {
        for (int word = 0; word < kBlockDim; ++word)
            for (std::uint64_t bits = known.pending[std::size_t(word)]; bits; bits &= bits - 1)
                f(64 * word + __builtin_ctzll(bits));
    }

    /// Offer a voxel's patch to the voxels around it.
    void spread(Node& node, int voxel, std::uint32_t patch)
    {
        const Coord at = ClosestPatches::coordOf(voxel);
        const Vec3f v = mPatches[patch].to(node.origin + at);
        offer(node, at, patch, v);
        const std::uint32_t sides = sidesReached(at, v);
        if (sides == 0) return;
        node.touched |= sides;
        node.sending.push_back({std::uint16_t(voxel), patch});
    }

    /// Bits of the neighbor leaves with a voxel beside @a at that is within reach.
    std::uint32_t sidesReached(const Coord& at, const Vec3f& v) const
    {
        const auto low = [&](int a) { return at[a] == 0 ? -1 : 0; };
        const auto high = [&](int a) { return at[a] == kBlockDim - 1 ? 1 : 0; };
        std::uint32_t sides = 0;
        const float limit2 = std::max(mLimit2[0], mLimit2[1]);
        for (int x = low(0); x <= high(0); ++x)
            for (int y = low(1); y <= high(1); ++y)
                for (int z = low(2); z <= high(2); ++z)
                    if (leastDistance2(Coord(x, y, z), v) <= limit2) sides |= 1u << sideOf(x, y, z);
        return sides & ~(1u << sideOf(0, 0, 0));
    }

    /// Smallest squared distance to a patch's foot, from voxels of the leaf at @a side beside the
    /// one at @a v from the foot.
    static float leastDistance2(const Coord& side, const Vec3f& v)
    {
        float sum = 0;
        for (int a = 0; a < 3; ++a) {
            const float to = side[a] != 0 ? v[a] + float(side[a])
                                          : std::copysign(std::max(0.0f, std::abs(v[a]) - 1), v[a]);
            sum += to * to;
        }
        return sum;
    }

    /// Offer a patch to the leaf's voxels around @a at, in the leaf or beside it. @param v  from
    /// the patch's foot to @a at.
    void offer(Node& node, const Coord& at, std::uint32_t patch, const Vec3f& v) const
    {
        ClosestPatches& known = *node.closest;
        const auto low = [&](int a) { return std::max(at[a] - 1, 0); };
        const auto high = [&](int a) { return std::min(at[a] + 1, kBlockDim - 1); };
        // Most offers are no nearer: four voxels are compared at once, of which up to three count.
        const int z0 = std::min(low(2), kBlockDim - 4);
        const Ints steps = (z0 - at[2]) + Ints{0, 1, 2, 3};
        const Ints inRange = (steps >= -1) & (steps <= 1);
        const Floats dz = v[2] + __builtin_convertvector(steps, Floats), dz2 = dz * dz;
        for (int x = low(0); x <= high(0); ++x) {
            const float dx = v[0] + float(x - at[0]), dx2 = dx * dx;
            for (int y = low(1); y <= high(1); ++y) {
                const float dy = v[1] + float(y - at[1]), dxy2 = dx2 + dy * dy;
                const int row = (x * kBlockDim + y) * kBlockDim + z0;
                const Floats d2 = dxy2 + dz2;
                const Ints nearer = (d2 < lanesAt<Floats>(&known.distance2[row])) & inRange;
                if (!anyOf(nearer)) continue;
                for (int z = 0; z < 4; ++z)
                    if (nearer[z]) known.set(row + z, patch, d2[z]);
            }
        }
    }

    /// Finish the leaves all of whose voxels are nearer than @a bound or never reached.
    void finishSettled(float bound)
    {
        forEach(mLive, [&](Node& node) {
            if (isSettled(*node.closest, bound)) finish(node);
        });
        mLive.erase(std::remove_if(mLive.begin(), mLive.end(),
                                   [&](std::uint32_t n) { return mNodes[n]->finished; }),
                    mLive.end());
    }

    bool isSettled(const ClosestPatches& known, float bound) const
    {
        for (int n = 0; n < kBlockVoxels; ++n) {
            const float reach = mReach[known.isNegative(n)];
            if (known.distance2[n] > bound * bound && (reach > 0 && bound < reach + kFootMargin))
                return false;
        }
        return true;
    }

    void finish(Node& node)
    {
        node.result =
            mFinish(node.origin, node.signs, KnownDistances(mSurface, node.origin, *node.closest));
        node.result.origin = node.origin;
        node.releaseScratch();
        node.finished = true;
    }

    const openvdb::FloatTree& mSigns;
    const SurfacePatches& mSurface;
    const std::vector<SurfacePatch>& mPatches;
    const FinishLeaf& mFinish;
    Interrupter& mProgress;
    float mReach[2], mLimit2[2]; ///< outside, inside
    float mBeyond2[2];           ///< the smallest floats above the limits
    float mBound2 = 0;
    std::vector<std::unique_ptr<Node>> mNodes;
    std::unordered_map<Coord, std::uint32_t> mIndex;
    std::vector<std::uint32_t> mLive;    ///< not finished, in the order of their numbers
    std::vector<std::uint32_t> mSenders; ///< nodes with updates of the wave before
};

} // namespace

std::vector<FinishedLeaf> spreadDistances(const openvdb::FloatTree& signs,
                                          const SurfacePatches& patches, const Reach& reach,
                                          const FinishLeaf& finish, Interrupter& progress,
                                          double units)
{
    return Front(signs, patches, reach, finish, progress).run(units);
}

} // namespace mpuvdb
