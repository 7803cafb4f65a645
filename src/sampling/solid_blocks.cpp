#include "solid_blocks.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

namespace mpuvdb
{

SolidBlocks::SolidBlocks(const LevelSet& levelSet, Interrupter& progress)
    : mTree(levelSet.grid().tree())
{
    findNodes();
    mInside.resize(mLeaves.size());
    std::vector<SolidSums> sums(mLeaves.size());
    tbb::parallel_for(std::size_t(0), mLeaves.size(), [&](std::size_t n) {
        if (n % 256 == 0) progress.check();
        mInside[n] = wordsWhere(mLeaves[n]->buffer().data(), [](float v) { return v < 0; });
        sums[n] = sumLeaf(*mLeaves[n], mInside[n], mTree, float(levelSet.voxelSize()));
    });
    for (const SolidSums& s : sums) {
        mSums.volume += s.volume;
        mSums.area += s.area;
    }
    sumTiles();
    const double h = levelSet.voxelSize();
    mSums = {mSums.volume * h * h * h, mSums.area * h * h};
}

void SolidBlocks::findNodes()
{
    openvdb::CoordBBox box;
    std::vector<const Lower*> lowers;
    mTree.getNodes(lowers);
    mLeafOf.reserve(lowers.size() * Lower::NUM_VALUES);
    for (const Lower* const lower : lowers) {
        mLowerAt[lower->origin()] = std::uint32_t(mLowers.size());
        box.expand(lower->getNodeBoundingBox());
        mLowers.push_back(readLower(*lower));
    }
    std::vector<const Upper*> uppers;
    mTree.getNodes(uppers);
    for (const Upper* const upper : uppers) {
        openvdb::CoordBBox within = upper->getNodeBoundingBox();
        within.intersect(box);
        mUpperAt[upper->origin()] = std::uint32_t(mUppers.size());
        mUppers.push_back({upper, within, mUpperTiles});
        mUpperTiles += std::uint32_t(within.empty() ? 0 : within.volume() / Lower::NUM_VOXELS);
    }
}

SolidBlocks::LowerNode SolidBlocks::readLower(const Lower& lower)
{
    LowerNode node{lower.origin(), {}, {}};
    for (openvdb::Index slot = 0; slot < Lower::NUM_VALUES; ++slot) {
        const std::uint64_t bit = std::uint64_t(1) << slot % 64;
        const auto& entry = lower.getTable()[slot];
        mLeafOf.push_back(std::uint32_t(mLeaves.size())); // unused for tiles
        if (lower.isChildMaskOn(slot)) {
            node.leaves[slot / 64] |= bit;
            mLeaves.push_back(entry.getChild());
        } else if (entry.getValue() < 0) {
            node.insideTiles[slot / 64] |= bit;
        }
    }
    return node;
}

/// Add the volume of inside tiles, in voxels.
void SolidBlocks::sumTiles()
{
    std::uint64_t lower = 0, upper = 0;
    for (const LowerNode& node : mLowers)
        for (const std::uint64_t word : node.insideTiles)
            lower += std::uint64_t(__builtin_popcountll(word));
    for (std::uint32_t n = 0; n < mUppers.size(); ++n)
        forEachTile(n, [&](const Place& tile, const Coord&) { upper += tile.isInside; });
    mSums.volume += double(lower) * double(Leaf::NUM_VOXELS);
    mSums.volume += double(upper) * double(Lower::NUM_VOXELS);
}

std::optional<std::uint32_t> SolidBlocks::lowerAt(const Coord& c) const
{
    const auto found = mLowerAt.find(c & ~int(Lower::DIM - 1));
    if (found == mLowerAt.end()) return {};
    return found->second;
}

SolidBlocks::Place SolidBlocks::at(const Coord& c) const
{
    if (const auto lower = lowerAt(c)) return inLower(*lower, Lower::coordToOffset(c));
    if (const auto upper = mUpperAt.find(c & ~int(Upper::DIM - 1)); upper != mUpperAt.end())
        return inUpper(mUppers[upper->second], c);
    return {Place::Root, 0, mTree.getValue(c) < 0};
}

SolidBlocks::Place SolidBlocks::inUpper(const UpperNode& upper, const Coord& c) const
{
    const bool isInside = upper.node->getTable()[Upper::coordToOffset(c)].getValue() < 0;
    if (!upper.box.isInside(c)) return {Place::Root, 0, isInside};
    const auto slot = [&](int axis, int k) { return (k - upper.box.min()[axis]) >> Lower::TOTAL; };
    const auto slots = [&](int axis) { return slot(axis, upper.box.max()[axis]) + 1; };
    const int index = (slot(0, c.x()) * slots(1) + slot(1, c.y())) * slots(2) + slot(2, c.z());
    return {Place::UpperTile, upper.firstTile + std::uint32_t(index), isInside};
}

} // namespace mpuvdb
