// Points that belong to no surface.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Find points that lie away from every surface: alone or in clumps of fewer than 24, farther from
/// others than these are from each other, or off the plane of their neighbors by some spacings and
/// more than the noise; beside surfaces, in bores and between walls too. Distances are judged
/// against the neighborhood's own spacing, so that sparse surfaces, rims and detached parts of 100
/// points or more stay, however much their spacings differ. Where there are normals, a point stays
/// whose own and its neighbors' say that the surface goes on from these to it. Where they are more
/// than one in fifty, what is left is judged again. Costs about 0.1 us of processor time per point,
/// and 10 to 30 us for each that has little company.
/// @param statistics  of this cloud, from measure().
/// @return indices, ascending; none of fewer than 200 points. @throws Interrupted.
std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointStatistics& statistics,
                                        Interrupter* interrupter = nullptr);

/// Take the points @a indices (ascending) out of @a cloud; the others keep their order.
void dropPoints(PointCloud& cloud, const std::vector<std::uint32_t>& indices);

} // namespace mpuvdb
