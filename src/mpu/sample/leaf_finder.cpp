#include "leaf_finder.h"

#include "core/clones.h"
#include "core/lanes.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace mpuvdb
{
namespace
{

constexpr int kRegionShift = 2; ///< log2 of the blocks along a region's edge [free: time]
/// Voxels along a region's edge. [derived: from both]
constexpr int kRegionVoxels = kBlockDim << kRegionShift;

/// Edge of the cubes whose places share a search for leaves, in spacings of the places; and number
/// of cubes remembered along each axis. [free: time]
constexpr double kCubeSpacings = 4;
constexpr std::uint32_t kCubesAlong = 4;
constexpr std::uint32_t kNoCube = ~std::uint32_t(0); ///< no cube [derived: none has this index]

constexpr std::size_t kNodeLanes = 8; ///< lanes of a vector [derived: floats of 256 bits]
using NodeLanes = float __attribute__((vector_size(4 * kNodeLanes)));

[[gnu::always_inline]] inline NodeLanes load(const float* from)
{
    NodeLanes lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

/// Squared distance along an axis from @a x to [@a first, @a first + @a extent].
[[gnu::always_inline]] inline NodeLanes squaredGap(const NodeLanes& x, float first, float extent)
{
    const NodeLanes below = first - x, above = x - (first + extent);
    const NodeLanes gap = below > above ? below : above;
    const NodeLanes beyond = gap > 0 ? gap : NodeLanes{};
    return beyond * beyond;
}

/// Squared distance to a cube with its lowest corner @a first.
[[gnu::always_inline]] inline NodeLanes squaredGap(const NodeLanes& x, const NodeLanes& y,
                                                   const NodeLanes& z,
                                                   const std::array<float, 3>& first, float extent)
{
    return squaredGap(x, first[0], extent) + squaredGap(y, first[1], extent) +
           squaredGap(z, first[2], extent);
}

/// Ones for the first @a count lanes.
std::uint64_t firstBits(std::size_t count)
{
    return count < kNodeLanes ? (std::uint64_t(1) << count) - 1 : ~std::uint64_t(0);
}

/// Indices of the places that reach into the block whose first voxel is @a first.
MPUVDB_WIDE_CLONES
std::size_t reaching(const float* x, const float* y, const float* z, const float* reach2,
                     std::size_t count, const std::array<float, 3>& first, std::uint32_t* found)
{
    constexpr float kExtent = kBlockDim - 1; ///< of a block, voxels [derived: first to last]
    std::size_t n = 0;
    for (std::size_t group = 0; group < count; group += kNodeLanes) {
        const NodeLanes distance2 =
            squaredGap(load(x + group), load(y + group), load(z + group), first, kExtent);
        const std::uint64_t reaches = bitsOf(distance2 < load(reach2 + group));
        for (std::size_t lane = 0; lane < kNodeLanes;
             ++lane) { // no branch: it could not be predicted
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
    // A bound of the error of centers, which are sums of halved sizes in floats.
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
    makeRoom(1 + kNodeLanes); // with padding
    mLeaves[mCount] = {leaf, cell};
    mX[mCount] = x;
    mY[mCount] = y;
    mZ[mCount] = z;
    mLeafReach2[mCount] = mReach2[std::size_t(cell.level)];
    ++mCount;
}

MPUVDB_WIDE_CLONES
void LeafFinder::addBelow(OctreeNode inner, const OctreeCell& cell, float x, float y, float z)
{
    const NodeLanes sideX = {-1, 1, -1, 1, -1, 1, -1, 1}, sideY = {-1, -1, 1, 1, -1, -1, 1, 1},
                    sideZ = {-1, -1, -1, -1, 1, 1, 1, 1};
    constexpr float kExtent = kRegionVoxels - 1; ///< of a region, voxels [derived: first to last]
    const auto level = std::size_t(cell.level);
    const float quarter = mQuarter[level];
    const NodeLanes allX = x + quarter * sideX, allY = y + quarter * sideY,
                    allZ = z + quarter * sideZ;
    const NodeLanes distance2 = squaredGap(allX, allY, allZ, {0, 0, 0}, kExtent);
    for (std::uint64_t left = bitsOf(distance2 < mReach2[level + 1]); left; left &= left - 1) {
        const int octant = __builtin_ctzll(left);
        const OctreeNode child = mTree.nodes[inner.index + std::uint32_t(octant)];
        // Again, as single numbers of a vector just computed are slow to read.
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
    const Vec3f root = ((mTree.root.center({}) - corner) / mVoxelSize).cast<float>();
    makeRoom(kNodeLanes);
    const OctreeNode top = mTree.nodes[0];
    if (top.isLeaf())
        addLeaf(top, {}, root[0], root[1], root[2]);
    else
        addBelow(top, {}, root[0], root[1], root[2]);
    for (std::size_t n = mCount; n % kNodeLanes; ++n) mLeafReach2[n] = 0; // reaches nothing
}

const std::vector<LeafAt>& LeafFinder::find(const Vec3i& block)
{
    constexpr int kInRegion = (1 << kRegionShift) - 1; ///< mask of an index [derived: kRegionShift]
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

PointLeafFinder::PointLeafFinder(const Octree& tree, double spacing) : mTree(tree)
{
    constexpr double kRoundingMargin = 2e-7; ///< of a reach [derived: rounding to floats]
    for (std::size_t level = 0; level < mReach2.size(); ++level) {
        const double reach = tree.reach(int(level)) / tree.root.side * (1 + 1e-6) + kRoundingMargin;
        mReach2[level] = float(reach * reach);
    }
    const double cubes = std::clamp(tree.root.side / (kCubeSpacings * spacing), 1.0, 0x1p20);
    mCubeLevel = std::size_t(std::lround(std::log2(cubes)));
    mNear.resize(kCubesAlong * kCubesAlong * kCubesAlong, {Cube{kNoCube, kNoCube, kNoCube}, {}});
    mNodes.makeRoom(1);
    mNodes.add(tree.nodes[0], {}, {0.5f, 0.5f, 0.5f}, mReach2[0]);
    mSteps[0] = {0, 1, !tree.nodes[0].isLeaf()};
}

/// Make room for @a nodes more nodes, and for padding.
void PointLeafFinder::Nodes::makeRoom(std::size_t nodes)
{
    if (count + nodes + kNodeLanes <= at.size()) return;
    const std::size_t size = 2 * (count + nodes + kNodeLanes);
    at.resize(size);
    for (auto* values : {&x, &y, &z, &reach2}) values->resize(size);
}

[[gnu::always_inline]] inline void PointLeafFinder::Nodes::add(OctreeNode node,
                                                               const OctreeCell& cell,
                                                               const std::array<float, 3>& center,
                                                               float squaredReach)
{
    at[count] = {node, cell};
    x[count] = center[0];
    y[count] = center[1];
    z[count] = center[2];
    reach2[count] = squaredReach;
    ++count;
}

MPUVDB_WIDE_CLONES
void PointLeafFinder::descend()
{
    const Step& above = mSteps[mLevel];
    Step& step = mSteps[++mLevel];
    mNodes.count = above.end;
    mNodes.makeRoom(8 * (above.end - above.begin));
    step.begin = above.end;
    step.hasInner = false;
    const std::size_t cubeLevel = std::min(mLevel, mCubeLevel);
    const float edge = 1 / float(1u << cubeLevel);
    std::array<float, 3> first;
    for (std::size_t axis = 0; axis < 3; ++axis)
        first[axis] = edge * float(mCube[axis] >> (mCubeLevel - cubeLevel));
    const NodeLanes sideX = {-1, 1, -1, 1, -1, 1, -1, 1}, sideY = {-1, -1, 1, 1, -1, -1, 1, 1},
                    sideZ = {-1, -1, -1, -1, 1, 1, 1, 1};
    const float reach2 = mReach2[mLevel];
    const float quarter = 0.5f / float(1u << mLevel); // of the cells of inner nodes
    for (std::size_t group = above.begin; group < above.end; group += kNodeLanes) {
        std::uint64_t left =
            firstBits(above.end - group) &
            bitsOf(squaredGap(load(&mNodes.x[group]), load(&mNodes.y[group]),
                              load(&mNodes.z[group]), first, edge) < load(&mNodes.reach2[group]));
        for (; left; left &= left - 1) {
            const std::size_t n = group + std::size_t(__builtin_ctzll(left));
            const LeafAt from = mNodes.at[n];
            const float x = mNodes.x[n], y = mNodes.y[n], z = mNodes.z[n];
            if (from.node.isLeaf()) {
                mNodes.add(from.node, from.cell, {x, y, z}, mNodes.reach2[n]);
                continue;
            }
            const NodeLanes distance2 = squaredGap(x + quarter * sideX, y + quarter * sideY,
                                                   z + quarter * sideZ, first, edge);
            for (std::uint64_t children = bitsOf(distance2 < reach2); children;
                 children &= children - 1) {
                const int octant = __builtin_ctzll(children);
                const OctreeNode child = mTree.nodes[from.node.index + std::uint32_t(octant)];
                step.hasInner |= !child.isLeaf();
                mNodes.add(child, from.cell.child(octant),
                           {octant & 1 ? x + quarter : x - quarter,
                            octant & 2 ? y + quarter : y - quarter,
                            octant & 4 ? z + quarter : z - quarter},
                           reach2);
            }
        }
    }
    step.end = mNodes.count;
}

/// Descend from the smallest cube that holds this one and the last until only leaves are left.
void PointLeafFinder::enter(const Cube& cube)
{
    const std::uint32_t differ = (cube[0] ^ mCube[0]) | (cube[1] ^ mCube[1]) | (cube[2] ^ mCube[2]);
    mCube = cube;
    while (differ >> (mCubeLevel - std::min(mLevel, mCubeLevel))) --mLevel;
    while (mLevel < kMaxFloatLevel && mSteps[mLevel].hasInner) descend();
}

/// The nodes that reach into a small cube.
const PointLeafFinder::Nodes& PointLeafFinder::near(const Cube& cube)
{
    std::size_t slot = 0;
    for (const std::uint32_t n : cube) slot = slot * kCubesAlong + n % kCubesAlong;
    auto& [of, nodes] = mNear[slot];
    if (of == cube) return nodes;
    of = cube;
    enter(cube);
    const Step& step = mSteps[mLevel];
    nodes.count = 0;
    nodes.makeRoom(step.end - step.begin);
    for (std::size_t n = step.begin; n < step.end; ++n)
        nodes.add(mNodes.at[n].node, mNodes.at[n].cell, {mNodes.x[n], mNodes.y[n], mNodes.z[n]},
                  mNodes.reach2[n]);
    return nodes;
}

/// Add the leaves at and below @a nodes whose balls hold @a p, or @a at in units of the root cube.
MPUVDB_WIDE_CLONES
void PointLeafFinder::addHolding(const Nodes& nodes, const Vec3d& p, const std::array<float, 3>& at)
{
    const auto keep = [&](OctreeNode leaf, const OctreeCell& cell) {
        mFound.push_back({leaf, cell});
    };
    for (std::size_t group = 0; group < nodes.count; group += kNodeLanes) {
        const NodeLanes x = load(&nodes.x[group]) - at[0], y = load(&nodes.y[group]) - at[1],
                        z = load(&nodes.z[group]) - at[2];
        for (std::uint64_t left = bitsOf(x * x + y * y + z * z < load(&nodes.reach2[group])) &
                                  firstBits(nodes.count - group);
             left; left &= left - 1) {
            const LeafAt& node = nodes.at[group + std::size_t(__builtin_ctzll(left))];
            if (node.node.isLeaf())
                mFound.push_back(node);
            else
                mTree.forEachLeafAt(p, keep, node.node, node.cell);
        }
    }
}

const std::vector<LeafAt>& PointLeafFinder::find(const Vec3d& p)
{
    mFound.clear();
    const Vec3d at = (p - mTree.root.corner) / mTree.root.side;
    if ((at.array() >= 0).all() && (at.array() < 1).all()) {
        const double cubes = double(1u << mCubeLevel); // along each axis
        Cube cube;
        for (std::size_t k = 0; k < 3; ++k) cube[k] = std::uint32_t(at[Eigen::Index(k)] * cubes);
        addHolding(near(cube), p, {float(at[0]), float(at[1]), float(at[2])});
    } else {
        const auto keep = [&](OctreeNode leaf, const OctreeCell& cell) {
            mFound.push_back({leaf, cell});
        };
        mTree.forEachLeafAt(p, keep, mTree.nodes[0], {});
    }
    return mFound;
}

} // namespace mpuvdb
