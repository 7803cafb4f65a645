#include "solid_sums.h"

#include <mpuvdb/progress.h>

#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;

/// Whether a neighbor of the voxel is on the other side.
bool hasOtherSide(const openvdb::tree::ValueAccessor<const Tree>& at, const openvdb::Coord& voxel,
                  bool inside)
{
    for (int axis = 0; axis < 3; ++axis)
        for (const int step : {-1, 1}) {
            openvdb::Coord next = voxel;
            next[axis] += step;
            if ((at.getValue(next) < 0) != inside) return true;
        }
    return false;
}

/// Of one leaf, in voxels: the share of each that is inside, and of the surface's area.
SolidSums sumLeaf(const Leaf& leaf, const Tree& tree, double voxelSize)
{
    const openvdb::tree::ValueAccessor<const Tree> at(tree);
    SolidSums sums;
    for (auto on = leaf.cbeginValueOn(); on; ++on) {
        const double distance = double(*on) / voxelSize, far = std::abs(distance);
        const bool inside = distance < 0;
        if (far >= 1) {
            sums.volume += inside;
            continue;
        }
        const bool isCrossed = hasOtherSide(at, on.getCoord(), inside);
        // A plane at this distance from the middle of a voxel-wide slab, and of one twice as wide.
        sums.volume += isCrossed ? std::clamp(0.5 - distance, 0.0, 1.0) : double(inside);
        if (isCrossed) sums.area += 1 - far;
    }
    for (auto off = leaf.cbeginValueOff(); off; ++off) sums.volume += *off < 0;
    return sums;
}

} // namespace

SolidSums sumSolid(const LevelSet& levelSet, Progress& progress)
{
    const Tree& tree = levelSet.grid().tree();
    openvdb::tree::LeafManager<const Tree> leaves(tree);
    std::vector<SolidSums> sums(leaves.leafCount());
    leaves.foreach ([&](const Leaf& leaf, std::size_t n) {
        progress.check();
        sums[n] = sumLeaf(leaf, tree, levelSet.voxelSize());
    });
    SolidSums all;
    for (const SolidSums& s : sums) {
        all.volume += s.volume;
        all.area += s.area;
    }
    auto tile = tree.cbeginValueAll();
    tile.setMaxDepth(Tree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile)
        if (*tile < 0) all.volume += double(tile.getVoxelCount());
    const double h = levelSet.voxelSize();
    return {all.volume * h * h * h, all.area * h * h};
}

} // namespace mpuvdb
