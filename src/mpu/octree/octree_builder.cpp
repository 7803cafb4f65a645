// Construction of the octree: upper levels on samples of the points, then each subtree depth first
// on contiguous copies of its points, which shrink with every level.
#include "mpu/fit/cell_fitter.h"
#include "mpu/fit/point_fitter.h"
#include "octree.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <deque>
#include <memory>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Most points around the root cell of a subtree. [tuned: suite, time]
constexpr std::size_t kMaxSubtreePoints = 4096;
/// Most points of a ball whose spacing is measured. [tuned: suite, time]
constexpr std::size_t kMaxSpacingPoints = 256;

/// Largest ball of a cell that takes the nearest point's fit, in radii of that fit's ball; larger
/// cells are fitted to the tolerance. [tuned: interpolation_test]
constexpr double kMaxPointFitReach = 1.2;

void countLeaf(MpuStatistics& statistics, const OctreeCell& cell, const Decision& decision)
{
    ++statistics.leaves;
    statistics.levels = std::max(statistics.levels, cell.level);
    if (!decision.result.accepted || decision.result.needsSplit)
        ++statistics.overTolerance;
    else
        statistics.maxError = std::max(statistics.maxError, decision.result.error);
}

/// Make @a node a leaf with the fit decided for @a cell.
void storeLeaf(OctreeDraft& tree, std::uint32_t node, const OctreeCell& cell,
               const Decision& decision)
{
    const std::uint32_t fit = tree.addFit(decision.result.fit, tree.root.center(cell));
    tree.setLeaf(node, fit, decision.support);
    countLeaf(tree.statistics, cell, decision);
}

/// Builds one subtree depth first.
class SubtreeBuilder
{
public:
    SubtreeBuilder(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
                   const NoisyScan* scan, Interrupter& progress)
        : mPoints(points), mRoot(root), mSettings(settings), mProgress(progress),
          mFitter(points, root, settings, scan), mPointFitter(points, root, settings),
          mTree(OctreeShape(root, settings))
    {
    }

    /// @param spacing  estimated for the parent; 0 if unknown.
    OctreeDraft build(const OctreeCell& cell, double spacing)
    {
        mTree.nodes.assign(1, {});
        mTree.fits.clear();
        mTree.quadrics.clear();
        mTree.statistics = {};
        mTree.complete = true;
        mPointFitter.clear();
        mPath.clear();
        mFitter.forget();
        PointBatch& ball = batches(0)[0];
        mPoints.gather(mPoints.around(cell, mFitter.supportRadius(cell.level)), 1, mFilter, ball);
        if (ball.size() == 0)
            addEmpty(0, cell, nullptr, spacing > 0 ? spacing : mRoot.size(cell.level));
        else
            process(0, cell, ball, spacing, 0);
        return mTree; // a copy: it has no spare capacity, which the next subtree uses again
    }

private:
    using Octants = std::array<PointBatch, 8>;

    Octants& batches(std::size_t depth)
    {
        while (mBatches.size() <= depth) mBatches.emplace_back();
        return mBatches[depth];
    }

    void countEmpty(const OctreeCell& cell)
    {
        ++mTree.statistics.leaves;
        mTree.statistics.levels = std::max(mTree.statistics.levels, cell.level);
    }

    void addEmpty(std::uint32_t node, const OctreeCell& cell, const PointBatch* near,
                  double spacing)
    {
        countEmpty(cell);
        double support = 0;
        const LocalFit fit = near ? mFitter.fitEmpty(cell, *near, spacing, support)
                                  : mFitter.fitEmpty(cell, spacing, support);
        mTree.setLeaf(node, mTree.addFit(fit, mRoot.center(cell)), support);
    }

    void process(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball,
                 double parentSpacing, std::size_t depth)
    {
        if (depth < 3) mProgress.check();
        const double radius = mFitter.supportRadius(cell.level);
        double spacing = parentSpacing;
        if (ball.size() <= kMaxSpacingPoints && mSpacingDepth >= depth) {
            if (const double measured = mFilter.spacing(ball, mRoot.center(cell), radius);
                measured > 0)
                spacing = measured;
            else if (!(spacing > 0))
                spacing = radius;
            mSpacingDepth = depth;
        }
        if (!(spacing > 0)) spacing = radius / 8; // more than kMaxSpacingPoints in the ball
        if (mSettings.interpolate)
            decideInterpolating(node, cell, ball, spacing, depth);
        else
            decide(node, cell, ball, spacing, depth);
        if (mSpacingDepth == depth) mSpacingDepth = kNoDepth;
    }

    void decide(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball, double spacing,
                std::size_t depth)
    {
        const Decision decision = mFitter.decide(cell, ball, mPath, spacing);
        if (decision.split) {
            split(node, cell, ball, decision, spacing, depth);
            return;
        }
        storeLeaf(mTree, node, cell, decision);
    }

