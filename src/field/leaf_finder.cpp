#include "leaf_finder.h"

#include <mpuvdb/clones.h>
#include <mpuvdb/lanes.h>

#include <cstring>

namespace mpuvdb
{
namespace
{

/// Regions of 4x4x4 blocks.
constexpr int kRegionShift = 2;
constexpr int kRegionVoxels = kBlockDim << kRegionShift;

constexpr std::size_t kLanes = 8;
using Lanes = float __attribute__((vector_size(4 * kLanes)));

[[gnu::always_inline]] inline Lanes load(const float* from)
{
    Lanes lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

/// Squared distance along an axis from @a x to [@a first, @a first + @a extent].
[[gnu::always_inline]] inline Lanes squaredGap(const Lanes& x, float first, float extent)
{
    const Lanes below = first - x, above = x - (first + extent);
    const Lanes gap = below > above ? below : above;
    const Lanes beyond = gap > 0 ? gap : Lanes{};
    return beyond * beyond;
}

/// Of places and their reaches, those that reach into the block whose first voxel is @a first.
MPUVDB_CLONES
std::size_t reaching(const float* x, const float* y, const float* z, const float* reach2,
                     std::size_t count, const std::array<float, 3>& first, std::uint32_t* found)
{
    constexpr float kExtent = kBlockDim - 1;
    std::size_t n = 0;
    for (std::size_t group = 0; group < count; group += kLanes) {
        const Lanes distance2 = squaredGap(load(x + group), first[0], kExtent) +
                                squaredGap(load(y + group), first[1], kExtent) +
                                squaredGap(load(z + group), first[2], kExtent);
        const std::uint64_t reaches = bitsOf(distance2 < load(reach2 + group));
        for (std::size_t lane = 0; lane < kLanes; ++lane) { // no branch: none could be foreseen
            found[n] = std::uint32_t(group + lane);
            n += reaches >> lane & 1u;
        }
    }
    return n;
}

} // namespace

LeafFinder::LeafFinder(const Octree& tree, const Vec3d& origin, double voxelSize)
    : mTree(tree), mOrigin(origin), mVoxelSize(voxelSize)
{
    // Centres are sums of halved sizes in floats: none is off by more than this.
    const double rounding = 1e-6 * (tree.root.side / voxelSize + kRegionVoxels);
    for (std::size_t level = 0; level < mQuarter.size(); ++level) {
        mQuarter[level] = float(tree.root.size(int(level)) / voxelSize / 4);
        const double reach = tree.reach(int(level)) / voxelSize * (1 + 1e-6) + rounding;
        mReach2[level] = float(reach * reach);
    }
}

void LeafFinder::makeRoom(std::size_t leaves)
{
    if (mCount + leaves <= mLeaves.size()) return;
    const std::size_t size = 2 * (mCount + leaves);
    mLeaves.resize(size);
    for (auto* values : {&mX, &mY, &mZ, &mLeafReach2}) values->resize(size);
    mInBlock.resize(size);
}

[[gnu::always_inline]] inline void LeafFinder::addLeaf(OctreeNode leaf, const OctreeCell& cell,
                                                       float x, float y, float z)
{
    makeRoom(1 + kLanes); // and what pads
    mLeaves[mCount] = {leaf, cell};
    mX[mCount] = x;
    mY[mCount] = y;
    mZ[mCount] = z;
    mLeafReach2[mCount] = mReach2[std::size_t(cell.level)];
    ++mCount;
}

MPUVDB_CLONES
void LeafFinder::addBelow(OctreeNode inner, const OctreeCell& cell, float x, float y, float z)
{
    const Lanes sideX = {-1, 1, -1, 1, -1, 1, -1, 1}, sideY = {-1, -1, 1, 1, -1, -1, 1, 1},
                sideZ = {-1, -1, -1, -1, 1, 1, 1, 1};
    constexpr float kExtent = kRegionVoxels - 1;
    const auto level = std::size_t(cell.level);
    const float quarter = mQuarter[level];
    const Lanes allX = x + quarter * sideX, allY = y + quarter * sideY, allZ = z + quarter * sideZ;
    const Lanes distance2 =
        squaredGap(allX, 0, kExtent) + squaredGap(allY, 0, kExtent) + squaredGap(allZ, 0, kExtent);
    for (std::uint64_t left = bitsOf(distance2 < mReach2[level + 1]); left; left &= left - 1) {
        const int octant = __builtin_ctzll(left);
        const OctreeNode child = mTree.nodes[inner.index + std::uint32_t(octant)];
        // As above; what has just been written as a group is slow to read as one number.
        const float childX = octant & 1 ? x + quarter : x - quarter,
                    childY = octant & 2 ? y + quarter : y - quarter,
                    childZ = octant & 4 ? z + quarter : z - quarter;
        if (child.isLeaf())
            addLeaf(child, cell.child(octant), childX, childY, childZ);
        else
            addBelow(child, cell.child(octant), childX, childY, childZ);
    }
}

void LeafFinder::enterRegion(const Vec3i& region)
{
    if (mHasRegion && region == mRegion) return;
    mRegion = region;
    mHasRegion = true;
    mCount = 0;
    const Vec3d corner = mOrigin + mVoxelSize * kRegionVoxels * region.cast<double>();
    const Vec3f root = ((mTree.root.centre({}) - corner) / mVoxelSize).cast<float>();
    makeRoom(kLanes);
    const OctreeNode top = mTree.nodes[0];
    if (top.isLeaf())
        addLeaf(top, {}, root[0], root[1], root[2]);
    else
        addBelow(top, {}, root[0], root[1], root[2]);
    for (std::size_t n = mCount; n % kLanes; ++n) mLeafReach2[n] = 0; // reaches nothing
}

const std::vector<LeafAt>& LeafFinder::find(const Vec3i& block)
{
    constexpr int kInRegion = (1 << kRegionShift) - 1;
    enterRegion({block[0] >> kRegionShift, block[1] >> kRegionShift, block[2] >> kRegionShift});
    std::array<float, 3> first;
    for (int axis = 0; axis < 3; ++axis)
        first[std::size_t(axis)] = float(kBlockDim * (block[axis] & kInRegion));
    const std::size_t count = reaching(mX.data(), mY.data(), mZ.data(), mLeafReach2.data(), mCount,
                                       first, mInBlock.data());
    mFound.resize(count);
    for (std::size_t n = 0; n < count; ++n) mFound[n] = mLeaves[mInBlock[n]];
    return mFound;
}

} // namespace mpuvdb
