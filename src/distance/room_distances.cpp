#include "room_distances.h"

#include "distance_front.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <openvdb/tree/LeafManager.h>
#include <tbb/parallel_for.h>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// Half-width of the band about the surface of possible centers, voxels. [tuned: combine_test]
constexpr float kRoomBand = 4;

/// Leaves of either solid within @a reach voxels of @a origins, in order.
std::vector<Coord> leavesAbout(const ScaledSolid& a, const ScaledSolid& b,
                               const std::vector<Coord>& origins, float reach,
                               Interrupter& progress)
{
    const int around = 8 * ((int(std::ceil(reach)) + 7) / 8);
    const openvdb::tree::ValueAccessor<const FloatTree> inA(a.tree), inB(b.tree);
    std::unordered_set<Coord> seen;
    std::vector<Coord> leaves;
    for (const Coord& origin : origins) {
        progress.check();
        for (int x = -around; x <= around; x += 8)
            for (int y = -around; y <= around; y += 8)
                for (int z = -around; z <= around; z += 8) {
                    const Coord at = origin.offsetBy(x, y, z);
                    if (seen.insert(at).second &&
                        (inA.probeConstLeaf(at) || inB.probeConstLeaf(at)))
                        leaves.push_back(at);
                }
    }
    std::sort(leaves.begin(), leaves.end());
    return leaves;
}

/// Distance to the nearer solid less the ball's radius, voxels. For one thread.
class Room
{
public:
    Room(const ScaledSolid& a, const ScaledSolid& b, float radius)
        : mA(a.tree), mB(b.tree), mScaleA(a.scale), mScaleB(b.scale), mRadius(radius)
    {
    }
    float at(const Coord& voxel) const
    {
        return std::min(mScaleA * mA.getValue(voxel), mScaleB * mB.getValue(voxel)) - mRadius;
    }

private:
    openvdb::tree::ValueAccessor<const FloatTree> mA, mB;
    float mScaleA, mScaleB, mRadius;
};

/// A level set of the places where the ball's center cannot be.
FloatTree roomTree(const ScaledSolid& a, const ScaledSolid& b, float radius,
                   const std::vector<Coord>& origins, Interrupter& progress)
{
    FloatTree tree(kRoomBand);
    for (const Coord& origin : origins) tree.touchLeaf(origin);
    openvdb::tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach ([&](Leaf& leaf, std::size_t) {
        progress.check();
        const Room room(a, b, radius);
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
            const float v = room.at(leaf.offsetToGlobalCoord(n));
            leaf.setValueOnly(n, std::clamp(v, -kRoomBand, kRoomBand));
            leaf.setActiveState(n, std::abs(v) < kRoomBand);
        }
    });
    return tree;
}

} // namespace

std::vector<RoomDistances> roomDistances(const ScaledSolid& a, const ScaledSolid& b, float radius,
                                         float reach, const std::vector<Coord>& origins,
                                         Interrupter& progress)
{
    std::vector<RoomDistances> distances(origins.size(), RoomDistances(Leaf::SIZE, reach));
    tbb::parallel_for(std::size_t(0), origins.size(), [&](std::size_t n) {
        progress.check();
        const Room room(a, b, radius);
        for (openvdb::Index i = 0; i < Leaf::SIZE; ++i)
            if (room.at(origins[n] + Leaf::offsetToLocalCoord(i)) >= 0) distances[n][i] = 0;
    });
    const FloatTree tree =
        roomTree(a, b, radius, leavesAbout(a, b, origins, reach + kRoomBand, progress), progress);
    const SurfacePatches patches = surfacePatches(tree, 1, Values::Implicit, progress);
    const auto keep = [&](const Coord& origin, const Leaf*, const LeafDistances& found) {
        const auto wanted = std::lower_bound(origins.begin(), origins.end(), origin);
        if (wanted == origins.end() || *wanted != origin) return FinishedLeaf{};
        RoomDistances& here = distances[std::size_t(wanted - origins.begin())];
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n)
            if (here[n] > 0) here[n] = std::clamp(-found.at(int(n)), 0.0f, reach);
        return FinishedLeaf{};
    };
    spreadDistances(tree, patches, {0, reach}, keep, progress, 0);
    return distances;
}

} // namespace mpuvdb
