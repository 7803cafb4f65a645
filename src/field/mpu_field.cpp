#include <mpuvdb/mpu_field.h>

#include "mpu_block_sampler.h"
#include "octree.h"
#include "sorted_points.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <algorithm>
#include <fmt/format.h>
#include <tbb/parallel_sort.h>

namespace mpuvdb {
namespace {

constexpr double kGradientFloor = 0.8;

void checkSettings(const PointCloud& cloud, const MpuSettings& s)
{
    if (cloud.empty()) throw InputError("no points to fit: the input is empty");
    if (!cloud.hasNormals())
        throw InputError("the points have no normals: estimate them first (estimateNormals, or "
                         "--normals estimate)");
    const auto demand = [](bool ok, const char* what, double value, const char* range) {
        if (!ok) throw UsageError(fmt::format("{} is {}; it must be {}", what, value, range));
    };
    demand(s.tolerance > 0 && std::isfinite(s.tolerance), "tolerance", s.tolerance, "above 0");
    demand(s.voxelSize > 0 && std::isfinite(s.voxelSize), "voxel size", s.voxelSize, "above 0");
    demand(s.alpha >= 0.6 && s.alpha <= 2, "alpha", s.alpha, "in [0.6, 2]");
    demand(s.minPoints >= 6 && s.minPoints <= 1000, "min points", s.minPoints, "in [6, 1000]");
}

/// A cube about the points with room for the band and the fits' balls.
RootCube rootCube(const Box3d& bounds, double voxelSize)
{
    const double side = 1.5 * bounds.sizes().maxCoeff() + 16 * voxelSize;
    return {bounds.center() - Vec3d::Constant(side / 2), side};
}

} // namespace

struct MpuField::Impl {
    Vec3d frame;
    Box3d localBounds;
    std::unique_ptr<SortedPoints> points;
    Octree tree;

    void blend(const Vec3d& p, std::uint32_t index, const OctreeCell& cell, FieldSample& sample,
               double& weight, double& supportedWeight) const;
};

MpuField::MpuField(PointCloud&& cloud, const MpuSettings& settings, Progress& progress)
{
    checkSettings(cloud, settings);
    auto impl = std::make_unique<Impl>();
    impl->frame = cloud.frame;
    impl->localBounds = cloud.localBounds();
    const RootCube root = rootCube(impl->localBounds, settings.voxelSize);
    progress.beginStage("sort");
    impl->points = std::make_unique<SortedPoints>(std::move(cloud), root, progress);
    impl->tree = buildOctree(*impl->points, root, settings, progress);
    impl->tree.statistics.bytes = impl->tree.bytes() + impl->points->bytes();
    progress.endStage();
    mImpl = std::move(impl);
}

MpuField::~MpuField() = default;

const MpuStatistics& MpuField::statistics() const
{
    return mImpl->tree.statistics;
}

Box3d MpuField::bounds() const
{
    return mImpl->localBounds.translated(mImpl->frame);
}

void MpuField::Impl::blend(const Vec3d& p, std::uint32_t index, const OctreeCell& cell,
                           FieldSample& sample, double& weight, double& supportedWeight) const
{
    const double radius = tree.supportRadius(cell.level);
    const double distance = (p - tree.root.centre(cell)).norm();
    if (!(distance < radius)) return;
    const OctreeNode& node = tree.nodes[index];
    if (node.firstChild != OctreeNode::kNone) {
        for (int octant = 0; octant < 8; ++octant)
            blend(p, node.firstChild + std::uint32_t(octant), cell.child(octant), sample, weight,
                  supportedWeight);
        return;
    }
    if (node.fit == OctreeNode::kNone) return;
    const StoredFit& stored = tree.fits[node.fit];
    const Vec3d origin = stored.origin.cast<double>();
    const LocalFit fit = tree.fitAbout(stored, origin);
    const Quadric& q = fit.ruling(p - origin);
    const double w = bsplineWeight(1.5 * distance / radius);
    weight += w;
    if (stored.supported) supportedWeight += w;
    sample.value += w * q.value(p - origin);
    sample.gradient += w * q.gradient(p - origin);
    sample.level = std::max(sample.level, cell.level);
}

FieldSample MpuField::evaluate(const Vec3d& position) const
{
    FieldSample sample;
    double weight = 0, supported = 0;
    mImpl->blend(position - mImpl->frame, 0, {}, sample, weight, supported);
    if (!(weight > 0)) {
        sample.value = std::sqrt(mImpl->localBounds.squaredExteriorDistance(position - mImpl->frame));
        return sample;
    }
    const double slope = std::max(sample.gradient.norm() / weight, kGradientFloor);
    sample.value /= weight * slope;
    sample.gradient /= weight * slope;
    sample.supported = supported > 0.5 * weight;
    return sample;
}

std::vector<Vec3i> MpuField::seedBlocks(const Lattice& lattice) const
{
    const PointBatch& points = mImpl->points->points();
    const Vec3d shift = mImpl->frame - lattice.origin;
    std::vector<std::array<int, 3>> blocks;
    std::array<int, 3> last{};
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3d p = Vec3d(points.x[i], points.y[i], points.z[i]) + shift;
        std::array<int, 3> block;
        for (std::size_t k = 0; k < 3; ++k)
            block[k] = int(std::floor(std::round(p[int(k)] / lattice.voxelSize) / kBlockDim));
        if (blocks.empty() || block != last) blocks.push_back(block);
        last = block;
    }
    std::sort(blocks.begin(), blocks.end());
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    std::vector<Vec3i> result(blocks.size());
    for (std::size_t n = 0; n < blocks.size(); ++n)
        result[n] = Vec3i(blocks[n][0], blocks[n][1], blocks[n][2]);
    return result;
}

std::unique_ptr<BlockSampler> MpuField::sampler(const Lattice& lattice, double band) const
{
    return std::make_unique<MpuBlockSampler>(mImpl->tree, lattice.origin - mImpl->frame,
                                             lattice.voxelSize, band);
}

} // namespace mpuvdb
