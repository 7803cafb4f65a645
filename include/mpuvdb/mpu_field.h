// Multi-level partition of unity implicits [Ohtake03]: points to a signed distance function.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/surface_attributes.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace mpuvdb
{

class Interrupter;
struct FieldParts;

/// Support radius per cell diagonal for interpolation. [paper: Ohtake03 §6]
constexpr double kInterpolationAlpha = 1.25;

/// Settings of the fit.
struct MpuSettings {
    double tolerance = 0; ///< largest Taubin error |Q| / |grad Q| of a fit, world units, > 0
    /// Standard deviation of the points from the surface, world units; 0: exact. A fit beyond the
    /// tolerance is accepted if its residuals look like this noise.
    double noise = 0;
    /// Standard deviation of the normals, radians: fits weigh them against positions by it. 0:
    /// unknown, or estimated from the positions; normals then only orient, as without noise.
    double normalNoise = 0;
    double voxelSize = 0; ///< world units, > 0; cells have two voxels or more (0.5 where sharp)
    double alpha = 0.75;  ///< support radius / cell diagonal, in [0.6, 2]
    int minPoints = 15;   ///< N_min: least points of a fit, in [6, 1000]
    bool sharp = true;    ///< fit edges and corners [Ohtake03 §4c]
    /// Interpolate: the field is zero at every point [Ohtake03 §6]. Cells are split until each
    /// holds one point at most; the tolerance counts in cells that are large beside the points'
    /// spacing. Copies of a point are merged. Smooth everywhere, sharp is ignored; alpha in [1.05,
    /// 2].
    bool interpolate = false;
    /// Statistics of the points, if known; fits do not use them.
    PointStatistics points;
};

/// The points of a field in Morton order, one array per coordinate.
struct FieldPoints {
    Vec3d frame = Vec3d::Zero(); ///< world position of the origin of x, y, z
    const float *x = nullptr, *y = nullptr, *z = nullptr;    ///< world units
    const float *nx = nullptr, *ny = nullptr, *nz = nullptr; ///< unit normals
    std::size_t count = 0;
    std::shared_ptr<const VertexMesh> mesh; ///< the mesh whose vertices they are, or null
};

/// Statistics of a fit.
struct MpuStatistics {
    std::uint64_t cells = 0;         ///< cells of the octree, all levels
    std::uint64_t leaves = 0;        ///< cells whose fits are blended
    std::uint64_t fits = 0;          ///< local fits kept
    std::uint64_t sharpFits = 0;     ///< edges and corners among the fits
    int levels = 0;                  ///< deepest level; the root is 0
    double maxError = 0;             ///< largest error of an accepted fit, world units
    std::uint64_t overTolerance = 0; ///< leaves above the tolerance that may not be split
    std::uint64_t bytes = 0;         ///< memory held by the field
};

/// Estimate of a fit.
struct MpuEstimate {
    std::uint64_t leaves = 0;    ///< as in MpuStatistics
    std::uint64_t bytes = 0;     ///< memory held by the field
    std::uint64_t peakBytes = 0; ///< largest memory on the way, the cloud included
    double cpuSeconds = 0;       ///< of the fit, as this machine has just fitted a part
};

/// Estimate the memory and leaves of a fit of @a cloud by fitting about a hundred thousand points
/// of it, in cells spread evenly over the surface. @throws as MpuField.
MpuEstimate estimateFit(const PointCloud& cloud, const MpuSettings& settings,
                        Interrupter* interrupter = nullptr);

/// Local fits of an adaptive octree, blended, and normalized to a distance by the blended gradient
/// [Ohtake03]; a coarse field of the whole model where no data support the fits.
class MpuField final : public Field
{
public:
    /// Fit @a cloud, which must have normals, and which is consumed. Its colors and scalars are
    /// kept for attributes(). The result depends neither on the number of threads nor on the order
    /// of the points.
    /// @throws InputError without points or normals, UsageError for settings out of range,
    /// Interrupted.
    MpuField(PointCloud&& cloud, const MpuSettings& settings, Interrupter* interrupter = nullptr);
    /// A field whose parts were made before, such as those of a file.
    explicit MpuField(FieldParts&& parts);
    ~MpuField() override;

    Box3d bounds() const override;
    FieldSample evaluate(const Vec3d& position) const override;
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override;
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override;
    std::vector<Vec3i> seedBlocksIn(const Lattice& lattice, const Box3d& box) const override;
    std::size_t countData(const Box3d& box, std::size_t limit) const override;
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override;

    const MpuStatistics& statistics() const;
    /// The settings in effect.
    const MpuSettings& settings() const;
    /// The points; they live as long as the field.
    FieldPoints points() const;
    /// Ranges of numbers of points, in order and apart, that hold those in @a box (world units) and
    /// perhaps some close to it: first, and one after the last.
    std::vector<std::pair<std::size_t, std::size_t>> pointsIn(const Box3d& box) const;

    /// The support of the surface by the points: whether they lie all around a place x of it. A
    /// point p counts where |x - p| is below 3.75 s a. s is sqrt(pi/j) times the distance to p's
    /// j-th neighbor, j = 12 (or 24, 48 .. where fewer lie on a line), the median of those about
    /// p; a = 1 where the normals of p and of the surface differ by at most 90 degrees, and falls
    /// with their cosine to 0 at 120: a sheet close behind supports nothing. In the tangent plane,
    /// coverage is 1 up to s / 2 beyond the convex hull of these points, 0 from s on and where
    /// there are none, smooth (cubic) between. So it ends where the data do, and closes holes that
    /// are less than 7.5 spacings wide. The result refers to this field, which has to outlive it.
    /// @throws Interrupted.
    std::unique_ptr<const Coverage> coverage(Interrupter* interrupter = nullptr) const;

    /// The points' attributes @a names on the surface: kColorName, "confidence", or scalars of the
    /// cloud. A place has the mean, weighted by confidence, of about a dozen points around it.
    /// Means are taken on lattices, from the points' spacing on each twice as coarse as the one
    /// before, of which the finest with enough points count: far from all points values change as
    /// slowly as the points are far. Points that face the other way count as up to four times as
    /// far away. The result refers to this field, which has to outlive it.
    /// @throws UsageError for a name that the cloud does not have, Interrupted.
    std::unique_ptr<const SurfaceAttributes> attributes(const std::vector<std::string>& names,
                                                        Interrupter* interrupter = nullptr) const;

private:
    struct Impl;
    class Evaluator;
    std::unique_ptr<const Impl> mImpl;
};

} // namespace mpuvdb
