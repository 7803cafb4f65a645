// Finds the leaves of an octree that reach into a block of voxels.
#pragma once
#include "octree.h"

#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

struct LeafAt {
    OctreeNode node;
    OctreeCell cell;
};

/// For one thread; fastest where blocks of one region follow each other: they share the descent.
class LeafFinder
{
public:
    /// @param origin  of the lattice, local coordinates.
    LeafFinder(const Octree& tree, const Vec3d& origin, double voxelSize);
    /// All leaves whose balls hold a voxel of @a block, and some that come close; depth first.
    /// Valid until the next call.
    const std::vector<LeafAt>& find(const Vec3i& block);

private:
    void enterRegion(const Vec3i& region);
    /// Add the leaves below an inner node that reach into the region, depth first; @a x, @a y and
    /// @a z are its centre.
    void addBelow(OctreeNode inner, const OctreeCell& cell, float x, float y, float z);
    void addLeaf(OctreeNode leaf, const OctreeCell& cell, float x, float y, float z);
    void makeRoom(std::size_t leaves);

    const Octree& mTree;
    Vec3d mOrigin;
    double mVoxelSize;
    /// By level, voxels: quarter of the size; square of how far the node and those below it reach.
    std::array<float, SortedPoints::kMaxLevel + 2> mQuarter, mReach2;
    Vec3i mRegion;
    bool mHasRegion = false;
    /// Leaves that reach into the region: the first mCount; then room for more.
    std::size_t mCount = 0;
    std::vector<LeafAt> mLeaves;
    std::vector<float> mX, mY, mZ, mLeafReach2; ///< voxels about the region's first
    std::vector<std::uint32_t> mInBlock;
    std::vector<LeafAt> mFound;
};

} // namespace mpuvdb
