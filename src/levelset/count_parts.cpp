#include "count_parts.h"

#include "block_parts.h"

#include <mpuvdb/progress.h>
#include <mpuvdb/union_find.h>

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using Upper = Tree::RootNodeType::ChildNodeType;
using Lower = Upper::ChildNodeType;

/// Where a block of a leaf's size, or a tile, is in the tree.
struct Place {
    enum Kind { Root, UpperTile, LowerTile, InLeaf, None }; ///< none: smaller ones are there
    Kind kind = Root;
    std::uint32_t index = 0; ///< of a leaf, or of a tile among all that there may be
    float value = 0;         ///< of a tile
};

/// Where the leaves and tiles of a tree are.
class Blocks
{
public:
    Blocks(const Tree& tree, Progress& progress) : mTree(tree)
    {
        tree.getNodes(mUppers);
        tree.getNodes(mLowers);
        for (std::uint32_t n = 0; n < mUppers.size(); ++n) mUpperAt[mUppers[n]->origin()] = n;
        mLeafOf.resize(mLowers.size() * Lower::NUM_VALUES);
        for (std::uint32_t n = 0; n < mLowers.size(); ++n) {
            mLowerAt[mLowers[n]->origin()] = n;
            mBox.expand(mLowers[n]->getNodeBoundingBox());
            for (auto child = mLowers[n]->cbeginChildOn(); child; ++child) {
                mLeafOf[n * Lower::NUM_VALUES + child.pos()] = std::uint32_t(mLeaves.size());
                mLeaves.push_back(&*child);
            }
        }
        mInside.resize(mLeaves.size());
        tbb::parallel_for(std::size_t(0), mLeaves.size(), [&](std::size_t n) {
            if (n % 256 == 0) progress.check();
            mInside[n] = wordsWhere(mLeaves[n]->buffer().data(), [](float v) { return v < 0; });
        });
    }

    const std::vector<const Leaf*>& leaves() const { return mLeaves; }
    /// Beyond this nothing is enclosed; empty without leaves.
    const openvdb::CoordBBox& box() const { return mBox; }
    /// The voxels of a leaf that are inside.
    const SignWords& insideOf(std::size_t leaf) const { return mInside[leaf]; }
    const std::vector<const Lower*>& lowers() const { return mLowers; }
    const std::vector<const Upper*>& uppers() const { return mUppers; }

    Place at(const Coord& c) const
    {
        if (const auto lower = mLowerAt.find(c & ~int(Lower::DIM - 1)); lower != mLowerAt.end())
            return inLower(lower->second, Lower::coordToOffset(c));
        if (const auto upper = mUpperAt.find(c & ~int(Upper::DIM - 1)); upper != mUpperAt.end())
            return inUpper(upper->second, Upper::coordToOffset(c));
        return {Place::Root, 0, mTree.getValue(c)};
    }
    Place inLower(std::uint32_t n, openvdb::Index slot) const
    {
        const std::uint32_t index = n * Lower::NUM_VALUES + slot;
        if (mLowers[n]->isChildMaskOn(slot)) return {Place::InLeaf, mLeafOf[index], 0};
        return {Place::LowerTile, index, mLowers[n]->getTable()[slot].getValue()};
    }
    Place inUpper(std::uint32_t n, openvdb::Index slot) const
    {
        if (mUppers[n]->isChildMaskOn(slot)) return {Place::None, 0, 0};
        if (!mBox.isInside(mUppers[n]->offsetToGlobalCoord(slot)))
            return {Place::Root, 0, mUppers[n]->getTable()[slot].getValue()};
        return {Place::UpperTile, std::uint32_t(n * Upper::NUM_VALUES + slot),
                mUppers[n]->getTable()[slot].getValue()};
    }

private:
    const Tree& mTree;
    std::vector<const Leaf*> mLeaves;
    std::vector<SignWords> mInside; ///< by leaf
    std::vector<const Lower*> mLowers;
    std::vector<const Upper*> mUppers;
    std::vector<std::uint32_t> mLeafOf; ///< by lower node and slot
    openvdb::CoordBBox mBox;            ///< of the lower nodes
    std::unordered_map<Coord, std::uint32_t> mUpperAt, mLowerAt;
};

/// The connected parts of all voxels on one side. All space beyond the tree is one place.
class SideParts
{
public:
    SideParts(const Blocks& blocks, bool inside, Progress& progress)
        : mBlocks(blocks), mInside(inside), mPieces(blocks.leaves().size())
    {
        tbb::parallel_for(std::size_t(0), mPieces.size(), [&](std::size_t n) {
            if (n % 256 == 0) progress.check();
            SignWords words = blocks.insideOf(n);
            if (!inside)
                for (std::uint64_t& word : words) word = ~word;
            mPieces[n] = connectedParts(words);
        });
        for (const auto& pieces : mPieces) {
            mFirst.push_back(mCount);
            mCount += std::uint32_t(pieces.size());
        }
        mLowerTiles = mCount;
        mUpperTiles = mLowerTiles + std::uint32_t(blocks.lowers().size()) * Lower::NUM_VALUES;
        mRoot = mUpperTiles + std::uint32_t(blocks.uppers().size()) * Upper::NUM_VALUES;
        mNodes = UnionFind(mRoot + 1);
        joinAll(progress);
    }

