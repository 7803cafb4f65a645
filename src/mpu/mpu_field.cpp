#include <mpuvdb/mpu_field.h>

#include "mpu/evidence/data_coverage.h"
#include "mpu/evidence/point_attributes.h"
#include "mpu/field_parts.h"
#include "mpu/fill/veto_leaves.h"
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

} // namespace

struct MpuField::Impl : FieldParts {
    explicit Impl(FieldParts&& parts) : FieldParts(std::move(parts)) {}

    /// Sums over the leaves whose balls hold a place.
    struct Blend {
        double weight = 0, supported = 0;
        FieldSample sample;
    };
    void add(OctreeNode leaf, const OctreeCell& cell, const Vec3d& p, Blend& sums) const;
    FieldSample finish(const Blend& sums, const Vec3d& p) const;
    double weight(const Vec3d& p, const OctreeCell& cell, const StoredFit& fit) const;
    std::vector<Vec3i> blocksOf(const std::vector<SortedPoints::Range>& ranges,
                                const Lattice& lattice) const;
};

MpuField::MpuField(PointCloud&& cloud, const MpuSettings& given, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    checkSettings(cloud, given);
    MpuSettings settings = given;
    settings.sharp &= !settings.interpolate;
    FieldParts parts;
    parts.settings = settings;
    parts.mesh = cloud.mesh;
    parts.frame = cloud.frame;
    parts.localBounds = cloud.localBounds();
    const RootCube root = rootCube(parts.localBounds, settings.voxelSize);
    progress.beginStage("sort");
    parts.points =
        std::make_unique<SortedPoints>(std::move(cloud), root, progress, copiesFor(settings));
    progress.beginStage("fit");
    OctreeDraft tree = buildOctree(*parts.points, root, settings, progress);
    if (!tree.complete) {
        progress.beginStage("sign");
        parts.coarse =
            std::make_unique<CoarseSign>(*parts.points, parts.localBounds, root, settings.noise,
                                         Unseen{unsupportedIn(tree), settings.voxelSize}, progress);
        vetoLeaves(tree, *parts.coarse);
    }
    parts.tree = Octree(std::move(tree));
    parts.tree.statistics.bytes =
        parts.tree.bytes() + parts.points->bytes() + (parts.coarse ? parts.coarse->bytes() : 0);
    progress.endStage();
    mImpl = std::make_unique<const Impl>(std::move(parts));
}

MpuField::MpuField(FieldParts&& parts) : mImpl(std::make_unique<const Impl>(std::move(parts))) {}

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
    return mImpl->blocksOf({{0, mImpl->points->size()}}, lattice);
}

std::vector<Vec3i> MpuField::seedBlocksIn(const Lattice& lattice, const Box3d& box) const
{
    return mImpl->blocksOf(mImpl->points->rangesIn(box.translated(-mImpl->frame)), lattice);
}

/// The blocks that hold the points of @a ranges, sorted, unique.
std::vector<Vec3i> MpuField::Impl::blocksOf(const std::vector<SortedPoints::Range>& ranges,
                                            const Lattice& lattice) const
{
    using Block = std::array<int, 3>;
    constexpr std::size_t kChunk = 1 << 14; ///< most points of a task [free: grain]
    const PointArrays& all = points->points();
    const Vec3d shift = (frame - lattice.origin) / lattice.voxelSize;
    const double scale = 1 / lattice.voxelSize;
    const auto blockAt = [&](float x, int axis) {
        const double voxel = std::floor(double(x) * scale + shift[axis] + 0.5);
        return int(std::floor(voxel * (1.0 / kBlockDim)));
    };
    const auto sortUnique = [](std::vector<Block>& blocks) {
        std::sort(blocks.begin(), blocks.end());
        blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
    };
    std::vector<SortedPoints::Range> tasks;
    for (const SortedPoints::Range& range : ranges)
        for (std::size_t at = range.begin; at < range.end; at += kChunk)
            tasks.push_back({at, std::min(at + kChunk, range.end)});
    std::vector<std::vector<Block>> found(tasks.size());
    tbb::parallel_for(std::size_t(0), tasks.size(), [&](std::size_t t) {
        std::vector<Block>& blocks = found[t];
        for (std::size_t i = tasks[t].begin; i < tasks[t].end; ++i) {
            const Block block = {blockAt(all.x[i], 0), blockAt(all.y[i], 1), blockAt(all.z[i], 2)};
            if (blocks.empty() || block != blocks.back()) blocks.push_back(block);
        }
        sortUnique(blocks);
    });
    std::vector<Block> blocks;
    for (const auto& some : found) blocks.insert(blocks.end(), some.begin(), some.end());
    sortUnique(blocks);
    std::vector<Vec3i> result(blocks.size());
    for (std::size_t n = 0; n < blocks.size(); ++n)
        result[n] = Vec3i(blocks[n][0], blocks[n][1], blocks[n][2]);
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
    const PointArrays& p = mImpl->points->points();
    return {mImpl->frame, p.x, p.y, p.z, p.nx, p.ny, p.nz, p.size(), mImpl->mesh};
}

std::vector<std::pair<std::size_t, std::size_t>> MpuField::pointsIn(const Box3d& box) const
{
    std::vector<std::pair<std::size_t, std::size_t>> ranges;
    for (const SortedPoints::Range& range : mImpl->points->rangesIn(box.translated(-mImpl->frame)))
        ranges.emplace_back(range.begin, range.end);
    return ranges;
}

std::unique_ptr<const Coverage> MpuField::coverage(Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    return std::make_unique<DataCoverage>(*mImpl->points, mImpl->frame, progress);
}

std::unique_ptr<const SurfaceAttributes> MpuField::attributes(const std::vector<std::string>& names,
                                                              Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    return std::make_unique<PointAttributes>(*mImpl->points, mImpl->frame, names, progress);
}

std::unique_ptr<BlockSampler> MpuField::sampler(const Lattice& lattice, double band) const
{
    return std::make_unique<MpuBlockSampler>(
        mImpl->tree, mImpl->coarse.get(), lattice.origin - mImpl->frame, lattice.voxelSize, band);
}

} // namespace mpuvdb
