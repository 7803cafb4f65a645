// The faces of meshes, which may have any number of corners.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// The faces of a mesh while it is read: those of more than three corners as fans.
struct Faces {
    /// A face of more than three corners.
    struct Polygon {
        std::uint32_t first, count; ///< its triangles
    };

    Triangles triangles;
    std::vector<Polygon> polygons;

    /// Appends the face; nothing for less than three corners.
    void append(const std::vector<std::int64_t>& corners);
    void append(Faces&& other);
};

/// The triangles of faces. Polygons are cut along their shortest diagonals within them, so that
/// those that are not convex are right, and those with the same corners are cut the same way,
/// wherever they begin and whichever way they turn: the walls between cells of a volume mesh
/// cancel.
/// @param positions  of the vertices. @throws Interrupted.
Triangles cutPolygons(Faces&& faces, const std::vector<Vec3d>& positions, Interrupter& progress);

} // namespace mpuvdb