    /// Those of at least @a speck voxels, but for the one that is all around.
    std::uint64_t count(std::uint64_t speck)
    {
        std::unordered_map<std::uint32_t, std::uint64_t> voxels; // by root
        const std::uint32_t around = mNodes.find(mRoot);
        for (std::size_t n = 0; n < mPieces.size(); ++n)
            for (std::size_t p = 0; p < mPieces[n].size(); ++p)
                voxels[mNodes.find(mFirst[n] + std::uint32_t(p))] += countVoxels(mPieces[n][p]);
        std::uint64_t parts = 0;
        for (const auto& [root, count] : voxels) parts += root != around && count >= speck;
        return parts;
    }

private:
    bool isOnSide(const Place& place) const // a leaf may be on both
    {
        return place.kind == Place::InLeaf || (place.value < 0) == mInside;
    }

    std::uint32_t nodeOf(const Place& tile) const
    {
        return tile.kind == Place::LowerTile   ? mLowerTiles + tile.index
               : tile.kind == Place::UpperTile ? mUpperTiles + tile.index
                                               : mRoot;
    }

    /// Join what meets across the face between @a a and its upper neighbor @a b on @a axis.
    void join(const Place& a, const Place& b, int axis)
    {
        if (a.kind == Place::None || b.kind == Place::None || !isOnSide(a) || !isOnSide(b)) return;
        const bool leafA = a.kind == Place::InLeaf, leafB = b.kind == Place::InLeaf;
        if (!leafA && !leafB) {
            mNodes.join(nodeOf(a), nodeOf(b));
        } else if (leafA && leafB) {
            for (std::size_t p = 0; p < mPieces[a.index].size(); ++p)
                for (std::size_t q = 0; q < mPieces[b.index].size(); ++q)
                    if (meet(mPieces[a.index][p], mPieces[b.index][q], axis))
                        mNodes.join(mFirst[a.index] + std::uint32_t(p),
                                    mFirst[b.index] + std::uint32_t(q));
        } else {
            const Place &leaf = leafA ? a : b, &tile = leafA ? b : a;
            for (std::size_t p = 0; p < mPieces[leaf.index].size(); ++p)
                if (reachesFace(mPieces[leaf.index][p], axis, leafA))
                    mNodes.join(mFirst[leaf.index] + std::uint32_t(p), nodeOf(tile));
        }
    }

    /// Join the slots of a node with those above them, and with what is wider below them, which
    /// does not look for them itself. @param placeAt  of a slot.
    template <class Node, class PlaceAt>
    void joinSlots(const Node& node, const PlaceAt& placeAt)
    {
        // Slots that hold a lower node, and tiles beyond all of them, have nothing to look for.
        openvdb::CoordBBox within = mBlocks.box();
        within.intersect(node.getNodeBoundingBox());
        constexpr int kStep = int(Node::ChildNodeType::DIM);
        for (int x = within.min().x(); x <= within.max().x(); x += kStep)
            for (int y = within.min().y(); y <= within.max().y(); y += kStep)
                for (int z = within.min().z(); z <= within.max().z(); z += kStep) {
                    const openvdb::Index slot = Node::coordToOffset({x, y, z});
                    const Place place = placeAt(slot);
                    if (place.kind == Place::None || !isOnSide(place)) continue;
                    for (int axis = 0; axis < 3; ++axis)
                        joinAlong<Node>(axis, {x, y, z}, slot, place, placeAt);
                }
    }

    /// The same for one slot at @a origin, along an axis.
    template <class Node, class PlaceAt>
    void joinAlong(int axis, const Coord& origin, openvdb::Index slot, const Place& place,
                   const PlaceAt& placeAt)
    {
        const auto shift = Node::LOG2DIM * openvdb::Index(2 - axis);
        const openvdb::Index last = (1 << Node::LOG2DIM) - 1, along = slot >> shift & last;
        const auto beside = [&](int by) {
            Coord at = origin;
            at[axis] += by;
            return mBlocks.at(at);
        };
        const Place above =
            along < last ? placeAt(slot + (1u << shift)) : beside(int(Node::ChildNodeType::DIM));
        // A tile leaves smaller ones in another node to look for it.
        if (above.kind <= place.kind || place.kind > Place::UpperTile) join(place, above, axis);
        const Place below = along > 0 ? placeAt(slot - (1u << shift)) : beside(-1);
        if (below.kind < std::min(place.kind, Place::LowerTile)) join(below, place, axis);
    }

    void joinAll(Progress& progress)
    {
        for (std::uint32_t n = 0; n < mBlocks.lowers().size(); ++n) {
            progress.check();
            joinSlots(*mBlocks.lowers()[n],
                      [&](openvdb::Index slot) { return mBlocks.inLower(n, slot); });
        }
        for (std::uint32_t n = 0; n < mBlocks.uppers().size(); ++n) {
            progress.check();
            joinSlots(*mBlocks.uppers()[n],
                      [&](openvdb::Index slot) { return mBlocks.inUpper(n, slot); });
        }
    }

    const Blocks& mBlocks;
    bool mInside;
    std::vector<std::vector<SignWords>> mPieces; ///< by leaf
    std::vector<std::uint32_t> mFirst;           ///< of each leaf, the first piece's node
    std::uint32_t mCount = 0, mLowerTiles = 0, mUpperTiles = 0, mRoot = 0;
    UnionFind mNodes{0};
};

} // namespace

PartCounts countParts(const LevelSet& levelSet, Progress& progress)
{
    constexpr std::uint64_t kSpeck = 8; // voxels
    const Blocks blocks(levelSet.grid().tree(), progress);
    PartCounts counts;
    tbb::parallel_invoke(
        [&] { counts.parts = SideParts(blocks, true, progress).count(kSpeck); },
        [&] { counts.cavities = SideParts(blocks, false, progress).count(kSpeck); });
    return counts;
}

} // namespace mpuvdb
