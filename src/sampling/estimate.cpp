// What a reconstruction takes, told by a small one.
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

constexpr double kTrialPoints = 1e5;
constexpr double kTrialVoxels = 96; ///< along the longest side

/// While the band is searched and closed: samples beyond it, their order, what surrounds each.
constexpr double kBandShare = 1.5;

/// Nodes of edge @a dim that a band of @a thickness about a surface of area 1 meets, if it looks in
/// all directions: lengths in voxels. A node meets it from dim - 1 on, between voxels' centers.
double nodesPerArea(double dim, double thickness)
{
    return (1.5 * (dim - 1) + thickness) / (dim * dim * dim);
}

/// Memory of the tree whose band is of @a thickness about a surface of @a area: lengths in voxels.
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

/// The surface as larger voxels show it.
struct Trial {
    double voxelSize = 0;
    double area = 0;       ///< world units squared
    double voxelShare = 1; ///< active voxels, of those of a flat band of the same area
};

/// About kTrialPoints of the points, whatever pattern their order has.
PointCloud everySoManyth(const PointCloud& cloud)
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

Trial tryWithLargerVoxels(const PointCloud& cloud, const ResolvedSettings& resolved,
                          Interrupter& progress)
{
    PointCloud some = everySoManyth(cloud);
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
    if (!(area > 0)) return trial; // too thin for such voxels: what the points say has to do
    trial.area = area;
    const double voxels = area / (trial.voxelSize * trial.voxelSize);
    trial.voxelShare =
        double(levelSet.grid().activeVoxelCount()) / (2 * kMeasuredHalfWidth * voxels);
    return trial;
}

/// Share of the points that lie in @a region, grown by @a margin: about that of the surface.
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
    const Trial trial = tryWithLargerVoxels(cloud, resolved, progress);
    estimate.area = trial.area;
    const double h = resolved.grid.lattice.voxelSize, width = resolved.grid.halfWidth;
    const double voxels = trial.area / (h * h);
    // What bends, and what is near to itself, has fewer voxels in its band, the thinner the more.
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
