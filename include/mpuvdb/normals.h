// Normals: estimated where a file has none, and judged where it has.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>

namespace mpuvdb
{

/// Fill cloud.normals by local least-squares planes, oriented consistently along a minimum spanning
/// tree over neighbours [Hoppe92 §3.3], each connected part outward at its outermost point.
/// @param neighbours  points per plane, at least 4. @throws InputError for fewer than 4 points.
void estimateNormals(PointCloud& cloud, int neighbours, Progress& progress);

/// Area-weighted normals of a triangle mesh's vertices. Unused and degenerate vertices get zero.
/// @param triangles  three indices below positions.size() each.
std::vector<Vec3f> vertexNormals(const std::vector<Vec3f>& positions,
                                 const std::vector<std::array<std::uint32_t, 3>>& triangles);

/// Whether the model is inside out: the signed volume the normals enclose is clearly negative.
/// (Divergence theorem with one area per point; open models are judged about their middle.)
bool pointsInward(const PointCloud& cloud);

/// Reverse all normals.
void flipNormals(PointCloud& cloud);

} // namespace mpuvdb
