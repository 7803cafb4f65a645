// A block's values with those of the voxels around it.
#pragma once
#include <mpuvdb/field.h>

#include <algorithm>
#include <array>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// The values of a block's voxels, scaled, with so many layers below and above on each axis.
template <int kBelow, int kAbove>
struct BlockWindow {
    static constexpr int kDim = kBelow + kBlockDim + kAbove; ///< edge, voxels [derived: sum]
    /// Steps to the next voxel along x, y, z. [derived: kDim]
    static constexpr std::array<int, 3> kStride = {kDim * kDim, kDim, 1};
    std::array<float, std::size_t(kDim) * kDim * kDim> value;

    /// Index of the voxel at (x,y,z) in the block, each in [-kBelow, kBlockDim + kAbove).
    static constexpr int index(int x, int y, int z)
    {
        return ((x + kBelow) * kDim + y + kBelow) * kDim + z + kBelow;
    }
    float operator[](int at) const { return value[std::size_t(at)]; }

    /// Load the parts beyond @a least to @a most of the block's faces: 0 is the block, 1 beyond its
    /// faces, 2 edges, 3 corners.
    template <class Access>
    void load(const Access& access, const openvdb::Coord& origin, float scale, int least = 0,
              int most = 3)
    {
        for (int n = 0; n < 27; ++n) {
            const openvdb::Coord side(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            const int beyond = std::abs(side[0]) + std::abs(side[1]) + std::abs(side[2]);
            if (beyond >= least && beyond <= most) loadSide(access, origin, side, scale);
        }
    }

private:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    /// Along each axis: the last layers of a lower neighbor, all of the block, the first layers of
    /// an upper neighbor.
    template <class Access>
    void loadSide(const Access& access, const openvdb::Coord& origin, const openvdb::Coord& side,
                  float scale)
    {
        const openvdb::Coord there =
            origin + openvdb::Coord(side[0] * kBlockDim, side[1] * kBlockDim, side[2] * kBlockDim);
        const Leaf* const leaf = access.probeConstLeaf(there);
        const auto from = [](int s) { return s < 0 ? kBlockDim - kBelow : 0; };
        const auto to = [](int s) { return s < 0 ? -kBelow : s > 0 ? kBlockDim : 0; };
        const auto count = [](int s) { return s < 0 ? kBelow : s > 0 ? kAbove : kBlockDim; };
        const int first = (from(side[0]) * kBlockDim + from(side[1])) * kBlockDim + from(side[2]);
        const Rows rows{leaf ? leaf->buffer().data() + first : nullptr,
                        leaf ? 0 : access.getValue(there) * scale, scale, count(side[0]),
                        count(side[1])};
        float* const target = &value[std::size_t(index(to(side[0]), to(side[1]), to(side[2])))];
        if (side[2] < 0)
            copyRows<kBelow>(rows, target);
        else if (side[2] == 0)
            copyRows<kBlockDim>(rows, target);
        else
            copyRows<kAbove>(rows, target);
    }

    /// Some rows along z of a leaf's values, or of a tile's.
    struct Rows {
        const float* first; ///< or null
        float tile, scale;
        int countX, countY;
    };

    /// Copy rows of kCount values; as a constant, a row takes one or two instructions.
    template <int kCount>
    static void copyRows(const Rows& rows, float* target)
    {
        for (int x = 0; x < rows.countX; ++x)
            for (int y = 0; y < rows.countY; ++y) {
                float* const row = target + x * kStride[0] + y * kStride[1];
                const float* const own = rows.first + (x * kBlockDim + y) * kBlockDim;
                for (int z = 0; z < kCount; ++z)
                    row[z] = rows.first ? own[z] * rows.scale : rows.tile;
            }
    }
};

/// A leaf's values with a rim of one voxel.
using LeafHalo = BlockWindow<1, 1>;

} // namespace mpuvdb
