// Range images: points on a grid of rays.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// The point of a file that each ray of a range image hit.
struct RangeGrid {
    static constexpr std::uint32_t kMissed = 0xffffffffu; ///< no point [derived: the largest]

    std::size_t columns = 0, rows = 0;
    std::vector<std::uint32_t> points; ///< row by row; kMissed where a ray hit nothing
    /// The scanner's position; without it the rays are parallel to -z.
    bool hasEye = false;
    Vec3d eye = Vec3d::Zero();
};

/// Gives the points of @a points, which has one block, normals from the triangles between
/// neighboring rays, without those across a jump in depth, and, unless it has confidences, the
/// cosine between normal and ray, falling linearly over the last few rays before a border
/// [Curless96 §3]. Points without a triangle are left out. A grid that joins fewer than three
/// quarters of its points is no range image: then only a note is added.
void addRangeNormals(FilePoints& points, const RangeGrid& grid);

} // namespace mpuvdb
