// A level set's solid, by the leaves and tiles of its tree.
#pragma once
#include "grid/block_parts.h"
#include "solid_sums.h"
#include <mpuvdb/level_set.h>

#include <array>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The leaves and tiles of a tree, with the signs and the sums of one pass over their values. The
/// tree has to outlive it.
class SolidBlocks
{
public:
    using Coord = openvdb::Coord;
    using Tree = openvdb::FloatTree;
    using Leaf = Tree::LeafNodeType;
    using Upper = Tree::RootNodeType::ChildNodeType;
    using Lower = Upper::ChildNodeType;

    /// A leaf or tile of the tree.
    struct Place {
        enum Kind { Root, UpperTile, LowerTile, InLeaf };
        Kind kind = Root;
        std::uint32_t index = 0; ///< number of a leaf, or of a tile among all possible ones
        bool isInside = false;   ///< for a tile
    };

    /// The slots of a lower node, as bits: slot s is bit s % 64 of word s / 64.
    using Slots = std::array<std::uint64_t, Lower::NUM_VALUES / 64>;
    struct LowerNode {
        Coord origin;
        Slots leaves, insideTiles;
    };

    /// @throws Interrupted.
    SolidBlocks(const LevelSet& levelSet, Interrupter& progress);

    const std::vector<const Leaf*>& leaves() const { return mLeaves; }
    /// The voxels of a leaf that are inside.
    const SignWords& insideOf(std::size_t leaf) const { return mInside[leaf]; }
    const std::vector<LowerNode>& lowers() const { return mLowers; }
    std::uint32_t uppers() const { return std::uint32_t(mUppers.size()); }
    /// Number of slots in upper nodes, including those of lower nodes.
    std::uint32_t upperTiles() const { return mUpperTiles; }
    /// Volume and area, world units cubed and squared. The same for any number of threads.
    const SolidSums& sums() const { return mSums; }

    /// The number of the lower node that holds @a c, if one does.
    std::optional<std::uint32_t> lowerAt(const Coord& c) const;
    Place at(const Coord& c) const;
    Place inLower(std::uint32_t node, openvdb::Index slot) const
    {
        const std::uint32_t index = node * Lower::NUM_VALUES + slot;
        const auto has = [slot](const Slots& s) { return (s[slot / 64] >> slot % 64 & 1) != 0; };
        if (has(mLowers[node].leaves)) return {Place::InLeaf, mLeafOf[index], false};
        return {Place::LowerTile, index, has(mLowers[node].insideTiles)};
    }
    /// Call @a f(place, origin) for the tiles of an upper node beside lower nodes or between them.
    template <class F>
    void forEachTile(std::uint32_t node, const F& f) const
    {
        const UpperNode& upper = mUppers[node];
        constexpr int kStep = int(Lower::DIM); ///< edge of a tile, voxels [derived: the tree]
        const openvdb::CoordBBox& box = upper.box;
        for (int x = box.min().x(); x <= box.max().x(); x += kStep)
            for (int y = box.min().y(); y <= box.max().y(); y += kStep)
                for (int z = box.min().z(); z <= box.max().z(); z += kStep)
                    if (!upper.node->isChildMaskOn(Upper::coordToOffset({x, y, z})))
                        f(inUpper(upper, {x, y, z}), Coord(x, y, z));
    }

private:
    /// An upper node and its part in the box of all lower nodes, beyond which nothing is enclosed.
    struct UpperNode {
        const Upper* node;
        openvdb::CoordBBox box;
        std::uint32_t firstTile;
    };

    Place inUpper(const UpperNode& upper, const Coord& c) const;
    void findNodes();
    LowerNode readLower(const Lower& lower);
    void sumTiles();

    const Tree& mTree;
    std::vector<const Leaf*> mLeaves;
    std::vector<SignWords> mInside; ///< by leaf
    std::vector<LowerNode> mLowers;
    std::vector<UpperNode> mUppers;
    std::uint32_t mUpperTiles = 0;
    std::vector<std::uint32_t> mLeafOf; ///< by lower node and slot
    std::unordered_map<Coord, std::uint32_t> mUpperAt, mLowerAt;
    SolidSums mSums;
};

} // namespace mpuvdb
