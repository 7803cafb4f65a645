// Multi-level partition of unity implicits [Ohtake03]: points to a signed distance function.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/surface_attributes.h>

#include <cstdint>

namespace mpuvdb
{

class Interrupter;

/// The paper's alpha for interpolation.
constexpr double kInterpolationAlpha = 1.25;

/// How points are fitted.
struct MpuSettings {
    double tolerance = 0; ///< largest Taubin error |Q|/|grad Q| of a local fit, world units, > 0
    /// Standard deviation of the points about the surface, world units; 0: they are exact. A fit
    /// beyond the tolerance stays where all that it leaves of the points is noise.
    double noise = 0;
    /// Standard deviation of the normals, radians, that lets fits weigh them against the positions;
    /// 0: unknown, or they come from the positions, and normals only orient. Without noise, too.
    double normalNoise = 0;
    double voxelSize = 0; ///< > 0; cells stay above two (with noise, or where sharp: .5 to 1.4)
    double alpha = 0.75;  ///< support radius / cell diagonal, in [0.6, 2]
    int minPoints = 15;   ///< N_min: points a fit needs, in [6, 1000]
    bool sharp = true;    ///< fit edges and corners [Ohtake03 §4c]
    /// Zero at every point [Ohtake03 §6]: cells are split until each holds one point at most; the
    /// tolerance rules cells that are large beside the spacing of their points. Copies of a point
    /// count as one. Smooth everywhere, whatever sharp says; alpha in [1.05, 2].
    bool interpolate = false;
    /// What the points say about themselves, if that is known. Fits do not ask for it.
    PointStatistics points;
};

/// The points of a field, as it keeps them: in Morton order, one array per coordinate.
struct FieldPoints {
    Vec3d frame = Vec3d::Zero(); ///< world position that x, y and z count from
    const float *x = nullptr, *y = nullptr, *z = nullptr;    ///< world units
    const float *nx = nullptr, *ny = nullptr, *nz = nullptr; ///< their normals
    std::size_t count = 0;
    std::shared_ptr<const VertexMesh> mesh; ///< whose vertices they are; or null
};

/// What the fit came to.
struct MpuStatistics {
    std::uint64_t cells = 0;         ///< of the octree, all levels
    std::uint64_t leaves = 0;        ///< cells that are blended
    std::uint64_t fits = 0;          ///< local fits kept
    std::uint64_t sharpFits = 0;     ///< of them edges and corners
    int levels = 0;                  ///< deepest level; the root is 0
    double maxError = 0;             ///< largest error of an accepted fit, world units
    std::uint64_t overTolerance = 0; ///< leaves that the level limit stopped above the tolerance
    std::uint64_t bytes = 0;         ///< held by the field
};

/// What a fit would come to.
struct MpuEstimate {
    std::uint64_t leaves = 0;    ///< as in MpuStatistics
    std::uint64_t bytes = 0;     ///< held by the field
    std::uint64_t peakBytes = 0; ///< the most on the way to it, the cloud included
};

/// Estimate what fitting @a cloud takes, by fitting a part of it: about a hundred thousand points
/// of cells that are spread evenly over the surface. @throws as MpuField.
MpuEstimate estimateFit(const PointCloud& cloud, const MpuSettings& settings,
                        Interrupter* interrupter = nullptr);

/// The blended local fits of an adaptive octree, normalized to a distance by the blended gradient;
/// and a coarse field of the whole model where no data support them.
class MpuField final : public Field
{
public:
    /// Fit @a cloud, which must have normals, and which is consumed. Its colors and scalars are
    /// kept for attributes(): leave out what nobody asks for. The result depends neither on the
    /// number of threads nor on the order of the points.
    /// @throws InputError without points or normals, UsageError for settings out of range,
    /// Interrupted.
    MpuField(PointCloud&& cloud, const MpuSettings& settings, Interrupter* interrupter = nullptr);
    ~MpuField() override;

    Box3d bounds() const override;
    FieldSample evaluate(const Vec3d& position) const override;
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override;
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override;
    std::size_t countData(const Box3d& box, std::size_t limit) const override;
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override;

    const MpuStatistics& statistics() const;
    /// As given, and what the points come to in it; they live as long as the field.
    const MpuSettings& settings() const;
    FieldPoints points() const;

    /// Where the points support the surface. With r the least of |x - p| / (s a) over all points p:
    /// 1 up to r = 2.5, 0 from r = 5 on, smooth (cubic) between. s is the spacing of the points
    /// about p, sqrt(pi/12) times the distance to the 12th neighbor, as the median of p's
    /// neighbors has it; a = 1 where the normals of p and of the surface differ by at most 90
    /// degrees, and falls with their cosine to 0 at 120: a sheet close behind supports nothing. The
    /// result refers to this field, which has to outlive it. @throws Interrupted.
    std::unique_ptr<const Coverage> coverage(Interrupter* interrupter = nullptr) const;

    /// The points' attributes @a names on the surface: kColorName, "confidence", or scalars of the
    /// cloud. A place has the mean, by confidence, of what the points about it have: of about a
    /// dozen, so that colors are as fine as the points, where fits are as coarse as the shape
    /// allows. The mean is taken on lattices, from the spacing of the points about a place on each
    /// with twice as large cells' faces as the one before, of which the finest count that have
    /// enough points there: far from all points, where the surface is invented, values change as
    /// slowly as the points are far, at no more cost. Points that face the other way count as up to
    /// four times as far away. The result refers to this field, which has to outlive it.
    /// @throws UsageError for a name that the cloud had not.
    std::unique_ptr<const SurfaceAttributes>
    attributes(const std::vector<std::string>& names) const;

private:
    struct Impl;
    class Evaluator;
    std::unique_ptr<const Impl> mImpl;
};

} // namespace mpuvdb
