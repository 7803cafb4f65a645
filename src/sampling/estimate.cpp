// Estimate of a reconstruction's memory and size, from a coarse trial.
#include "band.h"
#include "core/cpu_time.h"
#include "grid/band_bytes.h"
#include "resolve.h"
#include "surface/surface_integrals.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/memory.h>
#include <mpuvdb/reconstruct.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr double kTrialPoints = 1e5; ///< points of the trial [tuned: estimate_test]
constexpr double kTrialVoxels = 96;  ///< along the longest side [tuned: estimate_test]

/// Memory while the band is searched and closed, relative to that of its tree: blocks beyond it,
/// and the index. [tuned: estimate_test]
constexpr double kBandShare = 1.5;

/// Number of nodes of edge @a dim that a band of @a thickness meets per area of a surface with
/// evenly distributed normals; lengths in voxels. A node is dim - 1 wide between voxels' centers.
double nodesPerArea(double dim, double thickness)
{
    return (1.5 * (dim - 1) + thickness) / (dim * dim * dim);
}

/// Memory, bytes, of a tree with a band of @a thickness about a surface of @a area; in voxels.
double treeBytes(double area, double thickness)
{
    using Tree = openvdb::FloatTree;
    using Leaf = Tree::LeafNodeType;
    using Lower = Tree::RootNodeType::ChildNodeType::ChildNodeType;
    using Upper = Tree::RootNodeType::ChildNodeType;
    const auto nodes = [&](double dim) { return area * nodesPerArea(dim, thickness); };
    return nodes(Leaf::DIM) * (sizeof(Leaf) + Leaf::SIZE * sizeof(float)) +
           nodes(Lower::DIM) * sizeof(Lower) + std::ceil(nodes(Upper::DIM)) * sizeof(Upper);
}

/// Result of a reconstruction with larger voxels.
struct Trial {
    double voxelSize = 0;    ///< world units
    double area = 0;         ///< world units squared
    double voxelShare = 1;   ///< active voxels, relative to those of a flat band of the same area
    double voxelSeconds = 0; ///< of processor time, for an active voxel
};

/// About kTrialPoints of the points, independent of patterns in their order.
PointCloud subsample(const PointCloud& cloud)
{
    const double share = std::min(1.0, kTrialPoints / double(cloud.size()));
    const double golden = 0.5 * (std::sqrt(5.0) - 1);
    PointCloud some;
    some.frame = cloud.frame;
    for (std::size_t n = 0; n < cloud.size(); ++n) {
        const double turn = golden * double(n);
        if (turn - std::floor(turn) >= share) continue;
        some.positions.push_back(cloud.positions[n]);
        some.normals.push_back(cloud.normals[n]);
        if (!cloud.confidence.empty()) some.confidence.push_back(cloud.confidence[n]);
    }
    return some;
}

Trial coarseTrial(const PointCloud& cloud, const ResolvedSettings& resolved, Interrupter& progress)
{
    PointCloud some = subsample(cloud);
    const double sparser = std::sqrt(double(cloud.size()) / double(some.size()));
    const double fine = resolved.grid.lattice.voxelSize;
    Trial trial;
    trial.voxelSize = std::max(
        {fine, resolved.points.spacing * sparser, resolved.boxSize.maxCoeff() / kTrialVoxels});
    trial.area = double(cloud.size()) * resolved.points.areaPerPoint();

    MpuSettings fit = resolved.fit;
    fit.interpolate = false;
    fit.alpha = MpuSettings{}.alpha;
    fit.voxelSize = trial.voxelSize;
    fit.tolerance *= trial.voxelSize / fine;
    SampleSettings grid = resolved.grid;
    grid.lattice = latticeFor(cloud.localBounds().translated(cloud.frame), trial.voxelSize);
    grid.halfWidth = kMeasuredHalfWidth;
    grid.mayBeEmpty = true;
    grid.region.reset();
    const MpuField field(std::move(some), fit, &progress);
    const double start = processCpuSeconds();
    const LevelSet levelSet = sampleField(field, grid, &progress);
    trial.voxelSeconds = (processCpuSeconds() - start) /
                         double(std::max<std::uint64_t>(levelSet.grid().activeVoxelCount(), 1));
    const double area = integrateSurface(levelSet, progress).area;
    if (!(area > 0)) return trial; // too thin for such voxels: the area is that of the points
    trial.area = area;
    const double voxels = area / (trial.voxelSize * trial.voxelSize);
    trial.voxelShare =
        double(levelSet.grid().activeVoxelCount()) / (2 * kMeasuredHalfWidth * voxels);
    return trial;
}

