// A leaf's values with a rim of one voxel.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// A leaf's values with those of the voxels around it, scaled.
struct LeafHalo {
    using Leaf = openvdb::FloatTree::LeafNodeType;
    using Accessor = openvdb::tree::ValueAccessor<const openvdb::FloatTree>;

    static constexpr int kHalo = kBlockDim + 2; ///< edge with the rim, voxels [derived: sum]
    /// Steps to the next voxel along x, y, z. [derived: kHalo]
    static constexpr int kStride[3] = {kHalo * kHalo, kHalo, 1};
    std::array<float, kHalo * kHalo * kHalo> value;

    /// Voxel (x,y,z) of the leaf is at index(x + 1, y + 1, z + 1).
    static constexpr int index(int x, int y, int z) { return (x * kHalo + y) * kHalo + z; }

    void load(const Accessor& access, const Leaf& leaf, float scale)
    {
        loadFaces(access, leaf, scale);
        loadEdges(access, leaf, scale);
    }
    /// All but the edges and corners of the rim.
    void loadFaces(const Accessor& access, const Leaf& leaf, float scale)
    {
        const float* const own = leaf.buffer().data();
        for (int row = 0; row < kBlockDim * kBlockDim; ++row)
            for (int z = 0; z < kBlockDim; ++z)
                value[index((row >> 3) + 1, (row & 7) + 1, 1) + z] =
                    own[row * kBlockDim + z] * scale;
        for (int n = 0; n < 27; ++n)
            if (isFace(n)) loadSide(access, leaf.origin(), sideOf(n), scale);
    }
    /// The edges and corners of the rim.
    void loadEdges(const Accessor& access, const Leaf& leaf, float scale)
    {
        for (int n = 0; n < 27; ++n)
            if (n != 13 && !isFace(n)) loadSide(access, leaf.origin(), sideOf(n), scale);
    }

private:
    static openvdb::Coord sideOf(int n) { return {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1}; }
    static bool isFace(int n)
    {
        const openvdb::Coord side = sideOf(n);
        return side[0] * side[0] + side[1] * side[1] + side[2] * side[2] == 1;
    }
    /// Along each axis: the last layer of a lower neighbor, all of the leaf, the first layer of an
    /// upper neighbor.
    void loadSide(const Accessor& access, const openvdb::Coord& origin, const openvdb::Coord& side,
                  float scale)
    {
        const openvdb::Coord there =
            origin + openvdb::Coord(side[0] * kBlockDim, side[1] * kBlockDim, side[2] * kBlockDim);
        const Leaf* const leaf = access.probeConstLeaf(there);
        const float* const data = leaf ? leaf->buffer().data() : nullptr;
        const float tile = leaf ? 0 : access.getValue(there) * scale;
        const auto first = [](int s) { return s < 0 ? kBlockDim - 1 : 0; };
        const auto last = [](int s) { return s > 0 ? 0 : kBlockDim - 1; };
        for (int x = first(side[0]); x <= last(side[0]); ++x)
            for (int y = first(side[1]); y <= last(side[1]); ++y) {
                float* const row =
                    &value[index(x + 1 + side[0] * kBlockDim, y + 1 + side[1] * kBlockDim,
                                 1 + side[2] * kBlockDim)];
                const float* const from = data + (x * kBlockDim + y) * kBlockDim;
                if (side[2] == 0)
                    for (int z = 0; z < kBlockDim; ++z) row[z] = data ? from[z] * scale : tile;
                else
                    row[first(side[2])] = data ? from[first(side[2])] * scale : tile;
            }
    }
};

} // namespace mpuvdb
