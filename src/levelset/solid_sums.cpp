#include "solid_sums.h"

#include "block_parts.h"

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

constexpr std::uint64_t kFirstZ = 0x0101010101010101u, kLastZ = kFirstZ << 7;

/// Those voxels of a leaf beside which another of the leaf is on the other side.
SignWords crossedWithin(const SignWords& inside)
{
    SignWords crossed{};
    for (std::size_t x = 0; x < inside.size(); ++x) {
        const std::uint64_t in = inside[x];
        const std::uint64_t alongY = (in ^ in >> 8) & ~0ull >> 8, alongZ = (in ^ in >> 1) & ~kLastZ;
        crossed[x] |= alongY | alongY << 8 | alongZ | alongZ << 1;
        if (x + 1 == inside.size()) break;
        const std::uint64_t alongX = in ^ inside[x + 1];
        crossed[x] |= alongX;
        crossed[x + 1] |= alongX;
    }
    return crossed;
}

/// Whether a neighbor beyond the leaf's faces is on the other side of a voxel.
bool isCrossedBeyond(const openvdb::tree::ValueAccessor<const Tree>& at,
                     const openvdb::Coord& voxel, bool inside)
{
    for (int axis = 0; axis < 3; ++axis) {
        const int along = voxel[axis] & int(Leaf::DIM - 1);
        if (along != 0 && along != int(Leaf::DIM - 1)) continue;
        openvdb::Coord next = voxel;
        next[axis] += along ? 1 : -1;
        if ((at.getValue(next) < 0) != inside) return true;
    }
    return false;
}

/// Of one leaf, in voxels: the share of each that is inside, and of the surface's area.
SolidSums sumLeaf(const Leaf& leaf, const Tree& tree, float voxelSize)
{
    const float* const values = leaf.buffer().data();
    const SignWords inside = wordsWhere(values, [](float value) { return value < 0; });
    const SignWords near =
        wordsWhere(values, [=](float value) { return std::abs(value) < voxelSize; });
    const SignWords crossed = crossedWithin(inside);
    const openvdb::tree::ValueAccessor<const Tree> at(tree);
    SolidSums sums;
    for (std::size_t x = 0; x < inside.size(); ++x) {
        const std::uint64_t looked =
            near[x] & leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
        sums.volume += __builtin_popcountll(inside[x] & ~looked);
        for (std::uint64_t rest = looked; rest; rest &= rest - 1) {
            const auto bit = std::size_t(__builtin_ctzll(rest));
            const bool isInside = inside[x] >> bit & 1u;
            const auto offset = openvdb::Index(64 * x + bit);
            // A plane at this distance from the middle of a slab two voxels wide, and of one of a
            // voxel.
            const double distance = double(values[offset]) / double(voxelSize);
            sums.area += 1 - std::abs(distance);
            const bool isCrossed = (crossed[x] >> bit & 1u) ||
                                   isCrossedBeyond(at, leaf.offsetToGlobalCoord(offset), isInside);
            sums.volume += isCrossed ? std::clamp(0.5 - distance, 0.0, 1.0) : double(isInside);
        }
    }
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
        sums[n] = sumLeaf(leaf, tree, float(levelSet.voxelSize()));
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
