// The virtual scanner: exact solids, and points measured on them as by devices.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A solid with a known signed distance. Lengths are world units.
class Solid
{
public:
    virtual ~Solid() = default;
    /// Signed distance, negative inside. Exact for primitives; for Booleans exact in sign and on
    /// the surface, elsewhere a lower bound of the distance's magnitude.
    virtual double distance(const Vec3d& p) const = 0;
    /// A cheap value of the same sign as distance() and no larger magnitude.
    virtual double bound(const Vec3d& p) const { return distance(p); }
    /// Whether distance() is exact in a band of any width.
    virtual bool isExact() const { return true; }
    /// Outward unit normal at a point on (or near) the surface.
    virtual Vec3d normal(const Vec3d& p) const = 0;
    virtual Box3d bounds() const = 0;
    /// Boxes, one or more, whose union holds the surface.
    virtual std::vector<Box3d> parts() const { return {bounds()}; }
};

/// The solid of a description: a primitive with its numbers, or an operation on solids, such as
/// "sphere(1)", "difference(box(2,2,1), cylinder(0.4,3))", "translate(torus(1,0.3), 0,0,1)".
/// @throws UsageError with the place of the error, InputError for an empty solid.
std::shared_ptr<const Solid> parseSolid(const std::string& description);
/// The help text of all solids for parseSolid().
std::string solidHelp();

/// Settings of scan().
struct ScanSettings {
    enum class Pattern {
        Even,   ///< blue noise: neighbors keep their distance
        Random, ///< uniform by area; independent on convex solids
        Scan    ///< range images from viewpoints, with occlusion
    };
    std::uint64_t points = 100000; ///< number, in [1, 4e9] (Scan: approximate)
    Pattern pattern = Pattern::Even;
    int views = 8;                 ///< Scan: viewpoints spread over a sphere, in [1, 10000]
    std::vector<Vec3d> viewpoints; ///< Scan: instead of views, world units
    double noise = 0;              ///< standard deviation >= 0, world units (Scan: along the ray)
    double normalNoise = 0;        ///< standard deviation, degrees in [0, 90]
    bool confidence = false;       ///< make confidences (Scan: cosine of the angle of incidence,
                                   ///< falling towards the borders; else from the noise drawn)
    bool normals = true;           ///< make normals
    double outliers = 0;           ///< share of points replaced, in [0, 0.5]
    double outlierDistance = 0.1;  ///< standard deviation per axis >= 0, parts of the diagonal
    int holes = 0;                 ///< spherical holes in the surface, in [0, 100000]
    double holeRadius = 0.05;      ///< >= 0, parts of the diagonal
    std::uint64_t seed = 1;        ///< equal settings and seeds give equal points
};

/// Samples @a solid. The same for any number of threads.
/// @throws UsageError for settings out of range, InputError if the solid has no surface,
/// Interrupted.
PointCloud scan(const Solid& solid, const ScanSettings& settings,
                Interrupter* interrupter = nullptr);

} // namespace mpuvdb
