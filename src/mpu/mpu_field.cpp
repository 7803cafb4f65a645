#include <mpuvdb/mpu_field.h>

#include "mpu/evidence/data_coverage.h"
#include "mpu/evidence/point_attributes.h"
#include "mpu/fill/coarse_sign.h"
#include "mpu/octree/octree.h"
#include "mpu/octree/sorted_points.h"
#include "mpu/sample/leaf_finder.h"
#include "mpu/sample/mpu_block_sampler.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Distance below which interpolation's weights stop growing, in radii. [derived: at a point all
/// other fits together weigh less than a rounding error]
constexpr double kMinDistanceRatio = 1e-12;

/// Difference of a leaf's value and the coarse field's from which a leaf on the other side fades,
/// in steps of the coarse field, which bridges unseen walls of cavities and bores.
/// [tuned: unseen_bench]
constexpr double kMaxSignDisagreement = 1.5;

/// Difference from which a leaf on the same side fades that finds the surface farther away, in
/// steps. [tuned: hollows_test]
constexpr double kMaxOvershoot = 0.5;

/// Distance from the surface up to which no leaf fades, in steps. [derived: where both differences
/// allow it whatever the coarse field says]
constexpr double kMinVetoDistance = std::min(kMaxOvershoot, (kMaxSignDisagreement - 1));

/// Inconsistency of @a value, a leaf's distance at its center, with the coarse field's @a other
/// there, in steps: the leaf fades from 0 to 1.
double disagreement(double value, const CoarseSample& other)
{
    const double own = std::abs(value), step = other.step;
    // A leaf without points continues those beside it, and ignores a surface that closes a hole
    // between.
    if ((value < 0) == (other.value < 0))
        return (std::min(own, other.maxDistance()) - std::abs(other.value)) / step - kMaxOvershoot;
    // Data are about as far as the leaf says: beyond, the coarse field means nothing.
    const double believed = std::min(std::abs(other.value), std::max(own, step));
    return (own + believed) / step - kMaxSignDisagreement;
}

/// A smooth step: 1 up to t = 0, 0 from t = 1 on.
double smoothFall(double t)
{
    const double x = std::clamp(t, 0.0, 1.0);
    return 1 - x * x * (3 - 2 * x);
}

/// The cells of the leaves that their data do not support.
Unseen unseenIn(Octree& tree, double voxelSize)
{
    Unseen unseen;
    unseen.voxelSize = voxelSize;
    tree.forEachLeaf([&](const OctreeNode& node, const OctreeCell& cell) {
        if (node.support < 1) unseen.cells.push_back(cell);
    });
    return unseen;
}

/// Reduce the support of leaves whose distance at the center is inconsistent with the coarse field.
void vetoLeaves(Octree& tree, const CoarseSign& coarse)
{
    tree.forEachLeafParallel([&](OctreeNode& node, const OctreeCell& cell) {
        if (node.support <= 0) return;
        const Vec3d center = tree.root.center(cell);
        const StoredFit& stored = tree.fits[node.index];
        if (tree.holdsItsPoint(cell, stored)) return;
        const Vec3d y = center - stored.origin.cast<double>();
        const Quadric q = tree.rulingAt(stored, y);
        const double value = q.value(y) / std::max(q.gradient(y).norm(), kGradientFloor);
        if (std::abs(value) <= kMinVetoDistance * coarse.stepAt(center)) return;
        node.support *= float(smoothFall(disagreement(value, coarse.evaluate(center))));
    });
}

} // namespace

struct MpuField::Impl {
    MpuSettings settings;
    std::shared_ptr<const VertexMesh> mesh;
    Vec3d frame;
    Box3d localBounds;
    std::unique_ptr<SortedPoints> points;
    Octree tree;
    std::unique_ptr<const CoarseSign> coarse; ///< null if the tree is complete

