#include "block_kernel.h"

#include "quadric.h"

#include <mpuvdb/clones.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr int kRow = kBlockDim;

/// Below this blended gradients cancel between sheets and value / |gradient| means nothing.
constexpr float kGradientFloor = 0.8f;

struct SmoothWeight {
    float scale;
    explicit SmoothWeight(float radius) : scale(1.5f / radius) {}
    float operator()(float distance2) const { return bsplineWeight(std::sqrt(distance2) * scale); }
};

struct SingularWeight {
    /// A voxel on a point: all other cells together weigh a hundred-millionth of this one.
    static constexpr float kLeast2 = 1e-8f;
    float inverseRadius;
    explicit SingularWeight(float radius) : inverseRadius(1 / radius) {}
    float operator()(float distance2) const
    {
        return singularWeight(std::sqrt(std::max(distance2, kLeast2)), inverseRadius);
    }
};

template <typename Weight>
[[gnu::always_inline]] inline void addWeighted(const KernelCell& cell, BlockSums& sums)
{
    const Weight weigh(cell.radius);
    const float radius2 = cell.radius * cell.radius;
    for (int x = 0; x < kBlockDim; ++x) {
        const float fx = float(x), dx = fx - cell.centre[0];
        if (dx * dx >= radius2) continue;
        for (int y = 0; y < kBlockDim; ++y) {
            const float fy = float(y), dy = fy - cell.centre[1];
            const float row2 = dx * dx + dy * dy;
            if (row2 >= radius2) continue;

            float q[kRow], gx[kRow], gy[kRow], gz[kRow], weights[kRow];
            for (int piece = cell.count - 1; piece >= 0; --piece) {
                const float* k = cell.q[piece];
                const float q0 =
                    k[0] + fx * (k[1] + k[4] * fx + k[7] * fy) + fy * (k[2] + k[5] * fy);
                const float q1 = k[3] + k[8] * fy + k[9] * fx, q2 = k[6];
                const float gx0 = k[1] + 2 * k[4] * fx + k[7] * fy;
                const float gy0 = k[2] + 2 * k[5] * fy + k[7] * fx;
                if (piece == cell.count - 1) {
                    for (int z = 0; z < kRow; ++z) {
                        const float fz = float(z);
                        q[z] = q0 + fz * (q1 + fz * q2);
                        gx[z] = gx0 + fz * k[9];
                        gy[z] = gy0 + fz * k[8];
                        gz[z] = q1 + 2 * q2 * fz;
                    }
                    continue;
                }
                const float sign = (cell.maxBits >> piece & 1u) ? 1.0f : -1.0f;
                for (int z = 0; z < kRow; ++z) {
                    const float fz = float(z);
                    const float other = q0 + fz * (q1 + fz * q2);
                    const bool take = sign * other > sign * q[z];
                    q[z] = take ? other : q[z];
                    gx[z] = take ? gx0 + fz * k[9] : gx[z];
                    gy[z] = take ? gy0 + fz * k[8] : gy[z];
                    gz[z] = take ? q1 + 2 * q2 * fz : gz[z];
                }
            }

            const int row = (x * kBlockDim + y) * kBlockDim;
            float *const w = &sums.weight[size_t(row)], *const v = &sums.value[size_t(row)];
            float *const sx = &sums.gx[size_t(row)], *const sy = &sums.gy[size_t(row)],
                         *const sz = &sums.gz[size_t(row)];
            for (int z = 0; z < kRow; ++z) {
                const float dz = float(z) - cell.centre[2];
                const float weight = weigh(row2 + dz * dz);
                w[z] += weight;
                v[z] += weight * q[z];
                sx[z] += weight * gx[z];
                sy[z] += weight * gy[z];
                sz[z] += weight * gz[z];
                weights[z] = weight;
            }
            if (cell.unsupported > 0) {
                float* const u = &sums.unsupported[size_t(row)];
                for (int z = 0; z < kRow; ++z) u[z] += cell.unsupported * weights[z];
            }
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
