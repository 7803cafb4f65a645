// Triangles of meshes that are not checked yet.
#pragma once
#include <mpuvdb/triangle_mesh.h>

#include <algorithm>

namespace mpuvdb
{

/// Whether the corners of a triangle are there and finite.
inline bool isWhole(const Mesh& mesh, const Mesh::Triangle& t)
{
    return std::all_of(t.begin(), t.end(), [&](std::uint32_t corner) {
        return corner < mesh.positions.size() && mesh.world(corner).allFinite();
    });
}

/// The triangles of @a mesh that are whole, without attributes; vertices that are not finite, which
/// are then unused, become zero.
inline Mesh wholeTriangles(const Mesh& mesh)
{
    Mesh whole;
    whole.frame = mesh.frame;
    whole.positions = mesh.positions;
    for (std::size_t i = 0; i < mesh.positions.size(); ++i)
        if (!mesh.world(i).allFinite()) whole.positions[i].setZero();
    for (const Mesh::Triangle& t : mesh.triangles)
        if (isWhole(mesh, t)) whole.triangles.push_back(t);
    return whole;
}

} // namespace mpuvdb
