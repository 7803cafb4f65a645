// The triangles that may be nearest to places of a small cube.
#pragma once
#include "spatial/triangle_tree.h"

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Squared distances from places of a cube to the nearest triangle of a tree, as the tree finds
/// them. What may be nearest to some place of the cube is gathered once, so that places that share
/// it do not descend the tree. For one thread.
class CellTriangles
{
public:
    /// @param tree  has to outlive this. @param size  world units, of cubes.
    CellTriangles(const TriangleTree& tree, double size);

    /// Gathers for the cube about @a middle, relative to the mesh's frame.
    void gather(const Vec3d& middle);
    /// Squared distance from @a p, a place of the cube, to the nearest triangle. @param slot
    /// becomes that of the triangle.
    double squaredDistance(const Vec3d& p, std::size_t& slot);

private:
    static constexpr std::size_t kLanes = 8; ///< [derived: floats of a vector]
    using Numbers = std::array<float, kLanes>;
    using Vectors = std::array<Numbers, 3>; ///< by axis

    /// Eight triangles, in sizes of the cube from its middle.
    struct Group {
        std::array<Vectors, 3> corner;
        std::array<Vectors, 3> edge;    ///< from corner k to the next
        Vectors normal;                 ///< unit; zero if there is none
        std::array<Numbers, 3> inverse; ///< 1 over the edges' squares; 0 for edges of no length
        std::array<std::uint32_t, kLanes> slots;

        void set(std::size_t lane, const std::array<Vec3d, 3>& corners);
    };
    /// Leaves of the tree in a group. [derived: a leaf has at most four triangles]
    static constexpr std::size_t kGroupLeaves = kLanes / TriangleTree::kLeafTriangles;
    /// A leaf of the tree, and a lower bound of the squared distance from the middle to it.
    struct Near {
        double distance2;
        std::uint32_t leaf;
    };

    void makeNext();
    static void squaredDistances(const Group& group, const Vec3f& p, Numbers& distances);

    const TriangleTree& mTree;
    double mSize;
    std::size_t mSlot = 0; ///< nearest to the middle
    Vec3d mMiddle = Vec3d::Zero();
    std::vector<Near> mNear;           ///< by distance from the middle
    std::size_t mCount = 0, mMade = 0; ///< groups of mNear, and how many of them are made
    std::vector<Group> mGroups;
    std::vector<Numbers> mDistances; ///< squared, of the groups' triangles
};

} // namespace mpuvdb
