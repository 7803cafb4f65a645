#include "mpu_block_sampler.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Neighbouring blocks share the upper part of their descents: regions of 4x4x4 blocks.
constexpr int kRegionShift = 2;

/// Whether a ball (in voxels about the block's first) holds a voxel of the block: where points are
/// closer than voxels most do not.
bool reachesVoxel(const Vec3d& centre, double radius)
{
    const Vec3d nearest =
        centre.array().round().max(0.0).min(double(kBlockDim - 1)).matrix(); // of the block
    return (centre - nearest).squaredNorm() < radius * radius;
}

} // namespace

MpuBlockSampler::MpuBlockSampler(const Octree& tree, const CoarseSign* coarse, const Vec3d& origin,
                                 double voxelSize, double band)
    : mTree(tree), mCoarse(coarse), mOrigin(origin), mVoxelSize(voxelSize),
      mLimit(float(band / voxelSize)),
      mFarthest(coarse ? std::max(2 * mLimit, float(coarse->farthest() / voxelSize)) : mLimit),
      mAddCell(tree.interpolates() ? addSingularCell : addCell)
{
}

template <typename Visit>
void MpuBlockSampler::descend(const NodeAt& at, const Box3d& box, const Visit& visit) const
{
    const double radius = mTree.reach(at.cell.level);
    if (!(box.squaredExteriorDistance(mTree.root.centre(at.cell)) < radius * radius)) return;
    const auto along = [&](int axis, double x) {
        const double beyond = std::max({box.min()[axis] - x, x - box.max()[axis], 0.0});
        return beyond * beyond;
    };
    mTree.descend(along, visit, at.node, at.cell);
}

void MpuBlockSampler::gatherRegion(const Vec3i& region)
{
    if (mHasRegion && region == mRegion) return;
    mRegion = region;
    mHasRegion = true;
    mRegionNodes.clear();
    const int dim = kBlockDim << kRegionShift;
    const Vec3d corner = mOrigin + mVoxelSize * double(dim) * region.cast<double>();
    const Box3d box(corner, corner + Vec3d::Constant(mVoxelSize * (dim - 1)));
    const double stopSize = mVoxelSize * dim / 4;
    descend({0, {}}, box, [&](std::uint32_t node, const OctreeCell& cell) {
        const bool goesOn = !mTree.nodes[node].isLeaf() && mTree.root.size(cell.level) > stopSize;
        if (!goesOn) mRegionNodes.push_back({node, cell});
        return goesOn;
    });
}

void MpuBlockSampler::evaluate(const Vec3i& block, BlockValues& values)
{
    gatherRegion({block[0] >> kRegionShift, block[1] >> kRegionShift, block[2] >> kRegionShift});
    mSums.clear();
    mSupported = true;
    const Vec3d corner = mOrigin + mVoxelSize * double(kBlockDim) * block.cast<double>();
    const Box3d box(corner, corner + Vec3d::Constant(mVoxelSize * (kBlockDim - 1)));
    for (const NodeAt& at : mRegionNodes)
        descend(at, box, [&](std::uint32_t node, const OctreeCell& cell) {
            if (!mTree.nodes[node].isLeaf()) return true;
            addLeaf({node, cell}, corner);
            return false;
        });
    // Blended with the coarse field a value may be beyond the band and still count.
    normalise(mSums, mFarthest, values);
    const bool reached = *std::min_element(mSums.weight.begin(), mSums.weight.end()) > 0;
    if (mCoarse && !(mSupported && reached)) blendCoarse(corner, values);
    for (float& v : values) v = std::clamp(v, -mLimit, mLimit) * float(mVoxelSize);
}

void MpuBlockSampler::blendCoarse(const Vec3d& blockOrigin, BlockValues& values) const
{
    for (int i = 0; i < kBlockVoxels; ++i) {
        const auto n = std::size_t(i);
        const float weight = mSums.weight[n];
        const float support = weight > 0 ? 1 - mSums.unsupported[n] / weight : 0.0f;
        if (support >= 1) continue;
        const Vec3d p = blockOrigin + mVoxelSize * Vec3d(i >> 6, i >> 3 & 7, i & 7);
        const float coarse = float(mCoarse->evaluate(p).value / mVoxelSize);
        values[n] = support * values[n] + (1 - support) * coarse;
    }
}

void MpuBlockSampler::addLeaf(const NodeAt& leaf, const Vec3d& blockOrigin)
{
    const OctreeNode& node = mTree.nodes[leaf.node];
    const StoredFit& stored = mTree.fits[node.index];
    const double h = mVoxelSize;
    const Vec3d centre = (mTree.ballCentre(leaf.cell, stored) - blockOrigin) / h;
    const double radius = mTree.supportRadius(leaf.cell.level) / h;
    if (mTree.interpolates() && !reachesVoxel(centre, radius)) return;
    const LocalFit fit = mTree.fitAbout(stored, blockOrigin);
    KernelCell cell;
    for (int k = 0; k < 3; ++k) cell.centre[k] = float(centre[k]);
    cell.radius = float(radius);
    cell.count = fit.count;
    cell.maxBits = fit.maxBits;
    cell.unsupported = 1 - node.support;
    mSupported &= node.support >= 1;
    for (int p = 0; p < fit.count; ++p) {
        const Quadric& q = fit.pieces[std::size_t(p)];
        const auto& A = q.A;
        const double k[10] = {q.c / h,         q.b[0],         q.b[1],      q.b[2],
                              A(0, 0) * h,     A(1, 1) * h,    A(2, 2) * h, 2 * A(0, 1) * h,
                              2 * A(1, 2) * h, 2 * A(2, 0) * h};
        for (int n = 0; n < 10; ++n) cell.q[p][n] = float(k[n]);
    }
    mAddCell(cell, mSums);
}

} // namespace mpuvdb
