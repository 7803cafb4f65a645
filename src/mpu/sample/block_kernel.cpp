#include "block_kernel.h"

#include "core/clones.h"
#include "mpu/fit/quadric.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace mpuvdb
{
namespace
{

/// The voxels of a cube, or eight cubes, as one vector; the same bits from every instruction set.
using Row = float __attribute__((vector_size(sizeof(float) * kCubeVoxels)));
using Mask = std::int32_t __attribute__((vector_size(sizeof(std::int32_t) * kCubeVoxels)));

/// Edge of a cube, its center from its first voxel, voxels; cubes along a block's edge; rows of
/// eight cubes, each half a layer across x. [derived: from kCubeVoxels = 2^3 and kBlockDim]
constexpr int kCubeDim = 2;
constexpr float kCubeMiddle = (kCubeDim - 1) / 2.0f;
constexpr int kCubesPerEdge = kBlockDim / kCubeDim;
constexpr int kRows = kBlockCubes / kCubeVoxels;

[[gnu::always_inline]] inline Row load(const std::array<float, kCubeVoxels>& from)
{
    Row row;
    std::memcpy(&row, from.data(), sizeof row);
    return row;
}

[[gnu::always_inline]] inline void store(const Row& row, std::array<float, kCubeVoxels>& to)
{
    std::memcpy(to.data(), &row, sizeof row);
}

[[gnu::always_inline]] inline Row larger(const Row& a, const Row& b)
{
    return a > b ? a : b;
}

[[gnu::always_inline]] inline Row smaller(const Row& a, const Row& b)
{
    return a < b ? a : b;
}

[[gnu::always_inline]] inline Row rowRoot(const Row& row)
{
    float a[kCubeVoxels];
    std::memcpy(a, &row, sizeof row);
    for (float& v : a) v = std::sqrt(v);
    Row root;
    std::memcpy(&root, a, sizeof root);
    return root;
}

using Cell = KernelCells::Cell;
using Piece = KernelCells::Piece;

[[gnu::always_inline]] inline float most(const Row& row)
{
    using Half = float __attribute__((vector_size(sizeof(Row) / 2)));
    Half halves[2];
    std::memcpy(halves, &row, sizeof row);
    const Half m = halves[0] > halves[1] ? halves[0] : halves[1];
    return std::max(std::max(m[0], m[1]), std::max(m[2], m[3]));
}

// --- Classes of cubes

/// Sixty-four flags from comparisons of eight lanes: bit 8 (r % 4) + lane of a lane is that of row
/// r.
class Flags
{
public:
    [[gnu::always_inline]] void set(int row, const Mask& mask)
    {
        const Mask bits = {1, 2, 4, 8, 16, 32, 64, 128};
        mHalves[row / 4] |= mask & (bits << (8 * (row % 4)));
    }
    [[gnu::always_inline]] void add(const Flags& touched, const Flags& except)
    {
        for (int half = 0; half < 2; ++half)
            mHalves[half] |= touched.mHalves[half] & ~except.mHalves[half];
    }
    [[gnu::always_inline]] CubeSet cubes() const
    {
        CubeSet halves[2];
        for (int half = 0; half < 2; ++half) {
            CubeSet parts[4];
            std::memcpy(parts, &mHalves[half], sizeof parts);
            const CubeSet pair = parts[0] | parts[1] | parts[2] | parts[3];
            halves[half] = (pair | pair >> 32) & 0xffffffffu;
        }
        return halves[0] | halves[1] << 32;
    }

private:
    Mask mHalves[2] = {};
};

/// Half a block's edge, voxels. [derived: from kBlockDim]
constexpr float kHalfBlock = kBlockDim / 2.0f;
/// y and z of the first voxels of a row's cubes; in every other row y is half a block more.
const Row kRowY = {0, 0, 0, 0, 2, 2, 2, 2}, kRowZ = {0, 2, 4, 6, 0, 2, 4, 6};

/// Squared distance along an axis from @a at to cubes that begin at @a first.
[[gnu::always_inline]] inline Row squaredGap(const Row& first, float at)
{
    const Row gap = larger(first - at, (at - (kCubeDim - 1)) - first);
    const Row beyond = larger(gap, Row{});
    return beyond * beyond;
}

[[gnu::always_inline]] inline Flags reachedCubes(const Cell& cell)
{
    // The margin is for roundings here and where weights are computed.
    const float radius2 = cell.radius * cell.radius * (1 + 1e-5f);
    const Row z2 = squaredGap(kRowZ, cell.center[2]);
    const Row yz2[2] = {squaredGap(kRowY, cell.center[1]) + z2,
                        squaredGap(kRowY + kHalfBlock, cell.center[1]) + z2};
    Flags reached;
    for (int row = 0; row < kRows; ++row) {
        const int layer = row / 2;
        const float x = float(kCubeDim * layer);
        const float beyond =
            std::max({x - cell.center[0], cell.center[0] - (x + float(kCubeDim - 1)), 0.0f});
        reached.set(row, yz2[row % 2] + beyond * beyond < radius2);
    }
    return reached;
}

/// The value at a cube's center from which on a quadric is beyond @a limit times its gradient in
/// the whole cube: the largest over the part of the block that the ball reaches. As it is convex,
/// that is at a corner.
[[gnu::always_inline]] inline float valueBeyond(const Piece& k, const Cell& cell, float limit)
{
    /// Bound of roundings, voxels. [derived: of coefficients, sums, quotient]
    constexpr float kRoundingMargin = 0.02f;
    const Mask upper[3] = {
        {0, 0, 0, 0, -1, -1, -1, -1}, {0, 0, -1, -1, 0, 0, -1, -1}, {0, -1, 0, -1, 0, -1, 0, -1}};
    Row corner[3];
    for (std::size_t axis = 0; axis < 3; ++axis) { // cubes reach one voxel farther than the ball
        const Row low = Row{} + std::max(cell.center[axis] - cell.radius - 1, 0.0f);
        const Row high =
            Row{} + std::min(cell.center[axis] + cell.radius + 1, float(kBlockDim - 1));
        corner[axis] = upper[axis] ? high : low;
    }
    const Row &x = corner[0], &y = corner[1], &z = corner[2];
    const Row gx = k[1] + 2 * k[4] * x + k[7] * y + k[9] * z,
              gy = k[2] + 2 * k[5] * y + k[8] * z + k[7] * x,
              gz = k[3] + 2 * k[6] * z + k[9] * x + k[8] * y;
    const Row slope = larger(rowRoot(gx * gx + gy * gy + gz * gz), Row{} + float(kGradientFloor));
    const Row toCorner = kCubeMiddle * (larger(gx, -gx) + larger(gy, -gy) + larger(gz, -gz));
    return most(slope * (limit + kRoundingMargin) + toCorner);
}

/// Cubes in which one piece is beyond the limit outside, and inside.
struct BeyondCubes {
    Flags outside, inside;
    [[gnu::always_inline]] BeyondCubes(const Piece& k, const Cell& cell, float limit)
    {
        const float least = valueBeyond(k, cell, limit);
        const Row z = kRowZ + kCubeMiddle;
        Row constant[2], linear[2]; // in x
        for (int half = 0; half < 2; ++half) {
            const Row y = kRowY + (kCubeMiddle + kHalfBlock * float(half));
            constant[half] = k[0] + y * (k[2] + k[5] * y + k[8] * z) + z * (k[3] + k[6] * z);
            linear[half] = k[1] + k[7] * y + k[9] * z;
        }
        for (int row = 0; row < kRows; ++row) {
            const int layer = row / 2;
            const float x = float(kCubeDim * layer) + kCubeMiddle;
            const Row value = constant[row % 2] + x * (linear[row % 2] + k[4] * x);
            outside.set(row, value > least);
            inside.set(row, value < -least);
        }
    }
};

// --- Sums

struct SmoothWeight {
    float scale;
    explicit SmoothWeight(float radius) : scale(1.5f / radius) {}
    [[gnu::always_inline]] Row operator()(const Row& distance2) const
    {
        return bsplineWeight(Row(rowRoot(distance2) * scale));
    }
};

struct SingularWeight {
    /// Least squared distance to a point, voxels^2: the other cells' weights are 1e-8 of this
    /// one's. [derived: below float's rounding]
    static constexpr float kMinDistance2 = 1e-8f;
    float inverseRadius;
    explicit SingularWeight(float radius) : inverseRadius(1 / radius) {}
    [[gnu::always_inline]] Row operator()(const Row& distance2) const
    {
        const Row least = Row{} + kMinDistance2;
        return singularWeight(Row(1 / rowRoot(larger(distance2, least))), inverseRadius);
    }
};

/// Terms of one piece in a column of cubes that do not depend on z.
struct ColumnOfPiece {
    Row q0, q1, gx, gy;
    float q2, gxz, gyz;
    [[gnu::always_inline]] void set(const Piece& k, const Row& x, const Row& y)
    {
        q0 = k[0] + x * (k[1] + k[4] * x + k[7] * y) + y * (k[2] + k[5] * y);
        q1 = k[3] + k[8] * y + k[9] * x;
        q2 = k[6];
        gx = k[1] + 2 * k[4] * x + k[7] * y;
        gy = k[2] + 2 * k[5] * y + k[7] * x;
        gxz = k[9];
        gyz = k[8];
    }
};

/// One piece's value and gradient in a cube.
struct CubeSamples {
    Row q, gx, gy, gz;
    [[gnu::always_inline]] CubeSamples(const ColumnOfPiece& k, const Row& z)
        : q(k.q0 + z * (k.q1 + z * k.q2)), gx(k.gx + z * k.gxz), gy(k.gy + z * k.gyz),
          gz(k.q1 + 2 * k.q2 * z)
    {
    }
};

/// Value and gradient of the pieces combined, as by rulingPiece().
[[gnu::always_inline]] inline CubeSamples fold(const Cell& cell, const ColumnOfPiece* pieces,
                                               int count, const Row& z)
{
    CubeSamples s(pieces[count - 1], z);
    for (int piece = count - 2; piece >= 0; --piece) {
        const CubeSamples other(pieces[piece], z);
        const float sign = (cell.maxBits >> piece & 1u) ? 1.0f : -1.0f;
        const auto take = sign * other.q > sign * s.q;
        s.q = take ? other.q : s.q;
        s.gx = take ? other.gx : s.gx;
        s.gy = take ? other.gy : s.gy;
        s.gz = take ? other.gz : s.gz;
    }
    return s;
}

[[gnu::always_inline]] inline void addTo(std::array<float, kCubeVoxels>& sums, const Row& row)
{
    store(load(sums) + row, sums);
}

/// The first cube of each column along z that has cubes in the set.
constexpr CubeSet columnsOf(CubeSet cubes)
{
    const CubeSet pairs = cubes | cubes >> 1;
    return (pairs | pairs >> 2) & 0x1111111111111111u;
}

/// @param count  number of pieces: a constant 1 lets the compiler unroll.
template <typename Weight>
[[gnu::always_inline]] inline void addCell(const Cell& cell, const Piece* q, int count,
                                           CubeSet cubes, BlockSums& sums)
{
    const Row cornerX = {0, 0, 0, 0, 1, 1, 1, 1}, cornerY = {0, 0, 1, 1, 0, 0, 1, 1},
              cornerZ = {0, 1, 0, 1, 0, 1, 0, 1};
    const Weight weigh(cell.radius);
    // First all columns, then all cubes: the number of cubes in a column cannot be predicted.
    struct Column {
        Row distance2;
        ColumnOfPiece pieces[LocalFit::kMaxPieces];
    };
    Column columns[kCubesPerEdge * kCubesPerEdge];
    for (CubeSet left = columnsOf(cubes); left; left &= left - 1) {
        const int column = __builtin_ctzll(left) / kCubesPerEdge;
        const int layer = column / kCubesPerEdge;
        const Row x = cornerX + float(kCubeDim * layer),
                  y = cornerY + float(kCubeDim * (column % kCubesPerEdge));
        const Row dx = x - cell.center[0], dy = y - cell.center[1];
        columns[column].distance2 = dx * dx + dy * dy;
        for (int piece = 0; piece < count; ++piece)
            columns[column].pieces[piece].set(q[piece], x, y);
    }
    for (CubeSet left = cubes; left; left &= left - 1) {
        const int cube = __builtin_ctzll(left);
        const Column& column = columns[cube / kCubesPerEdge];
        const Row z = cornerZ + float(kCubeDim * (cube % kCubesPerEdge));
        const Row dz = z - cell.center[2];
        const CubeSamples s = fold(cell, column.pieces, count, z);
        const Row weight = weigh(column.distance2 + dz * dz);
        BlockSums::Cube& to = sums.cubes[std::size_t(cube)];
        addTo(to.weight, weight);
        addTo(to.value, weight * s.q);
        addTo(to.gx, weight * s.gx);
        addTo(to.gy, weight * s.gy);
        addTo(to.gz, weight * s.gz);
        if (cell.unsupported > 0) addTo(to.unsupported, cell.unsupported * weight);
    }
}

template <typename Weight>
[[gnu::always_inline]] inline void addAll(const KernelCells& all, CubeSet wanted, BlockSums& sums)
{
    for (CubeSet left = wanted; left; left &= left - 1)
        sums.cubes[std::size_t(__builtin_ctzll(left))] = {};
    for (const Cell& cell : all.cells) {
        const Piece* const pieces = &all.pieces[cell.firstPiece];
        if (cell.count == 1)
            addCell<Weight>(cell, pieces, 1, cell.cubes & wanted, sums);
        else
            addCell<Weight>(cell, pieces, cell.count, cell.cubes & wanted, sums);
    }
}

} // namespace

void KernelCells::clear()
{
    cells.clear();
    pieces.clear();
}

MPUVDB_WIDE_CLONES
CubeClasses classifyCubes(KernelCells& all, float limit)
{
    Flags notOutside, notInside;
    for (Cell& cell : all.cells) {
        const Flags reached = reachedCubes(cell);
        cell.cubes = reached.cubes();
        if (cell.unsupported > 0) { // the coarse field may count
            notOutside.add(reached, {});
            notInside.add(reached, {});
        } else {
            for (int piece = 0; piece < cell.count; ++piece) {
                const BeyondCubes beyond(all.pieces[cell.firstPiece + std::uint32_t(piece)], cell,
                                         limit);
                notOutside.add(reached, beyond.outside);
                notInside.add(reached, beyond.inside);
            }
        }
    }
    return {notOutside.cubes(), notInside.cubes()};
}

MPUVDB_WIDE_CLONES
void addCells(const KernelCells& cells, CubeSet wanted, bool singular, BlockSums& sums)
{
    if (singular)
        addAll<SingularWeight>(cells, wanted, sums);
    else
        addAll<SmoothWeight>(cells, wanted, sums);
}

MPUVDB_WIDE_CLONES
void normalize(const BlockSums& sums, CubeSet wanted, float limit, BlockValues& values)
{
    const Row far = Row{} + limit;
    for (CubeSet left = wanted; left; left &= left - 1) {
        const int cube = __builtin_ctzll(left);
        const BlockSums::Cube& s = sums.cubes[std::size_t(cube)];
        const Row weight = load(s.weight), gx = load(s.gx), gy = load(s.gy), gz = load(s.gz);
        const Row slope = rowRoot(gx * gx + gy * gy + gz * gz);
        // value / weight over max(|g| / weight, floor)
        const Row v = load(s.value) / larger(slope, float(kGradientFloor) * weight);
        const Row clamped = smaller(larger(v, -far), far);
        std::array<float, kCubeVoxels> distance;
        store(weight > 0 ? clamped : far, distance);
        for (int pair = 0; pair < kCubeVoxels; pair += kCubeDim)
            std::memcpy(&values[std::size_t(voxelOf(cube, pair))], &distance[std::size_t(pair)],
                        kCubeDim * sizeof(float));
    }
}

} // namespace mpuvdb
