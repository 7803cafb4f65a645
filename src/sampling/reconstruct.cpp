#include "resolve.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/reconstruct.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// The default tolerance of fits, voxels, beside the noise. [tuned: noise_bench]
constexpr double kToleranceVoxels = 0.1;

/// The median spacing, where points are about even: six voxels of a band three voxels to either
/// side for each. Uneven ones, such as those of a scanner that stands in the scene, would get
/// hundreds, nearly all of them where points are far apart.
double defaultVoxelSize(const PointStatistics& points)
{
    // [derived: as many voxels a point as where spacings of the same points differ up to fourfold]
    constexpr double kMostVoxels = 16;
    constexpr double kBand = 6; // voxels across
    // Spacings. [derived: half the width of a disc of 15 points, the ball of a fit, which shows
    // nothing finer]
    const double widest = std::sqrt(15 / M_PI);
    return std::clamp(std::sqrt(kBand / kMostVoxels) * points.evenSpacing, points.spacing,
                      widest * points.spacing);
}

double resolveVoxelSize(const ReconstructOptions& options, const ResolvedSettings& resolved)
{
    const double longest = resolved.boxSize.maxCoeff();
    if (options.voxelSize && options.voxels)
        throw UsageError("give the voxel size or the number of voxels, not both");
    if (options.voxels) {
        if (!(*options.voxels >= 4 && *options.voxels <= 100000))
            throw UsageError(fmt::format(
                "{} voxels along the longest side; it must be in [4, 100000]", *options.voxels));
        return longest / *options.voxels;
    }
    if (options.voxelSize) {
        if (options.voxelSize->unit == Length::Unit::Voxels)
            throw UsageError("a voxel size in voxels says nothing: give world units or %");
        const double h = options.voxelSize->resolve(0, resolved.diagonal);
        if (!(h > 0)) throw UsageError(fmt::format("voxel size is {}; it must be above 0", h));
        return h;
    }
    return defaultVoxelSize(resolved.points);
}

/// @throws InputError if the vertices of a mesh are too far from most of its surface to show it.
void requireSupport(const VertexMesh& mesh, double spacing)
{
    // [derived: twice the distance from points up to which MpuField::coverage() has support]
    constexpr double kSpanned = 10; // spacings
    if (mesh.edge <= kSpanned * spacing) return;
    throw InputError(fmt::format(
        "mesh: half of its surface is in triangles with edges longer than {:.4g}, {:.0f} times the "
        "spacing of its vertices: points at the vertices do not show it. Make a level set of the "
        "triangles themselves with mpuvdb voxelize (Python: mpuvdb.mesh), or divide them until "
        "their edges are at most {:.4g}",
        mesh.edge, mesh.edge / spacing, kSpanned * spacing));
}

Box3d resolveRegion(const std::array<Length, 6>& region, const ResolvedSettings& resolved)
{
    Box3d box;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto at = [&](std::size_t corner) {
            return region[3 * corner + axis].resolve(resolved.grid.lattice.voxelSize,
                                                     resolved.diagonal);
        };
        box.min()[Eigen::Index(axis)] = at(0);
        box.max()[Eigen::Index(axis)] = at(1);
    }
    if (!(box.sizes().minCoeff() > 0))
        throw UsageError("the region is empty: give the lower corner first, x0 y0 z0 x1 y1 z1");
    return box;
}

/// Leave out the attributes of @a cloud that @a names does not have.
void keepNamed(PointCloud& cloud, const std::vector<std::string>& names)
{
    const auto isNamed = [&](const std::string& name) {
        return std::find(names.begin(), names.end(), name) != names.end();
    };
    if (!isNamed(kColorName)) cloud.colors = {};
    cloud.scalars.erase(
        std::remove_if(cloud.scalars.begin(), cloud.scalars.end(),
                       [&](const NamedScalars& scalars) { return !isNamed(scalars.name); }),
        cloud.scalars.end());
}

/// @throws UsageError where one place is within @a tolerance of all points: nothing is to be
/// fitted.
void requireSmaller(double tolerance, const ResolvedSettings& resolved)
{
    if (tolerance > resolved.diagonal / 2)
        throw UsageError(fmt::format("tolerance {:.4g}: is more than half of the diagonal of the "
                                     "points' box, {:.4g}, so that any surface would do. Give a "
                                     "smaller one, such as 0.1vx, or none",
                                     tolerance, resolved.diagonal));
}

} // namespace

