// A set of voxels in the sampled blocks, read across the blocks' borders.
#pragma once
#include "band.h"
#include "grid/voxel_topology.h"

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The blocks around each block. Voxels beyond all blocks are like the nearest of the block at
/// hand.
class BlockMosaic
{
public:
    static constexpr std::uint32_t kNoBlock = ~0u; ///< number of none [derived: type's largest]
    using Around = std::array<std::uint32_t, 27>;  ///< 9 (dx + 1) + 3 (dy + 1) + (dz + 1)

    explicit BlockMosaic(std::vector<Around> around) : mAround(std::move(around)) {}

    std::size_t size() const { return mAround.size(); }
    Neighborhood neighborhood(const std::vector<SignWords>& set, VoxelId voxel) const;
    /// Narrow gaps: voxels of @a block that are not in @a set, but in its morphological closing by
    /// a cube of @a reach voxels to each side (at most 2). Narrow parts: the gaps of the
    /// complement.
    void findNarrow(const std::vector<SignWords>& set, std::size_t block, int reach,
                    SignWords& gaps, SignWords& parts) const;
    /// Call f(neighbor) for the voxels around one that lie in blocks. @param which  mask of them.
    template <typename F>
    void forEachAround(VoxelId voxel, Neighborhood which, F f) const
    {
        const Place p = placeOf(voxel);
        for (; which; which &= which - 1) {
            const int n = __builtin_ctz(which);
            const VoxelId next = at(p, n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            if (next != kNoVoxel) f(next);
        }
    }

private:
    static constexpr VoxelId kNoVoxel = ~VoxelId(0);
    struct Place {
        std::size_t block;
        int x, y, z;
    };
    static Place placeOf(VoxelId v)
    {
        return {std::size_t(v / kBlockVoxels), int(v >> 6 & 7), int(v >> 3 & 7), int(v & 7)};
    }
    VoxelId at(const Place& p, int dx, int dy, int dz) const
    {
        const int x = p.x + dx, y = p.y + dy, z = p.z + dz;
        const std::uint32_t block =
            mAround[p.block][9 * std::size_t((x >> 3) + 1) + 3 * std::size_t((y >> 3) + 1) +
                             std::size_t((z >> 3) + 1)];
        if (block == kNoBlock) return kNoVoxel;
        return VoxelId(block) * kBlockVoxels + VoxelId((x & 7) << 6 | (y & 7) << 3 | (z & 7));
    }

    std::vector<Around> mAround;
};

inline bool contains(const std::vector<SignWords>& set, VoxelId voxel)
{
    const auto i = voxel % kBlockVoxels;
    return set[voxel / kBlockVoxels][i / 64] >> (i % 64) & 1u;
}

inline void turn(std::vector<SignWords>& set, VoxelId voxel)
{
    const auto i = voxel % kBlockVoxels;
    set[voxel / kBlockVoxels][i / 64] ^= std::uint64_t(1) << (i % 64);
}

} // namespace mpuvdb
