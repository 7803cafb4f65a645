// The holes and gaps between the triangles that bound a solid.
#pragma once
#include "core/union_find.h"
#include "oriented_triangles.h"

#include <optional>

namespace mpuvdb
{

/// The edges at which triangles that bound a solid have no neighbor. Edges that share vertices make
/// a rim. Where another rim lies beside an edge the two face each other across a gap; else a rim
/// encloses a hole.
class MeshHoles
{
public:
    /// @param bounds  for each triangle whether it bounds the solid. @param width  largest width of
    /// a gap, world units. @throws Interrupted.
    MeshHoles(const OrientedTriangles& triangles, const std::vector<std::uint8_t>& bounds,
              double width, Interrupter& progress);

    /// What the sum of the triangles' volumes lacks, world units cubed: that of strips to the
    /// middles of gaps, and of cones from the middles of holes. @param from  where the triangles'
    /// volumes are measured from.
    double volume(const Vec3d& from) const;
    /// Call f(triangle, other, length) for the edges at gaps: the triangles on both sides, and half
    /// the edge's length, as the other side counts as well.
    template <class F>
    void forEachGap(const F& f) const
    {
        for (std::size_t n = 0; n < mEdges.size(); ++n)
            if (mAcross[n])
                f(mEdges[n].triangle, mEdges[mAcross[n]->edge].triangle,
                  (place(mEdges[n].to) - place(mEdges[n].from)).norm() / 2);
    }

private:
    /// An edge without a neighbor.
    struct Edge {
        std::uint32_t triangle, from, to;
        double times; ///< multiplicity of its triangle
    };
    /// What lies across a gap from an edge.
    struct Across {
        Vec3d offset; ///< from the edge's middle
        std::uint32_t edge;
    };

    void findGaps(double width, Interrupter& progress);
    Vec3d place(std::uint32_t vertex) const
    {
        return mTriangles.mesh.positions[vertex].cast<double>();
    }
    Vec3d middle(const Edge& edge) const { return (place(edge.from) + place(edge.to)) / 2; }

    const OrientedTriangles& mTriangles;
    std::vector<Edge> mEdges;
    std::vector<std::uint32_t> mRims;           ///< by vertex
    std::vector<std::optional<Across>> mAcross; ///< by edge
};

} // namespace mpuvdb
