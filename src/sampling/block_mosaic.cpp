#include "block_mosaic.h"

#include "core/clones.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Margin around a block on which its gaps depend, and edge of both, voxels. [derived: two voxels
/// to grow, and two to shrink]
constexpr int kMargin = 4;
constexpr int kSide = kBlockDim + 2 * kMargin;

/// A block and its margin: a row of z for each x and y.
using Rows = std::array<std::uint16_t, kSide * kSide>;

void invert(Rows& rows)
{
    for (std::uint16_t& r : rows) r = std::uint16_t(~r);
}

/// Dilate by one voxel on each side. Nothing beyond the margin is in the set.
inline void grow(Rows& rows)
{
    for (std::uint16_t& r : rows) r = std::uint16_t(r | r << 1 | r >> 1);
    for (const std::size_t step : {std::size_t(1), std::size_t(kSide)}) {
        const Rows before = rows;
        for (std::size_t n = step; n + step < rows.size(); ++n)
            rows[n] = std::uint16_t(before[n] | before[n - step] | before[n + step]);
    }
}

/// Morphological closing by a cube of @a reach voxels to each side.
MPUVDB_CLONES
void closeGaps(Rows& rows, int reach)
{
    for (int n = 0; n < reach; ++n) grow(rows);
    invert(rows);
    for (int n = 0; n < reach; ++n) grow(rows);
    invert(rows);
}

/// The rows without the margin.
SignWords core(const Rows& rows)
{
    SignWords words{};
    for (int x = 0; x < kBlockDim; ++x)
        for (int y = 0; y < kBlockDim; ++y) {
            const unsigned row = rows[std::size_t(x + kMargin) * kSide + std::size_t(y + kMargin)];
            words[std::size_t(x)] |= std::uint64_t(row >> kMargin & 0xffu) << (8 * y);
        }
    return words;
}

bool bitOf(const SignWords& words, int x, int y, int z)
{
    return words[std::size_t(x)] >> (8 * y + z) & 1u;
}

/// The coordinate of the voxels in a block that are nearest to the next block on one side.
int edgeOf(int side)
{
    return side > 0 ? kBlockDim - 1 : 0;
}

using Blocks = std::array<SignWords, 27>; ///< as in BlockMosaic::Around

Blocks gather(const std::vector<SignWords>& set, std::size_t block,
              const BlockMosaic::Around& around)
{
    Blocks words;
    for (int n = 0; n < 27; ++n) {
        const std::uint32_t next = around[std::size_t(n)];
        if (next != BlockMosaic::kNoBlock) {
            words[std::size_t(n)] = set[next];
        } else {
            const bool on =
                bitOf(set[block], edgeOf(n / 9 - 1), edgeOf(n / 3 % 3 - 1), edgeOf(n % 3 - 1));
            words[std::size_t(n)].fill(on ? ~std::uint64_t(0) : 0);
        }
    }
    return words;
}

Rows rowsOf(const Blocks& words)
{
    Rows rows;
    for (int i = 0; i < kSide; ++i) {
        const int x = i + kBlockDim - kMargin;
        for (int j = 0; j < kSide; ++j) {
            const int y = j + kBlockDim - kMargin;
            const std::size_t column = 9 * std::size_t(x >> 3) + 3 * std::size_t(y >> 3);
            const auto byte = [&](std::size_t n) {
                return unsigned(words[column + n][std::size_t(x & 7)] >> (8 * (y & 7))) & 0xffu;
            };
            rows[std::size_t(i) * kSide + std::size_t(j)] =
                std::uint16_t(byte(0) >> (kBlockDim - kMargin) | byte(1) << kMargin |
                              byte(2) << (kMargin + kBlockDim));
        }
    }
    return rows;
}

} // namespace

Neighborhood BlockMosaic::neighborhood(const std::vector<SignWords>& set, VoxelId voxel) const
{
    const Place p = placeOf(voxel);
    const SignWords& own = set[p.block];
    const auto inner = [](int c) { return c > 0 && c < kBlockDim - 1; };
    Neighborhood result = 0;
    if (inner(p.x) && inner(p.y) && inner(p.z)) {
        for (int dx = 0; dx < 3; ++dx) {
            const std::uint64_t w = own[std::size_t(p.x + dx - 1)] >> (8 * (p.y - 1) + p.z - 1);
            result |= Neighborhood((w & 7) | (w >> 5 & 0x38) | (w >> 10 & 0x1c0)) << (9 * dx);
        }
        return result;
    }
    for (int n = 0; n < 27; ++n) {
        const int d[3] = {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1};
        const VoxelId next = at(p, d[0], d[1], d[2]);
        const auto clamped = [](int c) { return std::clamp(c, 0, kBlockDim - 1); };
        const bool on = next != kNoVoxel ? contains(set, next)
                                         : bitOf(own, clamped(p.x + d[0]), clamped(p.y + d[1]),
                                                 clamped(p.z + d[2]));
        result |= Neighborhood(on) << n;
    }
    return result;
}

void BlockMosaic::findNarrow(const std::vector<SignWords>& set, std::size_t block, int reach,
                             SignWords& gaps, SignWords& parts) const
{
    gaps = parts = {};
    const Blocks blocks = gather(set, block, mAround[block]);
    const std::uint64_t first = blocks[0][0];
    const auto isFirst = [&](const SignWords& words) {
        return std::all_of(words.begin(), words.end(), [&](auto w) { return w == first; });
    };
    if ((first == 0 || first == ~std::uint64_t(0)) &&
        std::all_of(blocks.begin(), blocks.end(), isFirst))
        return;
    Rows rows = rowsOf(blocks), rest = rows;
    closeGaps(rows, reach);
    invert(rest);
    closeGaps(rest, reach);
    const SignWords closed = core(rows), restClosed = core(rest);
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        gaps[x] = closed[x] & ~set[block][x];
        parts[x] = restClosed[x] & set[block][x];
    }
}

} // namespace mpuvdb