    /// decide() for interpolation: a leaf holds one point at most, through which its fit goes.
    void decideInterpolating(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball,
                             double spacing, std::size_t depth)
    {
        std::array<std::size_t, 2> inside;
        const std::size_t count = mPointFitter.pointsIn(cell, ball, inside);
        if (count > 1 && cell.level < Octree::kMaxLevel) {
            mProgress.check(); // crowded points make long descents
            Decision unfitted;
            unfitted.split = true;
            unfitted.fitted = false;
            split(node, cell, ball, unfitted, spacing, depth);
            return;
        }
        const Vec3d center = mRoot.center(cell);
        const double radius = mFitter.supportRadius(cell.level);
        const std::size_t point = count > 0 ? inside[0] : mFilter.nearestOf(ball, center);
        mPath.push_back({&ball, center, radius});
        const PointFitter::PointFit fit = mPointFitter.fitThrough(point, cell, mPath, mTree);
        mPath.pop_back();
        Decision decision;
        if (radius <= kMaxPointFitReach * fit.radius) {
            mTree.setLeaf(node, fit.index, 1);
            countLeaf(mTree.statistics, cell, decision);
            return;
        }
        decision = mFitter.decide(cell, ball, mPath, spacing);
        if (decision.split) {
            split(node, cell, ball, decision, spacing, depth);
            return;
        }
        if (count > 0) {
            // The parent's ball reaches as far around every point of the cell.
            const PointBatch& around = mPath.empty() ? ball : *mPath.back().batch;
            mTree.setLeaf(node, mPointFitter.fitWithin(ball, point, radius, around, mTree), 1);
        } else {
            mTree.setLeaf(node, mTree.addFit(decision.result.fit, center), decision.support);
        }
        countLeaf(mTree.statistics, cell, decision);
    }

    void split(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball,
               Decision decision, double spacing, std::size_t depth)
    {
        const double childRadius = mFitter.supportRadius(cell.level + 1);
        Octants& octants = batches(depth + 1);
        bool someEmpty = false;
        mFilter.octants(ball, mRoot.center(cell), mRoot.size(cell.level + 2), childRadius, octants);
        for (const PointBatch& child : octants) someEmpty |= child.size() == 0;
        if (someEmpty) mFitter.fitForChildren(decision, cell, ball, mPath);
        // Before the descendants are built the scratch memory still has the parent.
        const bool inherit =
            someEmpty && decision.fitted && mFitter.lastMayBeInherited(decision, cell, spacing);
        const std::uint32_t inherited =
            inherit ? mTree.addFit(decision.result.fit, mRoot.center(cell)) : 0;
        const auto first = std::uint32_t(mTree.nodes.size());
        mTree.nodes.resize(first + 8);
        mTree.nodes[node].index = first;
        mTree.statistics.cells += 8;
        for (int octant = 0; inherit && octant < 8; ++octant) {
            const OctreeCell child = cell.child(octant);
            if (octants[std::size_t(octant)].size() != 0) continue;
            mTree.setLeaf(first + std::uint32_t(octant), inherited,
                          mFitter.inheritedSupport(decision, cell, child, spacing));
            countEmpty(child);
        }
        mPath.push_back({&ball, mRoot.center(cell), mFitter.supportRadius(cell.level)});
        for (int octant = 0; octant < 8; ++octant) {
            const PointBatch& inside = octants[std::size_t(octant)];
            const std::uint32_t at = first + std::uint32_t(octant);
            if (inside.size() != 0)
                process(at, cell.child(octant), inside, spacing, depth + 1);
            else if (!inherit)
                addEmpty(at, cell.child(octant), &ball, spacing);
        }
        mPath.pop_back();
    }

    /// Depth that stands for none. [derived: the type's largest]
    static constexpr std::size_t kNoDepth = std::numeric_limits<std::size_t>::max();

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    Interrupter& mProgress;
    CellFitter mFitter;
    PointFitter mPointFitter;
    OctreeDraft mTree;
    BatchFilter mFilter;
    std::deque<Octants> mBatches; ///< by depth; stable addresses
    std::vector<Ball> mPath;
    std::size_t mSpacingDepth = kNoDepth; ///< depth at which the spacing was measured
};

/// A cell of the upper levels, whose ball holds too many points to copy.
struct UpperCell {
    OctreeCell cell;
    std::uint32_t node = 0;
    double spacing = 0; ///< estimated from the cell's sample; before that, its parent's
    bool subtree = false;
    std::unique_ptr<Decision> leaf; ///< null where the cell is split: few are leaves
};

class UpperBuilder
{
public:
    UpperBuilder(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
                 const NoisyScan* scan, Interrupter& progress)
        : mPoints(points), mRoot(root), mSettings(settings), mScan(scan), mProgress(progress)
    {
    }

