// The generalized winding number of a mesh.
#pragma once
#include "oriented_triangles.h"
#include "spatial/triangle_tree.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// The generalized winding number of oriented triangles: their solid angle seen from a place, over
/// 4 pi. Inside a closed mesh whose triangles face outward it is 1, outside 0.
///
/// The mesh's rims are the edges whose triangles do not cancel. Where these are few the number is
/// exact: the triangles that a ray crosses, and the solid angle of the fan from the opposite
/// direction to the rims, which has the same boundary as the mesh. Else it is the sum over the
/// triangles, where distant nodes of the tree count by two terms of their expansion [Barill18].
class WindingNumber
{
public:
    /// @param tree  of the triangles; it has to outlive this, as @a triangles.
    WindingNumber(const TriangleTree& tree, const OrientedTriangles& triangles);

    /// The number at @a p, relative to the mesh's frame. For a mesh without rims it is an integer.
    double at(const Vec3d& p) const;
    /// The number at @a p from the @a number at @a known: without rims they differ by the
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

    /// An edge, and how often it is in the boundary of the triangles.
    struct Rim {
        Vec3d a, b;
        std::int32_t times;
    };

    void findRims(const OrientedTriangles& triangles);
    bool hasFewRims() const;
    template <typename OfNode, typename OfSlot>
    void visit(const Vec3d& p, double openness, const OfNode& ofNode, const OfSlot& ofSlot) const;
    double sum(const Vec3d& p, double openness) const;
    std::optional<double> alongRay(const Vec3d& p, const Vec3d& direction, double length) const;
    std::optional<double> exactAt(const Vec3d& p) const;
    std::optional<int> crossing(std::size_t slot, const Vec3d& a, const Vec3d& b) const;
    double fanAngle(const Vec3d& p, const Vec3d& from) const;
    void sumLeaf(std::size_t leaf);
    void sumChildren(std::size_t node);
    double timesOf(std::size_t slot) const;

    const TriangleTree& mTree;
    const std::vector<std::int32_t>& mMultiplicity;
    std::vector<Rim> mRims;                ///< sorted
    bool mIsExact;                         ///< it is computed by rays
    std::vector<Node> mNodes;              ///< as the tree numbers them
    std::vector<double> mSizes;            ///< of the nodes: sum of the triangles' areas
    std::vector<TriangleTree::Box> mBoxes; ///< of the nodes, while they are summed up
};

} // namespace mpuvdb
