// Signs of the space between the leaves of a level set, whose voxels lie in files.
#pragma once
#include "leaf_format.h"

namespace mpuvdb
{

/// Gives the space between the leaves of @a tree the sign of those beside it. @param places  of its
/// leaves, by their transient data.
void fillSigns(openvdb::FloatTree& tree, const std::vector<LeafPlace>& places);

/// Signs of the blocks in a box of a level set, some of which are leaves.
class BlockSigns
{
public:
    /// @param leaves  in @a box, at least one. @param box  of whole blocks. @throws Interrupted.
    BlockSigns(const std::vector<LeafPlace>& leaves, const openvdb::CoordBBox& box,
               const Interrupter& progress);

    /// Whether the block with @a voxel, which is in the box and no leaf, is inside.
    bool isInside(const openvdb::Coord& voxel) const { return mStates[at(voxel)] == State::Inside; }
    /// What fill() sets.
    enum class Fill {
        All,
        /// Only in nodes of leaves (128 voxels) that have a leaf or are filled as a whole:
        /// OpenVDB's operations take a node without active voxels to be of one sign.
        Lasting
    };
    /// Set the blocks that are inside and not leaves to tiles of @a tree.
    void fill(openvdb::FloatTree& tree, Fill what, const Interrupter& progress) const;

private:
    enum class State : std::uint8_t { Unknown, Inside, Outside, Leaf };

    std::size_t at(const openvdb::Coord& voxel) const;
    bool isInsideWhole(const openvdb::CoordBBox& box) const;
    bool hasLeaf(const openvdb::CoordBBox& box) const;

    openvdb::CoordBBox mBox;
    std::array<std::size_t, 3> mCount; ///< blocks
    std::vector<State> mStates;
};

} // namespace mpuvdb
