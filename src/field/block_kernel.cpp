#include "block_kernel.h"

#include "quadric.h"

#include <mpuvdb/clones.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace mpuvdb
{
namespace
{

/// The voxels of a block along z, all at once; written so that every instruction set gives the same
/// bits.
using Row = float __attribute__((vector_size(sizeof(float) * kBlockDim)));

[[gnu::always_inline]] inline Row squareRoot(const Row& row)
{
    float a[kBlockDim];
    std::memcpy(a, &row, sizeof row);
    for (float& v : a) v = std::sqrt(v);
    Row root;
    std::memcpy(&root, a, sizeof root);
    return root;
}

[[gnu::always_inline]] inline void addTo(float* sums, const Row& row)
{
    Row sum;
    std::memcpy(&sum, sums, sizeof sum);
    sum += row;
    std::memcpy(sums, &sum, sizeof sum);
}

/// Below this blended gradients cancel between sheets and value / |gradient| means nothing.
constexpr float kGradientFloor = 0.8f;

struct SmoothWeight {
    float scale;
    explicit SmoothWeight(float radius) : scale(1.5f / radius) {}
    [[gnu::always_inline]] Row operator()(const Row& distance2) const
    {
        return bsplineWeight(Row(squareRoot(distance2) * scale));
    }
};

struct SingularWeight {
    /// A voxel on a point: all other cells together weigh a hundred-millionth of this one.
    static constexpr float kLeast2 = 1e-8f;
    float inverseRadius;
    explicit SingularWeight(float radius) : inverseRadius(1 / radius) {}
    [[gnu::always_inline]] Row operator()(const Row& distance2) const
    {
        const Row least = Row{} + kLeast2;
        return singularWeight(Row(1 / squareRoot(distance2 > least ? distance2 : least)),
                              inverseRadius);
    }
};

/// One piece's value and gradient in the row at (x, y).
struct RowSamples {
    Row q, gx, gy, gz;
    [[gnu::always_inline]] RowSamples(const float* k, float x, float y, const Row& z)
    {
        const float q0 = k[0] + x * (k[1] + k[4] * x + k[7] * y) + y * (k[2] + k[5] * y);
        const float q1 = k[3] + k[8] * y + k[9] * x, q2 = k[6];
        q = q0 + z * (q1 + z * q2);
        gx = (k[1] + 2 * k[4] * x + k[7] * y) + z * k[9];
        gy = (k[2] + 2 * k[5] * y + k[7] * x) + z * k[8];
        gz = q1 + 2 * q2 * z;
    }
};

/// Pieces folded as LocalFit says.
[[gnu::always_inline]] inline RowSamples sampleRow(const KernelCell& cell, float x, float y,
                                                   const Row& z)
{
    RowSamples s(cell.q[cell.count - 1], x, y, z);
    for (int piece = cell.count - 2; piece >= 0; --piece) {
        const RowSamples other(cell.q[piece], x, y, z);
        const float sign = (cell.maxBits >> piece & 1u) ? 1.0f : -1.0f;
        const auto take = sign * other.q > sign * s.q;
        s.q = take ? other.q : s.q;
        s.gx = take ? other.gx : s.gx;
        s.gy = take ? other.gy : s.gy;
        s.gz = take ? other.gz : s.gz;
    }
    return s;
}

template <typename Weight>
[[gnu::always_inline]] inline void addWeighted(const KernelCell& cell, BlockSums& sums)
{
    const Weight weigh(cell.radius);
    const float radius2 = cell.radius * cell.radius;
    const Row z = {0, 1, 2, 3, 4, 5, 6, 7};
    const Row dz = z - cell.centre[2];
    for (int x = 0; x < kBlockDim; ++x) {
        const float fx = float(x), dx = fx - cell.centre[0];
        if (dx * dx >= radius2) continue;
        for (int y = 0; y < kBlockDim; ++y) {
            const float fy = float(y), dy = fy - cell.centre[1];
            const float row2 = dx * dx + dy * dy;
            if (row2 >= radius2) continue;
            const RowSamples s = sampleRow(cell, fx, fy, z);
            const Row weight = weigh(row2 + dz * dz);
            const std::size_t row = (x * kBlockDim + y) * kBlockDim;
            addTo(&sums.weight[row], weight);
            addTo(&sums.value[row], weight * s.q);
            addTo(&sums.gx[row], weight * s.gx);
            addTo(&sums.gy[row], weight * s.gy);
            addTo(&sums.gz[row], weight * s.gz);
            if (cell.unsupported > 0) addTo(&sums.unsupported[row], cell.unsupported * weight);
        }
    }
}

} // namespace

void BlockSums::clear()
{
    for (auto* a : {&weight, &value, &gx, &gy, &gz, &unsupported}) a->fill(0);
}

MPUVDB_WIDE_CLONES
void addCell(const KernelCell& cell, BlockSums& sums)
{
    addWeighted<SmoothWeight>(cell, sums);
}

MPUVDB_WIDE_CLONES
void addSingularCell(const KernelCell& cell, BlockSums& sums)
{
    addWeighted<SingularWeight>(cell, sums);
}

MPUVDB_WIDE_CLONES
void normalise(const BlockSums& sums, float limit, BlockValues& values)
{
    for (size_t i = 0; i < size_t(kBlockVoxels); ++i) {
        const float w = sums.weight[i];
        const float g =
            std::sqrt(sums.gx[i] * sums.gx[i] + sums.gy[i] * sums.gy[i] + sums.gz[i] * sums.gz[i]);
        // value / w over max(|g| / w, floor)
        const float v = sums.value[i] / std::max(g, kGradientFloor * w);
        values[i] = w > 0 ? std::min(std::max(v, -limit), limit) : limit;
    }
}

} // namespace mpuvdb
