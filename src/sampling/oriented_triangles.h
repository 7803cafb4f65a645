// The triangles of a mesh as what bounds a solid: which of them are neighbors, and which way they
// face.
#pragma once
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A mesh with its neighborhoods. Vertices at the same position are one.
struct OrientedTriangles {
    static constexpr std::uint32_t kNone = 0xffffffffu;

    Mesh mesh; ///< vertices at the same position have one number; no attributes
    /// Of each triangle, how often it counts in the winding number; empty: once.
    std::vector<std::int32_t> multiplicity;
    /// Of each triangle the neighbors across its edges, where two triangles of equal multiplicity
    /// meet that run along the edge in opposite directions; else kNone.
    std::vector<std::array<std::uint32_t, 3>> neighbors;
    /// Edges whose triangles do not cancel along them: the boundary of holes, and T-junctions.
    std::uint64_t openEdges = 0;
    std::uint64_t turned = 0; ///< triangles turned to face as their neighbors do

    bool isClosed() const { return openEdges == 0; }
};

/// Copies of a triangle become one with their number, those of opposite directions cancel;
/// triangles without three different corners go. Where neighbors contradict each other, all of
/// their part are turned to face as most of its area does. @throws Interrupted.
OrientedTriangles orientTriangles(const Mesh& mesh, Interrupter& progress);

} // namespace mpuvdb