/// Share of the points in @a region grown by @a margin (world units), which approximates that of
/// the surface.
double shareIn(const Box3d& region, double margin, const PointCloud& cloud)
{
    const Vec3d grown = Vec3d::Constant(margin);
    const Box3d box(region.min() - cloud.frame - grown, region.max() - cloud.frame + grown);
    const auto inside =
        std::count_if(cloud.positions.begin(), cloud.positions.end(),
                      [&](const Vec3f& p) { return box.contains(p.cast<double>()); });
    return double(inside) / double(cloud.size());
}

/// Memory of the libraries and of the threads' scratch, bytes. [tuned: estimate_test]
constexpr std::uint64_t kWorkingBytes = 12 << 20;
/// Size of the .vdb file per active voxel, and of the coverage in it, bytes. [tuned: estimate_test]
constexpr double kFileBytes = 4.6, kCoverageFileBytes = 1.15;
/// Triangles per square of a voxel's edge on the surface, and bytes while they are made.
/// [tuned: estimate_test]
constexpr double kTriangles = 2.96, kMeshBytes = 218;
/// Bytes per point while coverage is prepared, and after. [tuned: estimate_test]
constexpr std::uint64_t kCoveragePointBytes = 56, kCoverageKeptBytes = 12;

/// The estimate of field and level set. @param resolved  settings with the voxels in question.
ReconstructionEstimate estimateLevelSet(const PointCloud& cloud, const ResolvedSettings& resolved,
                                        Interrupter& progress)
{
    ReconstructionEstimate estimate;
    estimate.settings = resolved;
    estimate.fit = estimateFit(cloud, resolved.fit, &progress);
    const Trial trial = coarseTrial(cloud, resolved, progress);
    estimate.area = trial.area;
    const double h = resolved.grid.lattice.voxelSize, width = resolved.grid.halfWidth;
    const double voxels = trial.area / (h * h);
    // Curvature and nearby sheets change the number of voxels, in proportion to the band's width.
    const double bent = (trial.voxelShare - 1) * (width / kMeasuredHalfWidth) * h / trial.voxelSize;
    double share = 1, sampledShare = 1;
    if (const auto& region = resolved.grid.region) {
        share = shareIn(*region, 0, cloud);
        sampledShare = shareIn(*region, kRegionMargin * h, cloud);
    }
    estimate.activeVoxels = std::uint64_t(2 * width * voxels * share * std::max(1 + bent, 0.1));
    estimate.gridBytes = std::uint64_t(treeBytes(share * voxels, 2 * width));
    const double sampledWidth = std::min(width, kMaxNearBand);
    const double sampled = treeBytes(sampledShare * voxels, 2 * sampledWidth);
    double work = kBandShare * sampled;
    if (width > sampledWidth) // what is sampled, the way to the distances, and the band
        work = std::max(work, sampled + distanceBytes(sampledShare * trial.area, h) +
                                  double(estimate.gridBytes));
    estimate.bandBytes = std::uint64_t(work);
    estimate.peakBytes = std::max(estimate.fit.peakBytes, estimate.fit.bytes + estimate.bandBytes);
    estimate.fitSeconds = estimate.fit.cpuSeconds;
    estimate.sampleSeconds = trial.voxelSeconds * double(estimate.activeVoxels);
    progress.endStage();
    return estimate;
}

/// Adds coverage, a mesh, and the file.
void addExtras(ReconstructionEstimate& estimate, std::uint64_t points, bool withCoverage,
               bool withMesh)
{
    const double h = estimate.settings.grid.lattice.voxelSize, squares = estimate.area / (h * h);
    const std::uint64_t grid = estimate.gridBytes;
    std::uint64_t held = estimate.fit.bytes + grid;
    std::uint64_t& peak = estimate.peakBytes;
    double fileBytes = kFileBytes;
    if (withCoverage) {
        peak = std::max(peak, held + std::max(kCoveragePointBytes * points,
                                              kCoverageKeptBytes * points + grid));
        held += grid;
        fileBytes += kCoverageFileBytes;
    }
    estimate.fileBytes = std::uint64_t(fileBytes * double(estimate.activeVoxels));
    estimate.triangles = std::uint64_t(kTriangles * squares);
    if (withMesh) peak = std::max(peak, held + std::uint64_t(kMeshBytes * squares));
    peak += kWorkingBytes;
}

