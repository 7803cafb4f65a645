// The virtual scanner: exact solids, and points measured on them the way devices do.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A solid with a known signed distance.
class Solid
{
public:
    virtual ~Solid() = default;
    /// Signed distance, negative inside. Exact for primitives; for Booleans exact in sign and on
    /// the surface, elsewhere a lower bound of the distance's magnitude.
    virtual double distance(const Vec3d& p) const = 0;
    /// Where the distance is costly, a cheap value of the same sign and no larger magnitude.
    virtual double bound(const Vec3d& p) const { return distance(p); }
    /// Whether distance() is exact in a band of any width.
    virtual bool isExact() const { return true; }
    /// Outward unit normal at a point on (or near) the surface.
    virtual Vec3d normal(const Vec3d& p) const = 0;
    virtual Box3d bounds() const = 0;
    /// Boxes, one or more, that hold the surface together: what lies far between them need not be
    /// searched.
    virtual std::vector<Box3d> parts() const { return {bounds()}; }
};

/// Build a solid from a description: a primitive with its numbers, or a Boolean of solids, e.g.
/// "sphere(1)", "difference(box(2,2,1), cylinder(0.4,3))", "translate(torus(1,0.3), 0,0,1)".
/// solidHelp() lists all. @throws UsageError saying where the description is wrong.
std::shared_ptr<const Solid> parseSolid(const std::string& description);
std::string solidHelp();

/// What the scanner does.
struct ScanSettings {
    enum class Pattern {
        Even,   ///< blue noise: neighbors keep their distance
        Random, ///< uniform by area; independent on convex solids
        Scan    ///< range images from viewpoints, with occlusion
    };
    std::uint64_t points = 100000; ///< about as many (Scan: rays are chosen so that it fits)
    Pattern pattern = Pattern::Even;
    int views = 8;                 ///< Scan: viewpoints spread over the sphere
    std::vector<Vec3d> viewpoints; ///< Scan: instead of views, world positions
    double noise = 0;              ///< standard deviation, world units (Scan: along the ray)
    double normalNoise = 0;        ///< standard deviation, degrees
    bool confidence = false;       ///< write confidences (Scan: cosine of the angle of incidence,
                                   ///< falling towards the borders; else from the noise drawn)
    bool normals = true;
    double outliers = 0;          ///< share of points replaced, in [0, 0.5]
    double outlierDistance = 0.1; ///< standard deviation per axis, parts of the diagonal
    int holes = 0;                ///< spherical holes cut out of the surface, with their points
    double holeRadius = 0.05;     ///< parts of the diagonal
    std::uint64_t seed = 1;       ///< same settings and seed, same bytes
};

/// Sample @a solid. The same for any number of threads.
/// @throws UsageError for settings out of range, InputError if the solid has no surface.
PointCloud scan(const Solid& solid, const ScanSettings& settings,
                Interrupter* interrupter = nullptr);

} // namespace mpuvdb
