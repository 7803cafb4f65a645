// Exact points on the surface of a solid: the three patterns of the scanner.
#pragma once
#include <mpuvdb/scan_sampler.h>

#include <vector>

namespace mpuvdb
{

/// A point on the surface, in double precision.
struct SurfacePoint {
    Vec3d position; ///< world
    Vec3f normal;   ///< unit, outward
};

/// Points uniform by area, and an estimate of the surface's area.
struct RandomSurface {
    std::vector<SurfacePoint> points;
    double area = 0; ///< world units squared
};

/// Random points: half of the crossings of the surface and isotropic random lines (Crofton's
/// formula). On a convex solid, where that is one of each line, the points are independent.
/// @throws InputError if no line finds a surface.
RandomSurface sampleRandom(const Solid& solid, std::uint64_t count, std::uint64_t seed,
                           Interrupter& progress);

/// Blue noise of @a count points: darts thrown in random order stick where no other is near on the
/// same side of the surface [Cook86], at the radius that gives the count.
std::vector<SurfacePoint> sampleEven(const Solid& solid, std::uint64_t count, std::uint64_t seed,
                                     Interrupter& progress);

/// The measurements of range images.
struct RangeScans {
    std::vector<SurfacePoint> points; ///< by view, row and column
    std::vector<Vec3f> rays;          ///< unit direction from the viewpoint, per point
    std::vector<float> confidence;    ///< in (0,1]
};

/// Range images of about settings.points points: from each viewpoint a square grid of rays over
/// the solid's bounding sphere, each ending at the first surface.
/// @throws UsageError if a viewpoint lies inside the solid, InputError if no ray hits it.
RangeScans sampleRangeScans(const Solid& solid, const ScanSettings& settings,
                            Interrupter& progress);

} // namespace mpuvdb
