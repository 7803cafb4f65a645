// The triangles of a mesh as the boundary of a solid, with neighbors and consistent orientation.
#pragma once
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

constexpr std::uint32_t kNoTriangle = 0xffffffffu; ///< number of none [derived: type's largest]

/// A mesh with its neighborhoods. Vertices at the same position are one.
struct OrientedTriangles {
    Mesh mesh; ///< vertices at the same position have one number; no attributes
    /// Multiplicity of each triangle in the winding number; empty: all 1.
    std::vector<std::int32_t> multiplicity;
    /// Neighbors of each triangle across its edges, where exactly two triangles of equal
    /// multiplicity and opposite directions meet; else kNoTriangle.
    std::vector<std::array<std::uint32_t, 3>> neighbors;
    /// Edges whose triangles do not cancel along them: the boundary of holes, and T-junctions.
    std::uint64_t openEdges = 0;
    std::uint64_t turned = 0;    ///< triangles turned to face as their neighbors do
    std::uint64_t copies = 0;    ///< triangles left out for others with the same corners
    std::uint64_t cancelled = 0; ///< of these, places of which no triangle is left

    bool isClosed() const { return openEdges == 0; }
};

/// How triangles with the same corners count.
enum class Copies {
    Add, ///< by their number, and those of opposite directions cancel
    /// Once. Those of opposite directions stay as well: a surface that was written for both its
    /// sides, unless the rest is closed without it, as where they part the cells of a volume mesh.
    Merge
};

/// Orient a mesh. Copies of a triangle become one with a multiplicity; triangles without three
/// different corners are dropped. Where neighbors contradict each other, all triangles of their
/// part face as most of its area did. @throws Interrupted.
OrientedTriangles orientTriangles(const Mesh& mesh, Copies copies, Interrupter& progress);

} // namespace mpuvdb
