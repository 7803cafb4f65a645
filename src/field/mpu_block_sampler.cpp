#include "mpu_block_sampler.h"

#include <algorithm>

namespace mpuvdb {
namespace {

/// Neighbouring blocks share the upper part of their descents: regions of 4x4x4 blocks.
constexpr int kRegionShift = 2;

} // namespace

MpuBlockSampler::MpuBlockSampler(const Octree& tree, const Vec3d& origin, double voxelSize,
                                 double band)
    : mTree(tree), mOrigin(origin), mVoxelSize(voxelSize), mLimit(float(band / voxelSize))
{
}

template <typename Leaf>
void MpuBlockSampler::descend(const NodeAt& at, const Box3d& box, double stopSize,
                              std::vector<NodeAt>* inner, Leaf leaf) const
{
    const double radius = mTree.supportRadius(at.cell.level);
    if (!(box.squaredExteriorDistance(mTree.root.centre(at.cell)) < radius * radius)) return;
    const OctreeNode& node = mTree.nodes[at.node];
    if (node.firstChild == OctreeNode::kNone) {
        leaf(at);
    } else if (inner && mTree.root.size(at.cell.level) <= stopSize) {
        inner->push_back(at);
    } else {
        for (int octant = 0; octant < 8; ++octant)
            descend({node.firstChild + std::uint32_t(octant), at.cell.child(octant)}, box, stopSize,
                    inner, leaf);
    }
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
    descend({0, {}}, box, mVoxelSize * dim / 4, &mRegionNodes,
            [&](const NodeAt& leaf) { mRegionNodes.push_back(leaf); });
}

void MpuBlockSampler::evaluate(const Vec3i& block, BlockValues& values)
{
    gatherRegion({block[0] >> kRegionShift, block[1] >> kRegionShift, block[2] >> kRegionShift});
    mSums.clear();
    const Vec3d corner = mOrigin + mVoxelSize * double(kBlockDim) * block.cast<double>();
    const Box3d box(corner, corner + Vec3d::Constant(mVoxelSize * (kBlockDim - 1)));
    for (const NodeAt& at : mRegionNodes)
        descend(at, box, 0, nullptr, [&](const NodeAt& leaf) { addLeaf(leaf, corner); });
    normalise(mSums, mLimit, values);
    for (float& v : values) v *= float(mVoxelSize);
}

void MpuBlockSampler::addLeaf(const NodeAt& leaf, const Vec3d& blockOrigin)
{
    const OctreeNode& node = mTree.nodes[leaf.node];
    if (node.fit == OctreeNode::kNone) return;
    const StoredFit& stored = mTree.fits[node.fit];
    const LocalFit fit = mTree.fitAbout(stored, blockOrigin);
    const double h = mVoxelSize;
    const Vec3d centre = (mTree.root.centre(leaf.cell) - blockOrigin) / h;
    KernelCell cell;
    for (int k = 0; k < 3; ++k) cell.centre[k] = float(centre[k]);
    cell.radius = float(mTree.supportRadius(leaf.cell.level) / h);
    cell.count = fit.count;
    cell.maxBits = fit.maxBits;
    for (int p = 0; p < fit.count; ++p) {
        const Quadric& q = fit.pieces[std::size_t(p)];
        const auto& A = q.A;
        const double k[10] = {q.c / h,     q.b[0],      q.b[1],
                              q.b[2],      A(0, 0) * h, A(1, 1) * h,
                              A(2, 2) * h, 2 * A(0, 1) * h, 2 * A(1, 2) * h,
                              2 * A(2, 0) * h};
        for (int n = 0; n < 10; ++n) cell.q[p][n] = float(k[n]);
    }
    addCell(cell, mSums);
}

} // namespace mpuvdb
