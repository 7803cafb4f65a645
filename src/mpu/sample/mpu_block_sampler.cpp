#include "mpu_block_sampler.h"

#include <algorithm>
#include <limits>

namespace mpuvdb
{
namespace
{

/// A quadric about a place @a shift from its origin, in voxels of size @a h.
KernelCells::Piece pieceOf(const QuadricCoefficients& k, const Vec3d& shift, double h)
{
    const double x = shift[0], y = shift[1], z = shift[2];
    const double halfXy = 0.5 * k[7], halfYz = 0.5 * k[8], halfZx = 0.5 * k[9];
    const double ax = k[4] * x + halfXy * y + halfZx * z, ay = halfXy * x + k[5] * y + halfYz * z,
                 az = halfZx * x + halfYz * y + k[6] * z;
    const double value = x * ax + y * ay + z * az + (k[1] * x + k[2] * y + k[3] * z) + k[0];
    return {float(value / h), float(k[1] + 2 * ax), float(k[2] + 2 * ay), float(k[3] + 2 * az),
            float(k[4] * h),  float(k[5] * h),      float(k[6] * h),      float(k[7] * h),
            float(k[8] * h),  float(k[9] * h)};
}

/// Whether a ball (in voxels about the block's first) holds a voxel of the block: where points are
/// denser than voxels, most do not.
bool reachesVoxel(const Vec3d& center, double radius)
{
    const Vec3d nearest =
        center.array().round().max(0.0).min(double(kBlockDim - 1)).matrix(); // of the block
    return (center - nearest).squaredNorm() < radius * radius;
}

} // namespace

MpuBlockSampler::MpuBlockSampler(const Octree& tree, const CoarseSign* coarse, const Vec3d& origin,
                                 double voxelSize, double band)
    : mTree(tree), mCoarse(coarse), mOrigin(origin), mVoxelSize(voxelSize),
      mLimit(float(band / voxelSize)),
      mMaxCoarse(coarse ? float(coarse->maxDistance() / voxelSize) : 0),
      mMaxBlended(coarse ? std::max(2 * mLimit, mMaxCoarse) : mLimit),
      mLeaves(tree, origin, voxelSize)
{
}

void MpuBlockSampler::evaluate(const Vec3i& block, BlockValues& values)
{
    mCells.clear();
    const Vec3d corner = mOrigin + mVoxelSize * double(kBlockDim) * block.cast<double>();
    const Box3d box(corner, corner + Vec3d::Constant(mVoxelSize * (kBlockDim - 1)));
    // Fits are scattered in memory: prefetch those of all leaves.
    const std::vector<LeafAt>& leaves = mLeaves.find(block);
    for (const LeafAt& leaf : leaves) __builtin_prefetch(&mTree.fits[leaf.node.index]);
    for (const LeafAt& leaf : leaves)
        __builtin_prefetch(&mTree.quadrics[mTree.fits[leaf.node.index].firstQuadric]);
    for (const LeafAt& leaf : leaves) gatherCell(leaf, corner);
    const CubeSet wanted = cubesToSum(box, values);
    addCells(mCells, wanted, mTree.interpolates(), mSums);
    // Values beyond the band still count in the blend with the coarse field.
    normalize(mSums, wanted, mMaxBlended, values);
    if (mCoarse) {
        const bool isLimited = mCoarse->bounds().contains(box);
        blendCoarse(wanted, corner, isLimited ? mMaxCoarse : std::numeric_limits<float>::infinity(),
                    values);
    }
    for (float& v : values) v = std::clamp(v, -mLimit, mLimit) * float(mVoxelSize);
}

/// The cubes to sum; in others, which are beyond the limit, @a values are set.
CubeSet MpuBlockSampler::cubesToSum(const Box3d& box, BlockValues& values)
{
    const CubeClasses classes = classifyCubes(mCells, mLimit);
    // Outside of the root cube, and for interpolation, there are voxels that no ball holds.
    const bool isCovered = !mTree.interpolates() && mTree.root.box().contains(box);
    const CubeSet wanted = isCovered ? classes.notOutside & classes.notInside : kAllCubes;
    for (CubeSet left = ~wanted; left; left &= left - 1) {
        const int cube = __builtin_ctzll(left);
        const float value = classes.notOutside >> cube & 1u ? -mLimit : mLimit;
        for (int corner = 0; corner < kCubeVoxels; ++corner)
            values[std::size_t(voxelOf(cube, corner))] = value;
    }
    return wanted;
}

void MpuBlockSampler::blendCoarse(CubeSet cubes, const Vec3d& blockOrigin, float maxDistance,
                                  BlockValues& values) const
{
    constexpr int kGroup = 4;                ///< places at once [derived: those of evaluateFour()]
    constexpr float kRoundingMargin = 1e-3f; ///< of a value, voxels [derived: float's rounding]
    // Full support, or a value that stays beyond the limit in the blend.
    const auto isSettled = [&](float value, float support) {
        return support >= 1 ||
               support * std::abs(value) - (1 - support) * maxDistance > mLimit + kRoundingMargin;
    };
    for (CubeSet left = cubes; left; left &= left - 1) {
        const int cube = __builtin_ctzll(left);
        const BlockSums::Cube& sums = mSums.cubes[std::size_t(cube)];
        for (int first = 0; first < kCubeVoxels; first += kGroup) {
            std::array<float, kGroup> support;
            bool areSettled = true;
            for (std::size_t n = 0; n < kGroup; ++n) {
                const float weight = sums.weight[std::size_t(first) + n];
                support[n] =
                    weight > 0 ? 1 - sums.unsupported[std::size_t(first) + n] / weight : 0.0f;
                const float value = values[std::size_t(voxelOf(cube, first + int(n)))];
                areSettled &= isSettled(value, support[n]);
            }
            if (areSettled) continue;
            std::array<std::array<double, kGroup>, 3> places;
            std::array<double, kGroup> coarse, steps;
            for (int n = 0; n < kGroup; ++n) {
                const int i = voxelOf(cube, first + n);
                const Vec3d p = blockOrigin + mVoxelSize * Vec3d(i >> 6, i >> 3 & 7, i & 7);
                for (int k = 0; k < 3; ++k) places[std::size_t(k)][std::size_t(n)] = p[k];
            }
            mCoarse->evaluateFour(places, coarse, steps);
            for (int n = 0; n < kGroup; ++n) {
                const float s = support[std::size_t(n)];
                if (!(s < 1)) continue;
                float& value = values[std::size_t(voxelOf(cube, first + n))];
                const double most = CoarseSample::maxDistance(steps[std::size_t(n)]);
                const auto far = std::max(2 * mLimit, float(most / mVoxelSize));
                value = s * std::clamp(value, -far, far) +
                        (1 - s) * float(coarse[std::size_t(n)] / mVoxelSize);
            }
        }
    }
}

void MpuBlockSampler::gatherCell(const LeafAt& leaf, const Vec3d& blockOrigin)
{
    const StoredFit& stored = mTree.fits[leaf.node.index];
    const Vec3d center = (mTree.ballCenter(leaf.cell, stored) - blockOrigin) / mVoxelSize;
    const double radius = mTree.supportRadius(leaf.cell.level) / mVoxelSize;
    if (mTree.interpolates() && !reachesVoxel(center, radius)) return;
    mCells.cells.push_back({{float(center[0]), float(center[1]), float(center[2])},
                            float(radius),
                            1 - leaf.node.support,
                            std::uint32_t(mCells.pieces.size()),
                            stored.count,
                            stored.maxBits,
                            0});
    const Vec3d shift = blockOrigin - stored.origin.cast<double>();
    for (std::size_t p = 0; p < stored.count; ++p)
        mCells.pieces.push_back(
            pieceOf(mTree.quadrics[stored.firstQuadric + p], shift, mVoxelSize));
}

} // namespace mpuvdb
