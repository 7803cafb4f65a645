// The inner loops of sampling: cells' weighted fits added to the sums of one 8x8x8 block, in cubes
// of 2x2x2 voxels. Several instruction sets, chosen at run time; the same bits from all.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Some of a block's 4x4x4 cubes: bit 16 x + 4 y + z.
using CubeSet = std::uint64_t;
constexpr CubeSet kAllCubes = ~CubeSet(0);
constexpr int kCubeVoxels = 8;
constexpr int kBlockCubes = kBlockVoxels / kCubeVoxels;

/// Place in the block of the voxel 4 dx + 2 dy + dz of a cube.
constexpr int voxelOf(int cube, int corner)
{
    return (cube >> 4) << 7 | (corner >> 2) << 6 | (cube >> 2 & 3) << 4 | (corner >> 1 & 1) << 3 |
           (cube & 3) << 1 | (corner & 1);
}

/// Sums over the cells of a block, by cube: weight, weight * Q, weight * grad Q, and
/// weight * (1 - support). Block coordinates: voxels.
struct BlockSums {
    struct Cube {
        alignas(32) std::array<float, kCubeVoxels> weight, value, gx, gy, gz, unsupported;
    };
    std::array<Cube, kBlockCubes> cubes;
};

/// The cells of a block as the kernel wants them; all in voxels about the block's first voxel.
struct KernelCells {
    struct Cell {
        std::array<float, 3> center; ///< of the support ball
        float radius;
        float unsupported; ///< 1 - support of the cell
        std::uint32_t firstPiece;
        int count; ///< pieces; folded as LocalFit says
        unsigned maxBits;
        CubeSet cubes; ///< that the ball reaches: from classifyCubes()
    };
    /// Q(t) = c0 + c1 x + c2 y + c3 z + c4 xx + c5 yy + c6 zz + c7 xy + c8 yz + c9 zx
    using Piece = std::array<float, 10>;

    std::vector<Cell> cells;
    std::vector<Piece> pieces;
    void clear();
};

/// What can be said of a block's cubes before they are summed.
struct CubeClasses {
    /// Cubes that some cell may bring closer than the limit on the outside, or to the inside; and
    /// the other way round. What is in one of them only need not be summed: see classifyCubes().
    CubeSet notOutside = 0, notInside = 0;
};

/// Find the cubes that the cells' balls reach (Cell::cubes), and those in which the sums are
/// farther from zero than @a limit, for any weights: where each cell's value is, over the largest
/// gradient that it has in the block, normalize() of the sums is.
CubeClasses classifyCubes(KernelCells& cells, float limit);

/// Set the sums of the cubes in @a wanted. The weight is smooth, or, for interpolation, singular at
/// the ball's center.
void addCells(const KernelCells& cells, CubeSet wanted, bool singular, BlockSums& sums);

/// Turn the sums of the cubes in @a wanted into distances (voxels): value / max(|gradient|, 0.8),
/// clamped to +-@a limit. Where no cell contributes: +limit.
void normalize(const BlockSums& sums, CubeSet wanted, float limit, BlockValues& values);

} // namespace mpuvdb
