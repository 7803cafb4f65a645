// A sparse set of numbered voxels.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>
#include <unordered_map>
#include <vector>

namespace mpuvdb
{

/// A set of voxels, numbered leaf by leaf in the order in which the leaves were first added, and
/// within a leaf by offset.
class VoxelIndex
{
public:
    /// Number of a voxel that is not in the set. [derived: the type's largest]
    static constexpr std::uint32_t kNone = ~std::uint32_t(0);

    void add(const openvdb::Coord& voxel)
    {
        Block& block = blockAt(voxel & ~(kBlockDim - 1));
        const auto n = offset(voxel);
        block.voxels[n >> 6] |= std::uint64_t(1) << (n & 63);
    }
    /// Number the voxels; to be called once, after all were added.
    void number()
    {
        mCount = 0;
        for (Block& block : mBlocks) {
            block.first = mCount;
            std::uint32_t before = 0;
            for (std::size_t word = 0; word < kBlockDim; ++word) {
                block.before[word] = std::uint16_t(before);
                before += std::uint32_t(__builtin_popcountll(block.voxels[word]));
            }
            mCount += before;
        }
    }
    std::uint32_t count() const { return mCount; }
    /// All voxels by number.
    std::vector<openvdb::Coord> voxels() const
    {
        std::vector<openvdb::Coord> all;
        all.reserve(mCount);
        for (const Block& block : mBlocks)
            for (int word = 0; word < kBlockDim; ++word)
                for (std::uint64_t bits = block.voxels[std::size_t(word)]; bits; bits &= bits - 1) {
                    const int bit = __builtin_ctzll(bits);
                    all.push_back(block.origin + openvdb::Coord(word, bit >> 3, bit & 7));
                }
        return all;
    }

private:
    friend class VoxelNumbers;
    struct Block {
        openvdb::Coord origin;
        std::uint32_t first = 0;
        std::array<std::uint64_t, kBlockDim> voxels = {};
        std::array<std::uint16_t, kBlockDim> before = {}; ///< count of voxels in the words before
    };

    static std::uint32_t offset(const openvdb::Coord& c)
    {
        return std::uint32_t((c[0] & 7) << 6 | (c[1] & 7) << 3 | (c[2] & 7));
    }
    Block& blockAt(const openvdb::Coord& origin)
    {
        if (mLast < mBlocks.size() && mBlocks[mLast].origin == origin) return mBlocks[mLast];
        const auto [found, isNew] = mIndex.emplace(origin, mBlocks.size());
        if (isNew) {
            mBlocks.emplace_back();
            mBlocks.back().origin = origin;
        }
        mLast = found->second;
        return mBlocks[mLast];
    }

    std::vector<Block> mBlocks;
    std::unordered_map<openvdb::Coord, std::size_t> mIndex; ///< of blocks by origin
    std::size_t mLast = 0;                                  ///< block of the last voxel added
    std::uint32_t mCount = 0;
};

/// Looks up numbers of voxels, fastest for voxels that are near each other. For one thread.
class VoxelNumbers
{
public:
    explicit VoxelNumbers(const VoxelIndex& index) : mIndex(index) {}

    /// The voxel's number; VoxelIndex::kNone if it is not in the set.
    std::uint32_t operator[](const openvdb::Coord& voxel)
    {
        openvdb::Coord side = (voxel - mHome) >> 3;
        if (!mHasHome || std::max({side[0], side[1], side[2]}) > 1 ||
            std::min({side[0], side[1], side[2]}) < -1) {
            moveTo(voxel & ~(kBlockDim - 1));
            side = {0, 0, 0};
        }
        const int near = side[0] * 9 + side[1] * 3 + side[2] + 13;
        const Block* const block = mNear[std::size_t(near)];
        if (!block) return VoxelIndex::kNone;
        const std::uint32_t n = VoxelIndex::offset(voxel);
        const std::uint64_t word = block->voxels[n >> 6], bit = std::uint64_t(1) << (n & 63);
        if (!(word & bit)) return VoxelIndex::kNone;
        return block->first + block->before[n >> 6] +
               std::uint32_t(__builtin_popcountll(word & (bit - 1)));
    }

private:
    using Block = VoxelIndex::Block;

    void moveTo(const openvdb::Coord& home)
    {
        mHasHome = true;
        mHome = home;
        for (int n = 0; n < 27; ++n) {
            const auto found = mIndex.mIndex.find(home.offsetBy(
                (n / 9 - 1) * kBlockDim, (n / 3 % 3 - 1) * kBlockDim, (n % 3 - 1) * kBlockDim));
            mNear[std::size_t(n)] =
                found == mIndex.mIndex.end() ? nullptr : &mIndex.mBlocks[found->second];
        }
    }

    const VoxelIndex& mIndex;
    bool mHasHome = false;
    openvdb::Coord mHome;
    std::array<const Block*, 27> mNear;
};

} // namespace mpuvdb