    UpperOctree build()
    {
        UpperOctree upper;
        upper.tree = OctreeDraft(OctreeShape(mRoot, mSettings));
        upper.tree.nodes.resize(1);
        ++upper.tree.statistics.cells;
        std::vector<UpperCell> level(1);
        while (!level.empty()) {
            tbb::parallel_for(std::size_t(0), level.size(), [&](std::size_t n) {
                mProgress.check();
                decideUpper(level[n]);
            });
            level = nextLevel(upper.tree, level, upper.subtrees);
        }
        return upper;
    }

private:
    void decideUpper(UpperCell& upper) const
    {
        const OctreeCell& cell = upper.cell;
        CellFitter fitter(mPoints, mRoot, mSettings, mScan);
        const double radius = fitter.supportRadius(cell.level);
        const SortedPoints::Around around = mPoints.around(cell, radius);
        if (around.points <= kMaxSubtreePoints) {
            upper.subtree = true;
            return;
        }
        BatchFilter filter;
        PointBatch sample;
        std::size_t stride =
            mPoints.gather(around, around.points / (2 * kMinSampledPoints), filter, sample);
        while (sample.size() <= kSamplePoints) {
            if (sample.size() * stride <= kMaxSubtreePoints) { // few in the ball
                upper.subtree = true;
                return;
            }
            stride = std::max<std::size_t>(1, sample.size() * stride / (2 * kSamplePoints));
            stride = mPoints.gather(around, stride, filter, sample);
        }
        const double spacing = filter.spacing(sample, mRoot.center(cell), radius); // of the sample
        upper.spacing = spacing / std::sqrt(double(stride));
        if (mSettings.interpolate) {
            upper.subtree = cell.level == SortedPoints::kMaxLevel;
            return;
        }
        if (fitter.decide(cell, sample, {}, spacing).split) return;
        mPoints.gather(around, 1, filter, sample);
        Decision decision = fitter.decide(cell, sample, {}, spacing);
        if (!decision.split) upper.leaf = std::make_unique<Decision>(std::move(decision));
    }

    std::vector<UpperCell> nextLevel(OctreeDraft& tree, std::vector<UpperCell>& level,
                                     std::vector<SubtreeRoot>& subtrees) const
    {
        std::vector<UpperCell> next;
        for (UpperCell& upper : level) {
            if (upper.subtree) {
                subtrees.push_back({upper.cell, upper.node, upper.spacing});
                tree.nodes[upper.node] = {0, 0.0f}; // a leaf that says nothing, until then
            } else if (upper.leaf) {
                storeLeaf(tree, upper.node, upper.cell, *upper.leaf);
            } else {
                const auto first = std::uint32_t(tree.nodes.size());
                tree.nodes.resize(first + 8);
                tree.nodes[upper.node].index = first;
                tree.statistics.cells += 8;
                for (int octant = 0; octant < 8; ++octant) {
                    UpperCell child;
                    child.cell = upper.cell.child(octant);
                    child.node = first + std::uint32_t(octant);
                    child.spacing = upper.spacing;
                    next.push_back(std::move(child));
                }
            }
        }
        return next;
    }

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    const NoisyScan* mScan;
    Interrupter& mProgress;
};

} // namespace

UpperOctree buildUpper(const SortedPoints& points, const RootCube& root,
                       const MpuSettings& settings, const NoisyScan* scan, Interrupter& progress)
{
    return UpperBuilder(points, root, settings, scan, progress).build();
}

std::vector<OctreeDraft> buildSubtrees(const SortedPoints& points, const RootCube& root,
                                       const MpuSettings& settings, const NoisyScan* scan,
                                       const SubtreeRoot* begin, const SubtreeRoot* end,
                                       Interrupter& progress)
{
    std::vector<OctreeDraft> built(std::size_t(end - begin));
    tbb::enumerable_thread_specific<SubtreeBuilder> builders(
        [&] { return SubtreeBuilder(points, root, settings, scan, progress); });
    const double share = built.empty() ? 0 : 1.0 / double(built.size());
    tbb::parallel_for(std::size_t(0), built.size(), [&](std::size_t n) {
        built[n] = builders.local().build(begin[n].cell, begin[n].spacing);
        progress.advance(share);
    });
    return built;
}

OctreeDraft buildOctree(const SortedPoints& points, const RootCube& root,
                        const MpuSettings& settings, Interrupter& progress)
{
    const auto scan = NoisyScan::of(points, root, settings, progress);
    UpperOctree upper = buildUpper(points, root, settings, scan.get(), progress);
    const SubtreeRoot* const first = upper.subtrees.data();
    std::vector<OctreeDraft> built = buildSubtrees(points, root, settings, scan.get(), first,
                                                   first + upper.subtrees.size(), progress);
    OctreeDraft& tree = upper.tree;
    std::size_t nodes = tree.nodes.size(), fits = tree.fits.size(), quadrics = tree.quadrics.size();
    for (const OctreeDraft& b : built) {
        nodes += b.nodes.size();
        fits += b.fits.size();
        quadrics += b.quadrics.size();
    }
    tree.nodes.reserve(nodes);
    tree.fits.reserve(fits);
    tree.quadrics.reserve(quadrics);
    for (std::size_t n = 0; n < built.size(); ++n) {
        tree.graft(upper.subtrees[n].node, built[n]);
        built[n] = OctreeDraft{};
    }
    return std::move(upper.tree);
}

} // namespace mpuvdb
