// Cuts a mesh along the zero line of a function on its vertices.
#pragma once
#include <mpuvdb/mesh.h>

#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Triangles between two checks of the interrupter. [free: latency]
constexpr std::size_t kCheckStride = 1 << 16;

/// Whether a vertex of @a value stays.
inline bool isCovered(float value)
{
    return value >= 0;
}

/// The zero, in parts of an edge, of a function between its values @a from and @a to at the ends,
/// of which one is covered.
inline float crossing(float from, float to)
{
    return from / (from - to);
}

/// The part of @a mesh where @a values are 0 or above, with new vertices on the edges that the zero
/// line crosses; vertices within a quarter of an edge of it are moved onto it. No vertex belongs to
/// two fans of triangles.
Mesh cutMesh(Mesh mesh, const std::vector<float>& values, Interrupter& progress);

} // namespace mpuvdb
