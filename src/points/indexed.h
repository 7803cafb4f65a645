// What is asked of a cloud whose points are sorted already. The doors' functions of these names
// sort them first.
#pragma once
#include "spatial/point_cells.h"

#include <mpuvdb/normals.h>
#include <mpuvdb/point_cloud.h>

#include <memory>
#include <optional>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The index of a cloud's points. @throws Interrupted.
std::shared_ptr<const PointIndex> indexOf(const PointCloud& cloud, Interrupter& progress);

/// Bring the points into the order of their index, with all their attributes. @throws Interrupted,
/// and leaves the cloud as it was.
std::shared_ptr<const PointIndex> sortPoints(PointCloud& cloud, Interrupter& progress);

PointStatistics measure(const PointCloud& cloud, const PointIndex& index, Interrupter& progress);

/// The side of the cells in which outliers are looked for, world units.
double sideForOutliers(const PointStatistics& statistics);
/// @param cells  of all points, of that side.
std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointCells& cells,
                                        const PointStatistics& statistics, Interrupter& progress);

EstimatedNormals estimateNormals(PointCloud& cloud, const PointIndex& index,
                                 std::optional<int> neighbors, Interrupter& progress);

/// The side of the cells in which flipped normals are looked for, world units.
double sideForFlipped(const PointStatistics& statistics);
/// @param cells  of all points, of that side.
std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud, const PointCells& cells,
                                              const PointStatistics& statistics,
                                              Interrupter& progress);

std::vector<std::uint32_t> findInwardSolids(const PointCloud& cloud, const PointIndex& index,
                                            const PointStatistics& statistics,
                                            Interrupter& progress);

} // namespace mpuvdb
