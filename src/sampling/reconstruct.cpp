#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/reconstruct.h>

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// Without other word a fit may err by a tenth of a voxel, and by the noise.
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

double resolveVoxelSize(const ReconstructSettings& settings, const ResolvedSettings& resolved)
{
    const double longest = resolved.boxSize.maxCoeff();
    if (settings.voxelSize && settings.voxels)
        throw UsageError("give the voxel size or the number of voxels, not both");
    if (settings.voxels) {
        if (!(*settings.voxels >= 4 && *settings.voxels <= 100000))
            throw UsageError(fmt::format(
                "{} voxels along the longest side; it must be in [4, 100000]", *settings.voxels));
        return longest / *settings.voxels;
    }
    if (settings.voxelSize) {
        if (settings.voxelSize->unit == Length::Unit::Voxels)
            throw UsageError("a voxel size in voxels says nothing: give world units or %");
        const double h = settings.voxelSize->resolve(0, resolved.diagonal);
        if (!(h > 0)) throw UsageError(fmt::format("voxel size is {}; it must be above 0", h));
        return h;
    }
    return defaultVoxelSize(resolved.points);
}

/// @throws InputError if the vertices of a mesh are too far from most of its surface to show it.
void demandSupport(const VertexMesh& mesh, double spacing)
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
    if (box.isEmpty())
        throw UsageError("the region is empty: give the lower corner first, x0 y0 z0 x1 y1 z1");
    return box;
}

} // namespace

ResolvedSettings resolve(const PointCloud& cloud, const ReconstructSettings& settings,
                         Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (cloud.empty()) throw InputError("no points: the input is empty");
    ResolvedSettings resolved;
    if (!settings.points) progress.beginStage("measure");
    resolved.points = settings.points ? *settings.points : measure(cloud, &progress);
    progress.endStage();
    if (cloud.mesh) demandSupport(*cloud.mesh, resolved.points.spacing);
    const Box3d box = cloud.localBounds();
    resolved.boxSize = box.sizes();
    resolved.diagonal = resolved.boxSize.norm();
    const double h = resolveVoxelSize(settings, resolved);
    const double across = resolved.boxSize.maxCoeff() / h;
    if (!(across <= 4e6))
        throw LimitError(
            fmt::format("{:.3g} voxels of size {} along the longest side are beyond the "
                        "index range: use larger voxels",
                        across, h));
    resolved.grid.lattice = latticeFor(box.translated(cloud.frame), h);
    resolved.grid.halfWidth = settings.halfWidth;
    resolved.grid.maxBytes = settings.maxBytes;
    if (settings.region) resolved.grid.region = resolveRegion(*settings.region, resolved);

    MpuSettings& fit = resolved.fit;
    fit.voxelSize = h;
    fit.points = resolved.points;
    fit.interpolate = settings.interpolate;
    fit.alpha = settings.alpha.value_or(fit.interpolate ? kInterpolationAlpha : fit.alpha);
    fit.sharp = settings.sharp && !fit.interpolate;
    if (settings.tolerance) {
        fit.tolerance = settings.tolerance->resolve(h, resolved.diagonal);
    } else {
        fit.tolerance = kToleranceVoxels * h;
        fit.noise = resolved.points.noise;
        fit.normalNoise = resolved.points.normalNoise;
    }
    fit.minPoints = settings.minPoints.value_or(MpuSettings{}.minPoints);
    return resolved;
}

Reconstruction reconstruct(PointCloud&& cloud, const ReconstructSettings& settings,
                           Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const ResolvedSettings resolved = resolve(cloud, settings, &progress);
    auto field = std::make_shared<const MpuField>(std::move(cloud), resolved.fit, &progress);
    LevelSet levelSet = sampleField(*field, resolved.grid, &progress);
    progress.beginStage("explain");
    auto explained = std::make_shared<Explained>();
    explained->by = explain(levelSet, *field, resolved.grid.region, &progress);
    progress.endStage();
    return {LevelSet(levelSet.gridPtr(), std::move(explained)), std::move(field), resolved};
}

} // namespace mpuvdb
