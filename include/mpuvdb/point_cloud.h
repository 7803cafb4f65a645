// Points as everything behind the readers sees them.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Progress;

/// Oriented points about a frame: doubles at the door, floats near the origin inside.
/// A point's world position is frame + position. Optional attributes are empty, or one per point.
struct PointCloud {
    using Rgb = std::array<std::uint8_t, 3>;

    Vec3d frame = Vec3d::Zero();   ///< world position of the local origin, near the points' middle
    std::vector<Vec3f> positions;  ///< world units, relative to frame; finite
    std::vector<Vec3f> normals;    ///< unit, outward; or empty
    std::vector<float> confidence; ///< in (0,1], largest 1; or empty (all 1)
    std::vector<Rgb> colors;       ///< or empty

    std::size_t size() const { return positions.size(); }
    bool empty() const { return positions.empty(); }
    bool hasNormals() const { return !normals.empty(); }
    Vec3d world(std::size_t i) const { return frame + positions[i].cast<double>(); }
    /// Tight box of the positions relative to frame; empty without points.
    Box3d localBounds() const;
};

/// What the points say about themselves, from a few thousand of them.
struct PointStatistics {
    double spacing = 0; ///< median distance between neighbours on the surface, world units
    double noise = 0;   ///< standard deviation of points about the surface, along the normal
};

/// Measure spacing and noise: each of about 2000 evenly chosen points is compared with its nearest
/// neighbours; spacing = sqrt(pi/12) * distance to the 12th, noise = residual of a local quadric.
/// @throws InputError for fewer than two distinct points.
PointStatistics measure(const PointCloud& cloud, Progress& progress);

} // namespace mpuvdb
