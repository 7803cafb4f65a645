// Points out of meshes.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// Append the fan of a polygon. Polygons of less than three corners give nothing.
void appendPolygon(const std::vector<std::int64_t>& corners, Triangles& triangles);
/// Append triangle strips, separated by negative numbers.
void appendStrips(const std::vector<std::int64_t>& corners, Triangles& triangles);
/// The first corner that is not a vertex, or null if all are; negative ones are let through where
/// they @a separate strips.
const std::int64_t* findBadCorner(const std::vector<std::int64_t>& corners, std::uint64_t vertices,
                                  bool separate);
/// @throws InputError about a corner that findBadCorner() found at @a where.
[[noreturn]] void throwBadCorner(std::int64_t corner, std::uint64_t vertices,
                                 const std::string& where);

/// Give vertices area-weighted normals and leave out those that no triangle uses, and let go of the
/// triangles, but for their numbers. Vertices with normals of their own, and files without
/// triangles, stay as they are.
void addMeshNormals(FilePoints& points);

} // namespace mpuvdb
