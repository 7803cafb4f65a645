// Points out of meshes.
#pragma once
#include "raw_points.h"

namespace mpuvdb
{

/// A mesh's triangles while its vertices are still blocks.
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// Append the fan of a polygon. Polygons of less than three corners give nothing.
void appendPolygon(const std::vector<std::int64_t>& corners, Triangles& triangles);
/// Append triangle strips, separated by negative numbers.
void appendStrips(const std::vector<std::int64_t>& corners, Triangles& triangles);
/// @throws InputError naming @a where unless every corner is a vertex; negative ones are let
/// through where they @a separate strips.
void checkCorners(const std::vector<std::int64_t>& corners, std::uint64_t vertices, bool separate,
                  const std::string& where);

/// Give vertices area-weighted normals and leave out those that no triangle uses. Vertices with
/// normals of their own, and files without triangles, stay as they are.
void addMeshNormals(FilePoints& points, const Triangles& triangles);

} // namespace mpuvdb
