#include "row_flags.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "grid/leaf_halo.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Halo = LeafHalo;
using Lanes = float __attribute__((vector_size(4 * kBlockDim)));
using Flags = int __attribute__((vector_size(4 * kBlockDim)));

/// Share of the smallest slope that is not examined, per voxel of the value. [derived: at a corner
/// 0.318 d of 0.55 below sqrt(3) voxels; rounded up]
constexpr float kSharePerVoxel = 0.6f;
constexpr float kMaxSlope = 1.3f; ///< largest slope not examined [tuned: sample_field_test]
constexpr float kMaxStep = 1.3f;  ///< largest step not examined, voxels [tuned: sample_field_test]
/// Slopes on both sides from which values are scaled down, and fully. [tuned: noise_bench]
constexpr float kScaleFrom = 1.05f, kScaleFully = 1.15f;

} // namespace

MPUVDB_CLONES
unsigned missingInRow(const float* row, float halfWidth)
{
    Lanes nearest = Lanes{} + halfWidth;
#pragma GCC unroll 27
    for (int n = 0; n < 27; ++n) {
        const int x = n / 9 - 1, y = n / 3 % 3 - 1, z = n % 3 - 1;
        const Lanes u = magnitude(lanesAt<Lanes>(row + (x * Halo::kDim + y) * Halo::kDim + z)) +
                        kNeighborDistance[std::abs(x) + std::abs(y) + std::abs(z)];
        nearest = u < nearest ? u : nearest;
    }
    return unsigned(bitsOf(nearest < halfWidth - kMissingDepth));
}

MPUVDB_CLONES
RowFlags examineRow(const float* row, float halfWidth, float minSlope)
{
    constexpr const auto& kStride = Halo::kStride;
    const Lanes v = lanesAt<Lanes>(row), a = magnitude(v);
    Lanes slope2{}, largestStep{}, gentle2{};
    Flags crosses{};
    for (const int stride : kStride) {
        const Lanes u0 = lanesAt<Lanes>(row - stride), u1 = lanesAt<Lanes>(row + stride);
        crosses |= ((u0 < 0) ^ (v < 0)) | ((u1 < 0) ^ (v < 0));
        const Lanes s0 = magnitude(u0 - v), s1 = magnitude(u1 - v);
        const Lanes gentler = s0 < s1 ? s0 : s1; // the steeper may be across an edge
        gentle2 += gentler * gentler;
        largestStep = s0 > largestStep ? s0 : largestStep;
        largestStep = s1 > largestStep ? s1 : largestStep;
        const Lanes a0 = magnitude(u0), a1 = magnitude(u1);
        const Lanes rise = a - (a0 < a1 ? a0 : a1);
        slope2 += rise > 0 ? rise * rise : Lanes{};
    }
    const Lanes perVoxel = kSharePerVoxel * minSlope * a;
    const Lanes least = perVoxel < minSlope ? perVoxel : Lanes{} + minSlope;
    const Flags isSteep = slope2 > kMaxSlope * kMaxSlope;
    Lanes highestCorner{};
    for (const int dx : {-kStride[0], kStride[0]}) {
        for (const int dy : {-kStride[1], kStride[1]}) {
            for (const int dz : {-1, 1}) {
                const Lanes u = magnitude(lanesAt<Lanes>(row + dx + dy + dz));
                highestCorner = u > highestCorner ? u : highestCorner;
            }
        }
    }
    const float deep = halfWidth - kMissingDepth - kNeighborDistance[3],
                outside = halfWidth * (1 - 1e-5f);
    RowFlags flags;
    flags.suspect = unsigned(bitsOf((largestStep > kMaxStep) | (~crosses & isSteep)));
    flags.flat = unsigned(bitsOf(~crosses & (slope2 < least * least)));
    flags.cornerMissing = unsigned(bitsOf((a < deep) & (highestCorner >= outside)));
    flags.steep = unsigned(bitsOf(gentle2 > kScaleFrom * kScaleFrom));
    for (int z = 0; flags.steep != 0 && z < kBlockDim; ++z)
        flags.slope[std::size_t(z)] = std::sqrt(gentle2[z]);
    return flags;
}

float scaledDown(float value, float slope)
{
    const float t = std::clamp((slope - kScaleFrom) / (kScaleFully - kScaleFrom), 0.0f, 1.0f);
    return std::abs(value) / (1 + t * (slope - 1));
}

} // namespace mpuvdb
