// How often a mesh winds around a place.
#pragma once
#include "spatial/triangle_tree.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// The generalized winding number of oriented triangles: the solid angle that they fill as seen
/// from a place, over 4 pi. Inside a closed mesh whose triangles face outward it is 1, outside 0.
/// Nodes of the tree that are far away count with two terms of their expansion [Barill18].
class WindingNumber
{
public:
    /// @param tree  has to outlive this. @param multiplicity  of each of the mesh's triangles, how
    /// often it counts; empty: once.
    WindingNumber(const TriangleTree& tree, const std::vector<std::int32_t>& multiplicity,
                  bool closed);

    /// At @a p, relative to the mesh's frame. Exact to rounding where the mesh is closed and @a p
    /// is on no triangle: then the number is whole, and is computed with more of the nodes opened
    /// until it is near to one.
    double at(const Vec3d& p) const;
    /// At @a p, from the @a number at @a known: of a closed mesh it differs by what the segment
    /// between them crosses, which is looked up faster where they are near each other. What passes
    /// too near to an edge to be told is not relied upon.
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
