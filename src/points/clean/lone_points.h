// Points that have fewer neighbors than those about them, as outliers beside surfaces do.
#pragma once
#include <mpuvdb/normals.h>
#include <mpuvdb/vec.h>

#include <vector>

namespace mpuvdb
{

class PointCells;
class Interrupter;

/// Flag points that have no other near and are off the plane of their neighbors; and those about
/// which others are several times closer together, unless they lie on a plane with those that
/// surround them, as the points of a sparser surface do. Where there are normals a point stays,
/// too, that goes on from its neighbors as both their normals say: the few that a scanner saw at
/// the bottom of a fold. The same for any order of the positions and number of threads, where no
/// two distances are equal. About 0.05 us of processor time per point, 10 to 30 us for each that
/// has few others near.
/// @param normals  of @a positions, unit length; or none.
/// @param cells    of points of @a positions, a few spacings wide.
/// @param asked    those of the cells whose points are judged.
/// @param flags    of outliers: those known already are no neighbors.
/// @throws Interrupted.
void flagLonePoints(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
                    const PointCells& cells, const std::vector<std::uint32_t>& asked,
                    const PointStatistics& statistics, std::vector<char>& flags,
                    Interrupter& progress);

/// Whether two points with these unit normals may lie on one side of a wall.
bool lookToOneSide(const Vec3f& a, const Vec3f& b);

} // namespace mpuvdb