ReconstructionEstimate estimateWith(const PreparedPoints& points, const ResolvedSettings& resolved,
                                    bool withMesh, Interrupter& progress)
{
    ReconstructionEstimate estimate = estimateLevelSet(points.cloud, resolved, progress);
    addExtras(estimate, points.cloud.size(), points.options.coverage, withMesh);
    return estimate;
}

/// Bytes by the number of points and their spacing alone; holes and uneven sampling make it more.
double roughBytes(const PreparedPoints& points)
{
    /// Bytes per point, and per square of a voxel's edge. [tuned: estimate_test]
    constexpr double kPointBytes = 200, kSquareBytes = 400;
    const ResolvedSettings& resolved = points.report.settings;
    const double count = double(points.cloud.size());
    const double squares = count * resolved.points.areaPerPoint() /
                           std::pow(resolved.grid.lattice.voxelSize, 2) * resolved.grid.halfWidth /
                           3;
    return count * kPointBytes + squares * kSquareBytes;
}

/// A voxel size with which the work takes no more than @a maxBytes, which may be below 0, if there
/// is one.
std::optional<double> fittingVoxelSize(const PreparedPoints& points,
                                       const ReconstructionEstimate& tooLarge, bool withMesh,
                                       double maxBytes, Interrupter& progress)
{
    /// Share of the limit that an estimate may come to. [tuned: estimate_test]
    constexpr double kRoom = 0.95;
    /// Voxels along the longest side below which no size is proposed. [derived: twice the smallest
    /// number that --voxels takes]
    constexpr double kMinVoxels = 8;
    if (!(maxBytes > 0)) return {};
    ReconstructOptions options = points.options;
    options.voxels.reset();
    double h = tooLarge.settings.grid.lattice.voxelSize;
    for (double need = double(tooLarge.peakBytes), before = 2 * need; need > kRoom * maxBytes;) {
        // What no voxels change is too much already.
        constexpr double kLeastGain = 0.98; ///< of the last estimate [derived: it has two digits]
        if (need > kLeastGain * std::exchange(before, need)) return {};
        h *= std::clamp(std::sqrt(need / (kRoom * maxBytes)), 1.05, 4.0);
        const double digit = std::pow(10, std::floor(std::log10(h)) - 2);
        h = std::ceil(h / digit) * digit; // as it will be written
        if (h * kMinVoxels > tooLarge.settings.boxSize.maxCoeff()) return {};
        options.voxelSize = Length{h, Length::Unit::World};
        const ResolvedSettings resolved =
            resolve(points.cloud, points.report.cleaned.statistics, options);
        need = double(estimateWith(points, resolved, withMesh, progress).peakBytes);
    }
    return h;
}

} // namespace

ReconstructionEstimate estimate(const PreparedPoints& points, bool withMesh,
                                Interrupter* interrupter)
{
    return estimateWith(points, points.report.settings, withMesh, orSilent(interrupter));
}

std::optional<ReconstructionEstimate> beyondMemory(const PreparedPoints& points, bool withMesh,
                                                   std::uint64_t heldBytes,
                                                   Interrupter* interrupter)
{
    if (!points.options.maxBytes) return {};
    /// Factor from a rough guess to what may come. [tuned: estimate_test]
    constexpr double kSafety = 6;
    const std::uint64_t maxBytes = *points.options.maxBytes;
    if (double(heldBytes + kWorkingBytes) + kSafety * roughBytes(points) < double(maxBytes))
        return {};
    ReconstructionEstimate run = estimate(points, withMesh, interrupter);
    if (heldBytes + run.peakBytes <= maxBytes) return {};
    return run;
}

void requireMemory(const PreparedPoints& points, bool withMesh, std::uint64_t heldBytes,
                   Interrupter* interrupter)
{
    const auto beyond = beyondMemory(points, withMesh, heldBytes, interrupter);
    if (!beyond) return;
    const ReconstructionEstimate& run = *beyond;
    const std::uint64_t maxBytes = *points.options.maxBytes, peakBytes = heldBytes + run.peakBytes;
    Interrupter& progress = orSilent(interrupter);
    const std::optional<double> fitting =
        fittingVoxelSize(points, run, withMesh, double(maxBytes) - double(heldBytes), progress);
    throw LimitError(fmt::format(
        "voxels of size {:.4g} would take about {} of memory, and the limit is {}: {}",
        run.settings.grid.lattice.voxelSize, sizeText(peakBytes), sizeText(maxBytes),
        fitting ? fmt::format("--voxel-size {:.3g} would fit, or raise --max-memory", *fitting)
                : "no voxel size makes so many points fit; raise --max-memory"));
}

} // namespace mpuvdb
