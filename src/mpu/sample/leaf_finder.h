// Finds the leaves of an octree that reach into a block of voxels.
#pragma once
#include "mpu/octree/octree.h"

#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// A leaf; on the way down to leaves an inner node, too.
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
    /// @a z are its center.
    void addBelow(OctreeNode inner, const OctreeCell& cell, float x, float y, float z);
    void addLeaf(OctreeNode leaf, const OctreeCell& cell, float x, float y, float z);
    void makeRoom(std::size_t leaves);

    const Octree& mTree;
    Vec3d mOrigin;
    double mVoxelSize;
    /// By level, voxels: quarter of the size; square of how far the node and those below it reach.
    std::array<float, Octree::kMaxLevel + 1> mQuarter, mReach2;
    Vec3i mRegion;
    bool mHasRegion = false;
    /// Leaves that reach into the region: the first mCount; then room for more.
    std::size_t mCount = 0;
    std::vector<LeafAt> mLeaves;
    std::vector<float> mX, mY, mZ, mLeafReach2; ///< voxels about the region's first
    std::vector<std::uint32_t> mInBlock;
    std::vector<LeafAt> mFound;
};

/// Finds the leaves whose balls hold a place. For one thread; fastest where each place is near some
/// before it: those in a small cube of the octree share what reaches into it, and those in cubes
/// beside each other the way down to the smallest one that holds both.
class PointLeafFinder
{
public:
    /// @param spacing  about how far apart the places will be.
    PointLeafFinder(const Octree& tree, double spacing);
    /// All leaves whose balls hold @a p (local coordinates), and some that come close; depth first.
    /// Valid until the next call.
    const std::vector<LeafAt>& find(const Vec3d& p);

private:
    /// Centers of cells are exact in floats down to this level, as parts of the root's side, which
    /// all lengths here are.
    static constexpr std::size_t kMaxFloatLevel = 20;
    using Cube = std::array<std::uint32_t, 3>;

    /// Nodes of the octree, their centers, and the squares of how far they reach.
    struct Nodes {
        void add(OctreeNode node, const OctreeCell& cell, const std::array<float, 3>& center,
                 float squaredReach);
        void makeRoom(std::size_t nodes);

        std::size_t count = 0; ///< of those that there are; after them is room for more
        std::vector<LeafAt> at;
        std::vector<float> x, y, z, reach2;
    };
    /// The nodes of one level that reach into the cube of that level about the last place, or into
    /// the small cube if that is the larger, and the leaves above them.
    struct Step {
        std::size_t begin = 0, end = 0;
        bool hasInner = false;
    };
    /// What reaches into a small cube: leaves, and nodes of level kMaxFloatLevel.
    struct Near {
        Cube cube;
        Nodes nodes;
    };

    const Nodes& near(const Cube& cube);
    void enter(const Cube& cube);
    void descend();
    void addHolding(const Nodes& nodes, const Vec3d& p, const std::array<float, 3>& at);

    const Octree& mTree;
    std::array<float, kMaxFloatLevel + 1> mReach2; ///< squared, by level
    std::size_t mCubeLevel;                        ///< of small cubes
    Cube mCube{};                                  ///< the small one about the last place
    std::array<Step, kMaxFloatLevel + 1> mSteps;   ///< by level
    std::size_t mLevel = 0;                        ///< of the last step
    Nodes mNodes;                                  ///< of all steps
    std::vector<Near> mNear;                       ///< of small cubes that lie near each other
    std::vector<LeafAt> mFound;
};

} // namespace mpuvdb
