// The surfaces that close the holes of an open mesh.
#pragma once
#include "spatial/triangle_tree.h"
#include "winding_number.h"
#include <mpuvdb/field.h>

#include <openvdb/Types.h>

#include <array>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A hole of a mesh and the surface that closes it.
struct ClosedHole {
    Box3d box;       ///< of the surface, world units
    double area = 0; ///< of the surface, world units squared

    double width() const { return box.diagonal().norm(); }
};

/// The surfaces that close an open mesh's holes: there its winding number is one half, away from
/// its triangles.
struct MeshClosure {
    std::vector<Vec3f> positions;          ///< relative to the mesh's frame
    std::vector<Mesh::Triangle> triangles; ///< facing outward
    std::vector<ClosedHole> holes;         ///< in order of the surfaces' first cells
    std::vector<openvdb::Coord> seam;      ///< cells in which they meet the mesh, by first voxel
};

/// An open mesh whose holes are to be closed.
struct OpenMesh {
    const WindingNumber& winding;
    const TriangleTree& boundary; ///< its triangles that bound the solid
    Box3d box;                    ///< beyond which nothing is inside, relative to the frame
    Vec3d frame;
};

/// Follow the surfaces from cell to cell of @a lattice, with a vertex in each [Gibson98]; where
/// they meet the mesh, vertices are on it. @param starts  segments, relative to the frame; each of
/// the surfaces meets one. The same for any number of threads. @throws Interrupted.
MeshClosure closeHoles(const OpenMesh& mesh, const Lattice& lattice,
                       const std::vector<std::array<Vec3d, 2>>& starts, Interrupter& progress);

} // namespace mpuvdb
