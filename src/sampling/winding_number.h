// The generalized winding number of a mesh.
#pragma once
#include "spatial/triangle_tree.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// The generalized winding number of oriented triangles: their solid angle seen from a place, over
/// 4 pi. Inside a closed mesh whose triangles face outward it is 1, outside 0. Distant nodes of the
/// tree count by two terms of their expansion [Barill18].
class WindingNumber
{
public:
    /// @param tree  has to outlive this, as @a multiplicity. @param multiplicity  of each of the
    /// mesh's triangles; empty: all 1.
    WindingNumber(const TriangleTree& tree, const std::vector<std::int32_t>& multiplicity,
                  bool closed);

    /// The number at @a p, relative to the mesh's frame. For a closed mesh it is an integer: more
    /// nodes are opened until the sum is near to one.
    double at(const Vec3d& p) const;
    /// The number at @a p from the @a number at @a known: for a closed mesh they differ by the
    /// triangles that the segment between them crosses, which is fast for near places. Where a
    /// crossing is ambiguous, as at().
    double from(const Vec3d& known, double number, const Vec3d& p) const;

private:
    /// Terms of a node's expansion about its center.
    struct Node {
        Vec3f center = Vec3f::Zero();                     ///< mean of its triangles, by area
        Vec3f area = Vec3f::Zero();                       ///< sum of its triangles' area vectors
        Eigen::Matrix3f moment = Eigen::Matrix3f::Zero(); ///< sum of area vector x offset
        float radius = 0; ///< of a ball about the center that holds its box
    };

    double sum(const Vec3d& p, double openness) const;
    std::optional<int> crossing(std::size_t slot, const Vec3d& a, const Vec3d& b) const;
    double solidAngle(std::size_t slot, const Vec3d& p) const;
    void sumLeaf(std::size_t leaf);
    void sumChildren(std::size_t node);
    double timesOf(std::size_t slot) const;

    const TriangleTree& mTree;
    const std::vector<std::int32_t>& mMultiplicity;
    bool mClosed;
    std::vector<Node> mNodes;              ///< as the tree numbers them
    std::vector<double> mSizes;            ///< of the nodes: sum of the triangles' areas
    std::vector<TriangleTree::Box> mBoxes; ///< of the nodes, while they are summed up
};

} // namespace mpuvdb
