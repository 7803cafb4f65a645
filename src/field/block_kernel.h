// The inner loop of sampling: one cell's weighted fit added to the sums of one 8x8x8 block.
#pragma once
#include <mpuvdb/field.h>

#include <array>

namespace mpuvdb
{

/// Sums over the cells of a block: weight, weight * Q, weight * grad Q, and weight * (1 - support).
/// Block coordinates: voxels.
struct BlockSums {
    alignas(64) std::array<float, kBlockVoxels> weight, value, gx, gy, gz, unsupported;
    void clear();
};

/// A cell as the kernel wants it; all in voxels about the block's first voxel.
struct KernelCell {
    static constexpr int kMaxPieces = 4;
    float centre[3]; ///< of the support ball
    float radius;
    int count; ///< pieces; folded as LocalFit says
    unsigned maxBits;
    float unsupported; ///< 1 - support of the cell
    /// Q(t) = c0 + c1 x + c2 y + c3 z + c4 xx + c5 yy + c6 zz + c7 xy + c8 yz + c9 zx
    float q[kMaxPieces][10];
};

/// Add @a cell to @a sums. Several instruction sets, chosen at run time; the same bits from all.
void addCell(const KernelCell& cell, BlockSums& sums);
/// The same with the weight that is singular at the ball's centre, for interpolation.
void addSingularCell(const KernelCell& cell, BlockSums& sums);

/// Turn the sums into distances (voxels): value / max(|gradient|, 0.8), clamped to +-@a limit.
/// Where no cell contributes: +limit.
void normalise(const BlockSums& sums, float limit, BlockValues& values);

} // namespace mpuvdb
