// Points from meshes.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// Appends triangle strips, separated by negative numbers.
void appendStrips(const std::vector<std::int64_t>& corners, Triangles& triangles);
/// The first corner that is not a vertex, or null if all are; negative ones are accepted where they
/// @a separate strips.
const std::int64_t* findBadCorner(const std::vector<std::int64_t>& corners, std::uint64_t vertices,
                                  bool separate);
/// @throws InputError about a corner that findBadCorner() found at @a where.
[[noreturn]] void throwBadCorner(std::int64_t corner, std::uint64_t vertices,
                                 const std::string& where);

/// Gives vertices area-weighted normals, leaves out those that no triangle uses, and drops the
/// triangles, but for their number. Vertices with normals, and files without triangles, stay as
/// they are.
void addMeshNormals(FilePoints& points);

} // namespace mpuvdb
