// Finds the leaves of an octree that reach into a block of voxels.
#pragma once
#include "mpu/octree/octree.h"
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// A leaf, or an inner node on the way down to leaves.
struct LeafAt {
    OctreeNode node;
    OctreeCell cell;
};

/// Finder of the leaves of blocks, for one thread; fastest where blocks of one region follow each
/// other, which share the descent.
class LeafFinder
{
public:
    /// @param origin  of the lattice, local coordinates.
    LeafFinder(const Octree& tree, const Vec3d& origin, double voxelSize);
    /// All leaves whose balls hold a voxel of @a block, and some close to it; depth first.
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
    /// By level, voxels: a quarter of the size; the square of the reach of the node and those
    /// below.
    std::array<float, Octree::kMaxLevel + 1> mQuarter, mReach2;
    Vec3i mRegion;
    bool mHasRegion = false;
    /// Number of leaves that reach into the region; after them the arrays have room for more.
    std::size_t mCount = 0;
    std::vector<LeafAt> mLeaves;
    std::vector<float> mX, mY, mZ, mLeafReach2; ///< in voxels from the region's first
    std::vector<std::uint32_t> mInBlock;
    std::vector<LeafAt> mFound;
};

/// Finder of the leaves whose balls hold a place, for one thread; fastest where each place is near
/// some before it: places in a small cube of the octree share its leaves, and those in adjacent
/// cubes the descent to the smallest one that holds both.
class PointLeafFinder
{
public:
    /// @param spacing  typical distance between places, local units.
    PointLeafFinder(const Octree& tree, double spacing);
    /// All leaves whose balls hold @a p (local coordinates), and some close to it; depth first.
    /// Valid until the next call.
    const std::vector<LeafAt>& find(const Vec3d& p);

private:
    /// Level down to which centers of cells, in units of the root's edge as all lengths here, are
    /// exact in floats. [derived: 24 bits, with room]
    static constexpr std::size_t kMaxFloatLevel = 20;
    using Cube = std::array<std::uint32_t, 3>;

    /// Nodes of the octree, their centers, and the squares of their reaches.
    struct Nodes {
        void add(OctreeNode node, const OctreeCell& cell, const std::array<float, 3>& center,
                 float squaredReach);
        void makeRoom(std::size_t nodes);

        std::size_t count = 0; ///< number of nodes; after them the arrays have room for more
        std::vector<LeafAt> at;
        std::vector<float> x, y, z, reach2;
    };
    /// The nodes of one level that reach into the cube of that level about the last place, or into
    /// the small cube if it is larger, and the leaves above them.
    struct Step {
        std::size_t begin = 0, end = 0;
        bool hasInner = false;
    };
    /// The leaves, and nodes of level kMaxFloatLevel, that reach into a small cube.
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
    std::size_t mCubeLevel;                        ///< level of small cubes
    Cube mCube{};                                  ///< the small cube about the last place
    std::array<Step, kMaxFloatLevel + 1> mSteps;   ///< by level
    std::size_t mLevel = 0;                        ///< level of the last step
    Nodes mNodes;                                  ///< nodes of all steps
    std::vector<Near> mNear;                       ///< small cubes near each other
    std::vector<LeafAt> mFound;
};

} // namespace mpuvdb
