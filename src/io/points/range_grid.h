// Range images: points on a grid of rays, of which neighbors lie on one surface or do not.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// Which point, of those of a file, each ray of a range image met.
struct RangeGrid {
    static constexpr std::uint32_t kMissed = 0xffffffffu;

    std::size_t columns = 0, rows = 0;
    std::vector<std::uint32_t> points; ///< row by row; kMissed where a ray met nothing
    /// Where the scanner stood; without it the rays are parallel and look along -z.
    bool hasEye = false;
    Vec3d eye = Vec3d::Zero();
};

/// Give the points of @a points, which has one block, normals from the triangles between
/// neighboring rays, those across a jump in depth left out, and, unless it has confidences,
/// the cosine between normal and line of sight, falling linearly over the last few rays before a
/// border [Curless96 §3]. Points without a triangle are left out. A grid that joins fewer than
/// three quarters of its points is no range image: then nothing changes but a note.
void addRangeNormals(FilePoints& points, const RangeGrid& grid);

} // namespace mpuvdb