    /// Sums over the leaves whose balls hold a place.
    struct Blend {
        double weight = 0, supported = 0;
        FieldSample sample;
    };
    void add(OctreeNode leaf, const OctreeCell& cell, const Vec3d& p, Blend& sums) const;
    FieldSample finish(const Blend& sums, const Vec3d& p) const;
    double weight(const Vec3d& p, const OctreeCell& cell, const StoredFit& fit) const;
};

MpuField::MpuField(PointCloud&& cloud, const MpuSettings& given, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    checkSettings(cloud, given);
    MpuSettings settings = given;
    settings.sharp &= !settings.interpolate;
    auto impl = std::make_unique<Impl>();
    impl->settings = settings;
    impl->mesh = cloud.mesh;
    impl->frame = cloud.frame;
    impl->localBounds = cloud.localBounds();
    const RootCube root = rootCube(impl->localBounds, settings.voxelSize);
    progress.beginStage("sort");
    const auto copies =
        settings.interpolate ? SortedPoints::Copies::Merge : SortedPoints::Copies::Keep;
    impl->points = std::make_unique<SortedPoints>(std::move(cloud), root, progress, copies);
    progress.beginStage("fit");
    impl->tree = buildOctree(*impl->points, root, settings, progress);
    if (!impl->tree.complete) {
        progress.beginStage("sign");
        impl->coarse =
            std::make_unique<CoarseSign>(*impl->points, impl->localBounds, root, settings.noise,
                                         unseenIn(impl->tree, settings.voxelSize), progress);
        vetoLeaves(impl->tree, *impl->coarse);
    }
    impl->tree.statistics.bytes =
        impl->tree.bytes() + impl->points->bytes() + (impl->coarse ? impl->coarse->bytes() : 0);
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

void MpuField::Impl::add(OctreeNode leaf, const OctreeCell& cell, const Vec3d& p, Blend& sums) const
{
    const StoredFit& stored = tree.fits[leaf.index];
    const double w = weight(p, cell, stored);
    if (!(w > 0)) return;
    const Vec3d y = p - stored.origin.cast<double>();
    const Quadric q = tree.rulingAt(stored, y);
    sums.weight += w;
    sums.supported += w * double(leaf.support);
    sums.sample.value += w * q.value(y);
    sums.sample.gradient += w * q.gradient(y);
    sums.sample.level = std::max(sums.sample.level, cell.level);
}

double MpuField::Impl::weight(const Vec3d& p, const OctreeCell& cell, const StoredFit& fit) const
{
    const double radius = tree.supportRadius(cell.level);
    const double distance = (p - tree.ballCenter(cell, fit)).norm();
    if (!tree.interpolates()) return bsplineWeight(1.5 * distance / radius);
    return singularWeight(1 / std::max(distance, kMinDistanceRatio * radius), 1 / radius);
}

/// The sample at @a p from the sums there.
FieldSample MpuField::Impl::finish(const Blend& sums, const Vec3d& p) const
{
    FieldSample sample = sums.sample;
    const double support = sums.weight > 0 ? sums.supported / sums.weight : 0;
    if (sums.weight > 0) {
        const double slope = std::max(sample.gradient.norm() / sums.weight, kGradientFloor);
        sample.value /= sums.weight * slope;
        sample.gradient /= sums.weight * slope;
    } else if (!coarse) { // beyond the root cube: outside
        sample.value = std::sqrt(localBounds.squaredExteriorDistance(p));
        sample.gradient = (p - localBounds.center()).normalized();
        return sample;
    }
    if (coarse && support < 1) {
        const CoarseSample other = coarse->evaluate(p);
        const double far = other.maxDistance();
        sample.value = support * std::clamp(sample.value, -far, far) + (1 - support) * other.value;
        sample.gradient = support * sample.gradient + (1 - support) * other.gradient;
    }
    sample.supported = support > 0.5;
    return sample;
}

FieldSample MpuField::evaluate(const Vec3d& position) const
{
    const Vec3d p = position - mImpl->frame;
    Impl::Blend sums;
    const auto add = [&](OctreeNode leaf, const OctreeCell& cell) {
        mImpl->add(leaf, cell, p, sums);
    };
    mImpl->tree.forEachLeafAt(p, add, mImpl->tree.nodes[0], {});
    return mImpl->finish(sums, p);
}

class MpuField::Evaluator final : public PointEvaluator
{
public:
    Evaluator(const Impl& field, double spacing) : mField(field), mLeaves(field.tree, spacing) {}
    FieldSample evaluate(const Vec3d& position) override
    {
        const Vec3d p = position - mField.frame;
        Impl::Blend sums;
        for (const LeafAt& leaf : mLeaves.find(p)) mField.add(leaf.node, leaf.cell, p, sums);
        return mField.finish(sums, p);
    }

private:
    const Impl& mField;
    PointLeafFinder mLeaves;
};

std::unique_ptr<PointEvaluator> MpuField::evaluator(double spacing) const
{
    return std::make_unique<Evaluator>(*mImpl, spacing);
}

std::vector<Vec3i> MpuField::seedBlocks(const Lattice& lattice) const
{
    using Block = std::array<int, 3>;
    constexpr std::size_t kChunk = 1 << 14; ///< points of a task [free: grain]
    const PointBatch& points = mImpl->points->points();
    const Vec3d shift = (mImpl->frame - lattice.origin) / lattice.voxelSize;
    const double scale = 1 / lattice.voxelSize;
    const auto blockAt = [&](float x, int axis) {
        const double voxel = std::floor(double(x) * scale + shift[axis] + 0.5);
        return int(std::floor(voxel * (1.0 / kBlockDim)));
    };
    const auto sortUnique = [](std::vector<Block>& blocks) {
        std::sort(blocks.begin(), blocks.end());
        blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    };
    std::vector<std::vector<Block>> chunks((points.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), chunks.size(), [&](std::size_t c) {
        std::vector<Block>& blocks = chunks[c];
        const std::size_t end = std::min((c + 1) * kChunk, points.size());
        for (std::size_t i = c * kChunk; i < end; ++i) {
            const Block block = {blockAt(points.x[i], 0), blockAt(points.y[i], 1),
                                 blockAt(points.z[i], 2)};
            if (blocks.empty() || block != blocks.back()) blocks.push_back(block);
        }
        sortUnique(blocks);
    });
    std::vector<Block> all;
    for (const auto& blocks : chunks) all.insert(all.end(), blocks.begin(), blocks.end());
    sortUnique(all);
    std::vector<Vec3i> result(all.size());
    for (std::size_t n = 0; n < all.size(); ++n) result[n] = Vec3i(all[n][0], all[n][1], all[n][2]);
    return result;
}

std::size_t MpuField::countData(const Box3d& box, std::size_t limit) const
{
    return mImpl->points->countIn(box.translated(-mImpl->frame), limit);
}

const MpuSettings& MpuField::settings() const
{
    return mImpl->settings;
}

FieldPoints MpuField::points() const
{
    const PointBatch& p = mImpl->points->points();
    return {mImpl->frame, p.x.data(),  p.y.data(), p.z.data(), p.nx.data(),
            p.ny.data(),  p.nz.data(), p.size(),   mImpl->mesh};
}

std::unique_ptr<const Coverage> MpuField::coverage(Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    return std::make_unique<DataCoverage>(*mImpl->points, mImpl->frame, progress);
}

std::unique_ptr<const SurfaceAttributes>
MpuField::attributes(const std::vector<std::string>& names) const
{
    return std::make_unique<PointAttributes>(*mImpl->points, mImpl->frame, names);
}

std::unique_ptr<BlockSampler> MpuField::sampler(const Lattice& lattice, double band) const
{
    return std::make_unique<MpuBlockSampler>(
        mImpl->tree, mImpl->coarse.get(), lattice.origin - mImpl->frame, lattice.voxelSize, band);
}

} // namespace mpuvdb
