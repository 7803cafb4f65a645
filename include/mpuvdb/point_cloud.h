// Points as everything behind the readers sees them.
#pragma once
#include <mpuvdb/attributes.h>
#include <mpuvdb/vec.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;
class PointIndex;

/// Where a scanner stood, or from where it looked if it is far away.
struct Viewpoint {
    Vec3d place = Vec3d::Zero(); ///< world position; of a distant one the direction towards it
    bool distant = false;

    /// Towards the scanner from the world position @a p; not unit.
    Vec3d towards(const Vec3d& p) const { return distant ? place : Vec3d(place - p); }
};

/// A mesh whose vertices are points, in numbers: what comes of them can be held against it.
struct VertexMesh {
    double area = 0;            ///< world units squared
    double volume = 0;          ///< world units cubed; 0 if it is open
    bool isClosed = false;      ///< each edge has as many triangles one way as the other
    bool insideOut = false;     ///< it is closed, and all of it faces inward
    std::uint64_t parts = 0;    ///< connected by vertices, and not cavities
    std::uint64_t cavities = 0; ///< parts that are closed and face inward
    double edge = 0;            ///< world units: half the area has triangles with a longer one
    std::vector<Vec3d> places;  ///< spread evenly over the triangles, world units
};

/// Oriented points about a frame: doubles at the door, floats near the origin inside.
/// A point's world position is frame + position. Optional attributes are empty, or one per point.
struct PointCloud {
    using Rgb = mpuvdb::Rgb;

    Vec3d frame = Vec3d::Zero();   ///< world position of the local origin, near the points' middle
    std::vector<Vec3f> positions;  ///< world units, relative to frame; finite
    std::vector<Vec3f> normals;    ///< unit, outward; or empty
    std::vector<float> confidence; ///< in (0,1], largest 1; or empty (all 1)
    std::vector<Rgb> colors;       ///< sRGB; or empty
    std::vector<NamedScalars> scalars; ///< of different names, whatever was asked for

    /// Index of no viewpoint. [derived: beyond all indices]
    static constexpr std::uint32_t kUnseen = 0xffffffffu;
    std::vector<Viewpoint> viewpoints;
    std::vector<std::uint32_t> seenFrom;    ///< index into viewpoints, or kUnseen; or empty
    std::shared_ptr<const VertexMesh> mesh; ///< all points were vertices of it; or null
    /// The search index of the positions, if one was made; ignored once these have changed.
    std::shared_ptr<const PointIndex> index;

    std::size_t size() const { return positions.size(); }
    bool empty() const { return positions.empty(); }
    bool hasNormals() const { return !normals.empty(); }
    Vec3d world(std::size_t i) const { return frame + positions[i].cast<double>(); }
    /// @throws UsageError if some attribute is neither empty nor one per point, or a viewpoint is
    /// not there; InputError if a position is not finite.
    void demandWhole() const;
    /// Keep the points i with keep[i] != 0, in order, with all their attributes.
    void compact(const std::vector<std::uint8_t>& keep);
    /// Tight box of the positions relative to frame; empty without points.
    Box3d localBounds() const;
};

/// What the points say about themselves, from a thousand of them or so.
struct PointStatistics {
    double spacing = 0; ///< median distance between neighbors on the surface, world units
    /// Spacing that as many points would have if they lay evenly on the surface, world units; 0:
    /// not known.
    double evenSpacing = 0;
    /// World units squared.
    double areaPerPoint() const { return std::pow(std::max(spacing, evenSpacing), 2); }
    double noise = 0; ///< standard deviation of points about the surface, along the normal
    /// Standard deviation of normals about each of two axes across them, radians; 0 without
    /// normals.
    double normalNoise = 0;
    /// Whether the points lie about no surface at any scale, but throughout a solid.
    bool fillSolid = false;
    /// Share of the points that have the other side of their part less than 1.5 spacings behind
    /// them; 0 without normals.
    double thin = 0;
    /// The same share of less than 1.5 spacings or 8 standard deviations of the noise.
    double thinForNoise = 0;
};

/// Measure spacing and noise: each of about 1000 evenly chosen points is compared with its nearest
/// neighbors; spacing = sqrt(pi/12) * distance to the 12th, noise = residual of a local quadric,
/// normal noise = that of normals that change linearly.
/// @throws InputError for fewer than two distinct points, UsageError as demandWhole().
PointStatistics measure(const PointCloud& cloud, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