ResolvedSettings resolve(const PointCloud& cloud, const PointStatistics& statistics,
                         const ReconstructOptions& options)
{
    ResolvedSettings resolved;
    resolved.points = statistics;
    if (cloud.mesh) requireSupport(*cloud.mesh, resolved.points.spacing);
    const Box3d box = cloud.localBounds();
    resolved.boxSize = box.sizes();
    resolved.diagonal = resolved.boxSize.norm();
    const double h = resolveVoxelSize(options, resolved);
    const double across = resolved.boxSize.maxCoeff() / h;
    if (!(across <= 4e6))
        throw LimitError(
            fmt::format("{:.3g} voxels of size {} along the longest side are beyond the "
                        "index range: use larger voxels",
                        across, h));
    resolved.grid.lattice = latticeFor(box.translated(cloud.frame), h);
    resolved.grid.halfWidth = options.halfWidth;
    resolved.grid.maxBytes = options.maxBytes.value_or(0);
    if (options.region) resolved.grid.region = resolveRegion(*options.region, resolved);

    MpuSettings& fit = resolved.fit;
    fit.voxelSize = h;
    fit.points = resolved.points;
    fit.interpolate = options.interpolate;
    fit.alpha = options.alpha.value_or(fit.interpolate ? kInterpolationAlpha : fit.alpha);
    fit.sharp = options.sharp && !fit.interpolate;
    if (options.tolerance) {
        fit.tolerance = options.tolerance->resolve(h, resolved.diagonal);
        requireSmaller(fit.tolerance, resolved);
    } else {
        fit.tolerance = kToleranceVoxels * h;
        fit.noise = resolved.points.noise;
        fit.normalNoise = resolved.points.normalNoise;
    }
    fit.minPoints = options.minPoints.value_or(MpuSettings{}.minPoints);
    return resolved;
}

PreparedPoints preparePoints(PointInput&& points, const ReconstructOptions& options,
                             Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (points.cloud.empty()) throw InputError("no points: the input is empty");
    PreparedPoints prepared;
    PointCloud& cloud = prepared.cloud;
    ReconstructReport& report = prepared.report;
    cloud = std::move(points.cloud);
    prepared.options = options;
    report.dropped = std::move(points.dropped);
    report.notes = std::move(points.notes);
    report.warnings = std::move(points.warnings);
    keepNamed(cloud, options.attributes);
    if (options.clean) {
        report.cleaned = clean(cloud, *options.clean, &progress);
        if (report.cleaned.outliers > 0) report.dropped["outlier"] += report.cleaned.outliers;
    } else {
        progress.beginStage("measure");
        report.cleaned.statistics = measure(cloud, &progress);
        cloud.index.reset();
        progress.endStage();
    }
    report.points = cloud.size();
    report.settings = resolve(cloud, report.cleaned.statistics, options);
    return prepared;
}

FittedPoints fitPoints(PreparedPoints&& points, Interrupter* interrupter)
{
    FittedPoints fitted{nullptr, std::move(points.options), std::move(points.report)};
    fitted.field = std::make_shared<const MpuField>(std::move(points.cloud),
                                                    fitted.report.settings.fit, interrupter);
    fitted.report.fit = fitted.field->statistics();
    return fitted;
}

ReconstructResult sampleFit(const FittedPoints& fitted, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const MpuField& field = *fitted.field;
    const SampleSettings& settings = fitted.report.settings.grid;
    ReconstructResult result;
    result.field = fitted.field;
    result.report = fitted.report;
    const LevelSet levelSet = sampleField(field, settings, &progress);
    progress.beginStage("explain");
    result.report.explained = explain(levelSet, field, settings.region, &progress);
    progress.endStage();
    if (fitted.options.coverage) {
        progress.beginStage("spacing");
        const auto coverage = field.coverage(&progress);
        result.report.coverageSpacing = coverage->spacing();
        result.coverage = sampleCoverage(levelSet, *coverage, &progress);
    }
    if (!fitted.options.attributes.empty())
        result.attributes = sampleAttributes(
            levelSet, *field.attributes(fitted.options.attributes, &progress), &progress);
    // Nobody else holds the grid: the level set is made here, and goes now.
    result.grid = std::const_pointer_cast<openvdb::FloatGrid>(levelSet.gridPtr());
    return result;
}

LevelSet ReconstructResult::levelSet() const
{
    auto explained = std::make_shared<Explained>();
    explained->by = report.explained;
    return LevelSet(grid, std::move(explained));
}

ReconstructResult reconstruct(PointInput&& points, const ReconstructOptions& options,
                              Interrupter* interrupter)
{
    PreparedPoints prepared = preparePoints(std::move(points), options, interrupter);
    requireMemory(prepared, false, 0, interrupter);
    return sampleFit(fitPoints(std::move(prepared), interrupter), interrupter);
}

ReconstructResult reconstruct(const PointView& points, const ReconstructOptions& options,
                              Interrupter* interrupter)
{
    return reconstruct(importPoints(points, "points", options.badPoints, interrupter), options,
                       interrupter);
}

} // namespace mpuvdb
