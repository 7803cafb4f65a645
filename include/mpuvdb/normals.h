// Normals: estimated where a file has none, and judged where it has.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <optional>

namespace mpuvdb
{

/// What estimateNormals() went by.
struct EstimatedNormals {
    int neighbors = 0;          ///< points per plane, at least
    std::uint64_t onLines = 0;  ///< points whose neighbors, hundreds of them, lie on one line, so
                                ///< that their planes are arbitrary
    std::uint64_t unclosed = 0; ///< points at which the winding number of all is not about a half,
                                ///< as it is on a solid; 0 where viewpoints tell the outside
};

/// Fill cloud.normals by local least-squares planes, of the point's own sheet where another is
/// close, oriented consistently over neighbors, also across edges and between the sides of walls
/// and gaps from some 1.5 spacings; towards the viewpoints where the cloud has some, else each
/// connected part outward as seen from all sides, and the walls of cavities inward.
/// Costs 2 to 3 us of processor time per point, and 8 to 12 where there is noise.
/// Where neighbors lie on one line, as on contours and scan lines, more are taken.
/// @param neighbors  points per plane, in [4, 1000]; without a value 12, and up to 200 where the
/// points are noisy. @throws InputError for fewer than 4, or on a line.
EstimatedNormals estimateNormals(PointCloud& cloud, std::optional<int> neighbors,
                                 Interrupter* interrupter = nullptr);

/// Area-weighted normals of a triangle mesh's vertices. Unused and degenerate vertices get zero.
/// @param triangles  three indices below positions.size() each.
std::vector<Vec3f> vertexNormals(const std::vector<Vec3f>& positions,
                                 const std::vector<std::array<std::uint32_t, 3>>& triangles);

/// Whether the model is inside out: the signed volume the normals enclose is clearly negative.
/// (Divergence theorem with one area per point; open models are judged about their middle.)
bool pointsInward(const PointCloud& cloud);

/// Reverse all normals.
void flipNormals(PointCloud& cloud);

/// Find normals that look to the other side than their neighbors': single ones, up to about a
/// fifth of all, by a vote of those in the same plane; patches of a connected part where the rest
/// disagrees all along their border, on thin parts too, and if that leaves a choice, by what is
/// seen of the part from outside. Rims and folds disagree in places only, and stay; so do sheets
/// close behind or before each other, which rightly look opposite ways, and parts that are wholly
/// inside out. Costs about 0.13 us of processor time per point where there is nothing to find, and
/// some 12 on thin parts where there is.
/// @param statistics  of this cloud, from measure().
/// @return indices, ascending; none without normals. @throws Interrupted.
std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud,
                                              const PointStatistics& statistics,
                                              Interrupter* interrupter = nullptr);

/// Find the normals of solids that are inside out: of connected parts that, from whatever side they
/// are seen, show their backs, and with each the parts that lie in it, so that cavities stay what
/// they are. A part that looks inward and lies in one that looks outward is the wall of a cavity,
/// and stays. So does what is open, as rooms are that were scanned from within, with things in
/// them, their doors and the shadows of what stands before their walls. Costs about 0.1 us of
/// processor time per point. @param statistics  of this cloud, from measure().
/// @return indices, ascending; none without normals. @throws Interrupted.
std::vector<std::uint32_t> findInwardSolids(const PointCloud& cloud,
                                            const PointStatistics& statistics,
                                            Interrupter* interrupter = nullptr);

/// Reverse the normals of the points @a indices.
void flipNormals(PointCloud& cloud, const std::vector<std::uint32_t>& indices);

} // namespace mpuvdb
