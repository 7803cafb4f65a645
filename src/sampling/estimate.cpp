// Estimate of a reconstruction's memory and size, from a coarse trial.
#include "surface/surface_integrals.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/reconstruct.h>

#include <algorithm>
#include <cmath>

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
    double voxelSize = 0;  ///< world units
    double area = 0;       ///< world units squared
    double voxelShare = 1; ///< active voxels, relative to those of a flat band of the same area
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
    const LevelSet levelSet = sampleField(field, grid, &progress);
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

} // namespace

ReconstructionEstimate estimate(const PointCloud& cloud, const ReconstructSettings& settings,
                                Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    ReconstructionEstimate estimate;
    const ResolvedSettings& resolved = estimate.settings = resolve(cloud, settings, &progress);
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
    const double sampled = treeBytes(sampledShare * voxels, 2 * width);
    estimate.peakBytes =
        std::max(estimate.fit.peakBytes, estimate.fit.bytes + std::uint64_t(kBandShare * sampled));
    progress.endStage();
    return estimate;
}

} // namespace mpuvdb
