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

} // namespace mpuvdb
