#include "measure_voxels.h"

#include "distance_front.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using Leaf = SurfacePatches::Leaf;
using openvdb::Coord;

/// Excess of a measured distance over a placed voxel's, voxels, up to which the surface may have
/// been too thin to resolve. [tuned: combine_test]
constexpr float kMaxExcess = 1.5f;
/// Difference from the measured distance, voxels, up to which a value stays: that of a crease found
/// from both solids is more exact. [tuned: combine_test]
constexpr float kMaxDifference = 0.02f;
/// Voxels about the surface that patches depend on. [derived: a patch's stencil, its neighbors',
/// and kNeighborRadius of fits to faces]
constexpr int kPatchSupport = 4;

/// Leaves on which the distances of unplaced voxels may depend, in order.
std::vector<const Leaf*> leavesAbout(const openvdb::FloatTree& tree,
                                     const std::vector<KnownVoxels>& known, int reach)
{
    std::unordered_set<Coord> origins;
    for (const KnownVoxels& home : known) {
        if (home.unplaced.isOff()) continue;
        auto box = openvdb::CoordBBox::createCube(home.origin, 8);
        box.expand(reach);
        const Coord low = box.min() & ~7, high = box.max() & ~7;
        for (int x = low.x(); x <= high.x(); x += 8)
            for (int y = low.y(); y <= high.y(); y += 8)
                for (int z = low.z(); z <= high.z(); z += 8) origins.emplace(x, y, z);
    }
    std::vector<Coord> inOrder(origins.begin(), origins.end());
    std::sort(inOrder.begin(), inOrder.end());
    std::vector<const Leaf*> leaves;
    const openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(tree);
    for (const Coord& origin : inOrder)
        if (const Leaf* leaf = access.probeConstLeaf(origin)) leaves.push_back(leaf);
    return leaves;
}

const KnownVoxels* find(const std::vector<KnownVoxels>& known, const Coord& origin)
{
    const auto found = std::lower_bound(
        known.begin(), known.end(), origin,
        [](const KnownVoxels& leaf, const Coord& place) { return leaf.origin < place; });
    return found == known.end() || found->origin != origin ? nullptr : &*found;
}

/// Measures the voxels of a leaf.
class LeafMeasurer
{
public:
    LeafMeasurer(const Leaf& old, const LeafDistances& distances, float voxelSize, float background)
        : mOld(old), mDistances(distances), mVoxelSize(voxelSize), mBackground(background),
          mNew(std::make_unique<Leaf>(old))
    {
    }

    std::unique_ptr<Leaf> measure(const KnownVoxels& known)
    {
        for (auto it = known.unplaced.beginOn(); it; ++it) set(it.pos());
        for (auto it = known.placed.beginOn(); it; ++it)
            if (mOld.isValueOn(it.pos()) && isTooNear(int(it.pos()))) set(it.pos());
        return std::move(mNew);
    }

private:
    bool isTooNear(int voxel) const
    {
        const float least =
            std::abs(mOld.getValue(openvdb::Index(voxel))) + kMaxExcess * mVoxelSize;
        return least < mBackground && // beyond, the distance is unknown
               std::abs(mVoxelSize * mDistances.atMost(voxel)) > least &&
               std::abs(mVoxelSize * mDistances.at(voxel)) > least;
    }
    void set(openvdb::Index voxel)
    {
        const float d = std::abs(mVoxelSize * mDistances.at(int(voxel)));
        const float old = mOld.getValue(voxel);
        if (mOld.isValueOn(voxel) && std::abs(d - std::abs(old)) < kMaxDifference * mVoxelSize)
            return;
        if (d < mBackground)
            mNew->setValueOn(voxel, std::copysign(d, old));
        else
            mNew->setValueOff(voxel, std::copysign(mBackground, old));
    }

    const Leaf& mOld;
    const LeafDistances& mDistances;
    float mVoxelSize, mBackground;
    std::unique_ptr<Leaf> mNew;
};

/// Make a leaf's listed voxels inactive: no surface is near.
void drop(const KnownVoxels& known, float background, Leaf& leaf)
{
    for (const auto* voxels : {&known.unplaced, &known.placed})
        for (auto it = voxels->beginOn(); it; ++it)
            leaf.setValueOff(it.pos(), std::copysign(background, leaf.getValue(it.pos())));
}

} // namespace

void measureUnplaced(openvdb::FloatTree& tree, double voxelSize, std::vector<KnownVoxels>& known,
                     Interrupter& progress)
{
    const float background = tree.background(), h = float(voxelSize), reach = background / h;
    std::vector<const Leaf*> leaves =
        leavesAbout(tree, known, int(std::ceil(reach)) + kPatchSupport);
    if (leaves.empty()) return;
    const SurfacePatches patches =
        surfacePatches(tree, std::move(leaves), voxelSize, Values::Distances, progress);
    const auto measure = [&](const Coord& origin, const Leaf* old, const LeafDistances& distances) {
        const KnownVoxels* const home = find(known, origin);
        FinishedLeaf finished;
        if (home && old && !home->unplaced.isOff())
            finished.leaf = LeafMeasurer(*old, distances, h, background).measure(*home);
        return finished;
    };
    const std::vector<FinishedLeaf> finished =
        spreadDistances(tree, patches, {reach, reach}, measure, progress, 0);
    std::unordered_map<Coord, const Leaf*> measured;
    for (const FinishedLeaf& leaf : finished)
        if (leaf.leaf) measured.emplace(leaf.origin, leaf.leaf.get());
    for (KnownVoxels& home : known) {
        if (home.unplaced.isOff()) continue;
        home.exact |= home.unplaced;
        Leaf& leaf = *tree.probeLeaf(home.origin);
        const auto found = measured.find(home.origin);
        if (found == measured.end())
            drop(home, background, leaf);
        else
            leaf = *found->second;
    }
}

} // namespace mpuvdb
