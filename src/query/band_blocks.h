// The blocks about a level set's band, by keys that fit an integer.
#pragma once
#include <mpuvdb/field.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// The blocks of a level set that may hold places in its band, numbered.
class BandBlocks
{
public:
    /// Key of a place beyond the blocks. [derived: the type's largest]
    static constexpr std::uint64_t kFar = ~std::uint64_t(0);

    explicit BandBlocks(const openvdb::FloatTree& tree)
    {
        openvdb::CoordBBox box;
        tree.evalLeafBoundingBox(box);
        if (box.empty()) return;
        // A cell's voxels may lie in the next block.
        mFirst = (box.min() >> 3).offsetBy(-1);
        const openvdb::Coord last = box.max() >> 3;
        for (int axis = 0; axis < 3; ++axis)
            mCount[std::size_t(axis)] = std::uint64_t(last[axis] - mFirst[axis]) + 1;
        const double blocks = double(mCount[0]) * double(mCount[1]) * double(mCount[2]);
        if (blocks > kMostBlocks) {
            mCount = {};
            return;
        }
        const std::uint64_t all = mCount[0] * mCount[1] * mCount[2];
        while (all >> mBits) ++mBits;
    }

    /// Bits of keys; kFar is larger in them than all others.
    int bits() const { return mBits; }
    /// The block that holds @a at, voxels; kFar if there is none. @param within  becomes the place
    /// in it, voxels from its origin.
    std::uint64_t find(const Vec3d& at, Vec3f& within) const
    {
        std::uint64_t key = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double from = at[axis] / kBlockDim - mFirst[axis];
            const std::uint64_t count = mCount[std::size_t(axis)];
            if (!(from >= 0 && from < double(count))) return kFar;
            const auto block = std::int64_t(from);
            key = key * count + std::uint64_t(block);
            within[axis] = std::min(float(kBlockDim * (from - double(block))), kLast);
        }
        return key;
    }
    openvdb::Coord origin(std::uint64_t key) const
    {
        const std::uint64_t row = key / mCount[2];
        const openvdb::Coord block(int(row / mCount[1]), int(row % mCount[1]),
                                   int(key % mCount[2]));
        return (mFirst + block) << 3;
    }

private:
    /// Most blocks that keys number; parts that are farther apart have none. [derived: with the
    /// bits of cubes and rounded as doubles, keys are below 2^63]
    static constexpr double kMostBlocks = 0x1p56;
    /// The last place in a block, voxels from its origin. [derived: the float below 8]
    static constexpr float kLast = 8 - 0x1p-21f;

    openvdb::Coord mFirst;
    std::array<std::uint64_t, 3> mCount{};
    int mBits = 1;
};

} // namespace mpuvdb
