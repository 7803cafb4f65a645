// The inner loops of sampling: weighted fits of cells are added to the sums of one 8x8x8 block, in
// cubes of 2x2x2 voxels. The instruction set is chosen at run time; all give the same bits.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// A set of a block's 4x4x4 cubes: bit 16 x + 4 y + z.
using CubeSet = std::uint64_t;
constexpr CubeSet kAllCubes = ~CubeSet(0);
constexpr int kCubeVoxels = 8; ///< voxels of a cube [derived: floats of 256 bits]
/// Cubes of a block. [derived: from both]
constexpr int kBlockCubes = kBlockVoxels / kCubeVoxels;

/// Least slope by which a blended value is divided: below it gradients of sheets cancel, and value
/// / |gradient| is meaningless. [tuned: mpu_field_test]
constexpr double kGradientFloor = 0.8;

/// Index in the block of the voxel 4 dx + 2 dy + dz of a cube.
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

/// The cells of a block, in voxels about the block's first voxel.
struct KernelCells {
    struct Cell {
        std::array<float, 3> center; ///< of the support ball
        float radius;
        float unsupported; ///< 1 - support of the cell
        std::uint32_t firstPiece;
        int count; ///< number of pieces, combined as by rulingPiece()
        unsigned maxBits;
        CubeSet cubes; ///< cubes that the ball reaches, by classifyCubes()
    };
    /// Q(t) = c0 + c1 x + c2 y + c3 z + c4 xx + c5 yy + c6 zz + c7 xy + c8 yz + c9 zx
    using Piece = std::array<float, 10>;

    std::vector<Cell> cells;
    std::vector<Piece> pieces;
    void clear();
};

/// Classes of a block's cubes by bounds of the sums.
struct CubeClasses {
    /// Cubes where some cell's value may be less than the limit, and those where one may be more
    /// than minus the limit. Cubes in only one of the sets need not be summed.
    CubeSet notOutside = 0, notInside = 0;
};

/// Find the cubes that the cells' balls reach (Cell::cubes), and those in which the sums are
/// farther from zero than @a limit for any weights: where each cell's value over its largest
/// gradient in the block is, normalize() of the sums is.
CubeClasses classifyCubes(KernelCells& cells, float limit);

/// Set the sums of the cubes in @a wanted. Weights are smooth, or singular at the ball's center
/// for interpolation.
void addCells(const KernelCells& cells, CubeSet wanted, bool singular, BlockSums& sums);

/// Turn the sums of the cubes in @a wanted into distances (voxels): value / max(|gradient|, 0.8),
/// clamped to +-@a limit. Where no cell contributes: +limit.
void normalize(const BlockSums& sums, CubeSet wanted, float limit, BlockValues& values);

} // namespace mpuvdb
