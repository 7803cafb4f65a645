// Building the octree: from the root a few levels on samples of the points, then each subtree depth
// first on contiguous copies of its points, which shrink with every level.
#include "local_fit.h"
#include "octree.h"

#include <mpuvdb/progress.h>

#include <algorithm>
#include <deque>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kSubtreePoints = 4096; ///< a cell with fewer points around starts a subtree
constexpr std::size_t kSampleFrom = 400;     ///< more points than this are tried on a sample first
constexpr std::size_t kSample = 150;
constexpr std::size_t kSpacingPoints = 256; ///< spacing is measured among at most so many
constexpr double kGrowth = 0.1;             ///< lambda [Ohtake03 eq. 6]
constexpr std::size_t kNeighbours = 12;
constexpr double kRimSpacings =
    6; ///< a ball larger than this with fewer than N_min points is a rim

constexpr double kHeirError =
    0.02; ///< largest error, in radii, of a fit that empty cells take over

/// Points of @a parent within @a radius of @a centre.
void filterBall(const PointBatch& parent, const Vec3d& centre, double radius,
                std::vector<std::uint32_t>& indices, PointBatch& out)
{
    const std::size_t n = parent.size();
    indices.resize(n);
    const Vec3f c = centre.cast<float>();
    const float radius2 = float(radius * radius);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const float dx = parent.x[i] - c[0], dy = parent.y[i] - c[1], dz = parent.z[i] - c[2];
        indices[kept] = std::uint32_t(i);
        kept += dx * dx + dy * dy + dz * dz < radius2;
    }
    out.resize(kept);
    const auto copy = [&](const std::vector<float>& from, std::vector<float>& to) {
        for (std::size_t i = 0; i < kept; ++i) to[i] = from[indices[i]];
    };
    copy(parent.x, out.x);
    copy(parent.y, out.y);
    copy(parent.z, out.z);
    copy(parent.nx, out.nx);
    copy(parent.ny, out.ny);
    copy(parent.nz, out.nz);
    copy(parent.confidence, out.confidence);
}

void takeStrided(const PointBatch& from, std::size_t stride, PointBatch& out)
{
    out.clear();
    for (std::size_t i = 0; i < from.size(); i += stride) {
        out.x.push_back(from.x[i]);
        out.y.push_back(from.y[i]);
        out.z.push_back(from.z[i]);
        out.nx.push_back(from.nx[i]);
        out.ny.push_back(from.ny[i]);
        out.nz.push_back(from.nz[i]);
        out.confidence.push_back(from.confidence[i]);
    }
}

/// Median over a few points of sqrt(pi/12) d12; 0 for too few points. Points near the middle of the
/// ball, where their neighbours are in it too.
double measureSpacing(const PointBatch& ball, const Vec3d& centre, double radius)
{
    constexpr std::size_t kProbes = 3;
    const std::size_t n = ball.size();
    if (n <= kNeighbours) return 0;
    const auto squared = [&](const Vec3f& from, std::size_t i) {
        return (Vec3f(ball.x[i], ball.y[i], ball.z[i]) - from).squaredNorm();
    };
    const Vec3f c = centre.cast<float>();
    const float half2 = float(radius * radius / 4);
    std::vector<std::uint32_t> inner;
    for (std::uint32_t i = 0; i < n; ++i)
        if (squared(c, i) < half2) inner.push_back(i);
    if (inner.empty()) inner.push_back(std::uint32_t(n / 2));
    std::array<double, kProbes> found;
    std::vector<float> distance2(n);
    for (std::size_t probe = 0; probe < kProbes; ++probe) {
        const std::size_t p = inner[(2 * probe + 1) * inner.size() / (2 * kProbes)];
        const Vec3f from(ball.x[p], ball.y[p], ball.z[p]);
        for (std::size_t i = 0; i < n; ++i) distance2[i] = squared(from, i);
        std::nth_element(distance2.begin(), distance2.begin() + kNeighbours, distance2.end());
        found[probe] = std::sqrt(M_PI / kNeighbours * double(distance2[kNeighbours]));
    }
    std::sort(found.begin(), found.end());
    return found[kProbes / 2];
}

/// The ball of a cell or of an ancestor: its points are all points within radius of centre.
struct Ball {
    const PointBatch* batch;
    Vec3d centre;
    double radius;
};

/// What was decided about a cell.
struct Decision {
    bool split = false;
    bool fitted = true; ///< false: split without a fit
    FitResult result;   ///< accepted, or rejected and split
    double gap = 0;     ///< zeroSetGap of the fit, world units
};

/// A gap that leaves the support at 1.
double fullSupportGap(double spacing, double radius)
{
    return std::max(2.5 * spacing, 0.2 * radius);
}

/// Support of a fit whose zero set ventures @a gap from the data: 1 up to a few spacings (or, in a
/// large cell, a part of its size), falling smoothly to 0.
double supportOf(double gap, double spacing, double radius)
{
    const double full = fullSupportGap(spacing, radius);
    const double t = std::clamp(gap / full - 1, 0.0, 1.0);
    return 1 - t * t * (3 - 2 * t);
}

/// Decides cells; scratch memory of one thread.
class CellFitter
{
public:
    CellFitter(const SortedPoints& points, const RootCube& root, const MpuSettings& settings)
        : mPoints(points), mRoot(root), mSettings(settings)
    {
        mFit.tolerance = settings.tolerance;
        mFit.minPoints = settings.minPoints;
    }

    double supportRadius(int level) const
    {
        return mSettings.alpha * std::sqrt(3.0) * mRoot.size(level);
    }

    /// Decide a cell whose ball holds @a ball (not empty). @a path: balls of its ancestors.
    Decision decide(const OctreeCell& cell, const PointBatch& ball, const std::vector<Ball>& path,
                    double spacing)
    {
        const double radius = supportRadius(cell.level), size = mRoot.size(cell.level);
        Decision decision;
        if (ball.size() > kSampleFrom) {
            takeStrided(ball, ball.size() / kSample, mGrown);
            decision = decideOn(mGrown, cell, radius, spacing);
            if (decision.split) return decision;
        }
        if (ball.size() < std::size_t(mFit.minPoints) && radius > kRimSpacings * spacing &&
            mRoot.size(cell.level + 1) >= 2 * mSettings.voxelSize) {
            // Data would fill the ball with many more: this is their rim, and nothing here says how
            // the surface goes on.
            decision.split = true;
            decision.fitted = false;
            return decision;
        }
        const double grown = grow(ball, cell, path);
        decision = decideOn(grown > radius ? mGrown : ball, cell, grown, spacing);
        if (!decision.split && decision.result.error > mFit.tolerance && mSettings.sharp &&
            mCell.count <= 8 * std::size_t(mFit.minPoints)) {
            // The level limit stops the descent to few points: look for a feature all the same.
            FitSettings last = mFit;
            last.maxSharpPoints = mCell.count;
            const FitResult sharp = fitCell(mCell, size, radius, last, mScratch);
            if (sharp.error < decision.result.error) {
                decision.result = sharp;
                decision.gap = zeroSetGap(sharp.fit, mCell, Vec3d::Zero(), radius,
                                          fullSupportGap(spacing, radius));
            }
        }
        return decision;
    }

    /// Whether the rejected fit that decide() last looked at may rule where the cell has no points.
    bool lastIsHeldUp(const Decision& decision, const OctreeCell& cell, double spacing) const
    {
        const double radius = supportRadius(cell.level);
        // One surface with an edge in it, or two, says little where it was not near its points.
        if (decision.result.error > kHeirError * radius) return false;
        const double gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                      heldUpGap(radius, mCell.radius, spacing));
        return gap <= heldUpGap(radius, mCell.radius, spacing);
    }

    /// Support of that fit in an empty child: its zero set near data, or, where it has none, no
    /// farther from it than the data are.
    double lastSupportIn(const Decision& decision, const OctreeCell& cell, const OctreeCell& child,
                         double spacing) const
    {
        return supportInEmpty(decision.result.fit, mRoot.centre(child) - mRoot.centre(cell),
                              supportRadius(child.level), spacing);
    }

    /// A fit for a cell with no points in its ball: the plane of the N_min points nearest to it
    /// [Ohtake03 §3] among @a near (not empty).
    LocalFit fitEmpty(const OctreeCell& cell, const PointBatch& near, double spacing,
                      double& support)
    {
        const Vec3d centre = mRoot.centre(cell);
        std::vector<std::pair<double, std::uint32_t>> order(near.size());
        for (std::uint32_t i = 0; i < near.size(); ++i)
            order[i] = {(Vec3d(near.x[i], near.y[i], near.z[i]) - centre).squaredNorm(), i};
        const std::size_t count = std::min(near.size(), std::size_t(mFit.minPoints));
        const auto last = order.begin() + std::ptrdiff_t(count - 1);
        std::nth_element(order.begin(), last, order.end());
        const double grown = std::sqrt(last->first) * (1 + 1e-6);
        filterBall(near, centre, grown, mIndices, mGrown);
        mCell.assign(mGrown, centre, grown);
        LocalFit fit;
        fit.pieces[0] = fitBivariate(mCell, meanNormal(mCell), mCell.count + 1);
        support = supportInEmpty(fit, Vec3d::Zero(), supportRadius(cell.level), spacing);
        return fit;
    }

    /// As above among a sample of all points.
    LocalFit fitEmpty(const OctreeCell& cell, double spacing, double& support)
    {
        PointBatch near;
        for (double cover = 2 * supportRadius(cell.level); near.size() == 0; cover *= 2) {
            const std::size_t around = mPoints.countAround(cell, cover, mPoints.size());
            mPoints.gather(cell, cover, 1 + around / kSampleFrom, near);
        }
        return fitEmpty(cell, near, spacing, support);
    }

private:
    static double heldUpGap(double radius, double ballRadius, double spacing)
    {
        return std::max(0.2 * radius, std::min(0.45 * ballRadius, 5 * spacing));
    }

    /// @param centre  of the empty cell, relative to mCell's.
    double supportInEmpty(const LocalFit& fit, const Vec3d& centre, double radius,
                          double spacing) const
    {
        const double gap = zeroSetGap(fit, mCell, centre, radius, fullSupportGap(spacing, radius));
        if (gap > 0) return supportOf(gap, spacing, radius);
        // The surface is as far as the nearest point: not nearer, for lack of points there, and not
        // farther, since a point is on it.
        const Quadric& q = fit.ruling(centre);
        const double claimed =
            std::abs(q.value(centre)) / std::max(q.gradient(centre).norm(), 1e-6);
        const double nearest = std::sqrt(nearestSquared(mCell, centre));
        const double tooNear = supportOf(nearest - 1.2 * claimed, spacing, radius);
        const double tooFar = supportOf(claimed - 1.3 * nearest, spacing, radius);
        return std::min(tooNear, tooFar);
    }

    bool mayBeSplit(const OctreeCell& cell, const FitResult& result) const
    {
        const bool fine =
            result.fit.isSharp() || result.opposedNormals ||
            (mSettings.sharp && result.spreadNormals && result.error > mFit.tolerance);
        return cell.level < SortedPoints::kMaxLevel &&
               mRoot.size(cell.level + 1) >= (fine ? 1 : 2) * mSettings.voxelSize;
    }

    Decision decideOn(const PointBatch& batch, const OctreeCell& cell, double ballRadius,
                      double spacing)
    {
        const double radius = supportRadius(cell.level);
        mCell.assign(batch, mRoot.centre(cell), ballRadius);
        FitSettings fit = mFit;
        fit.maxSharpPoints = mSettings.sharp ? 2 * std::size_t(mFit.minPoints) : 0;
        Decision decision;
        decision.result = fitCell(mCell, mRoot.size(cell.level), radius, fit, mScratch);
        const bool mayBe = mayBeSplit(cell, decision.result);
        if (decision.result.needsSplit || decision.result.error > mFit.tolerance) {
            decision.split = mayBe;
            if (mayBe) return decision;
        }
        decision.gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                  fullSupportGap(spacing, radius));
        // A fit of few points at the data's rim is within tolerance and knows nothing of the ball.
        decision.split = mayBe && decision.gap > heldUpGap(radius, ballRadius, spacing) &&
                         (ballRadius <= 1.5 * radius || radius > 3 * spacing);
        return decision;
    }

    /// Grow the ball until its confidences reach N_min, [Ohtake03 eq. 6, §6]; at most 20 N_min
    /// points. Returns the radius; where it grew, mGrown holds the points.
    double grow(const PointBatch& ball, const OctreeCell& cell, const std::vector<Ball>& path)
    {
        const Vec3d centre = mRoot.centre(cell);
        const double radius = supportRadius(cell.level);
        double sum = 0;
        for (const float c : ball.confidence) sum += c;
        const std::size_t most = 20 * std::size_t(mFit.minPoints);
        if (sum >= mFit.minPoints || ball.size() >= most) return radius;
        for (std::size_t up = path.size(); up-- > 0;) {
            const double cover = path[up].radius - (path[up].centre - centre).norm();
            const int steps = int(std::floor((cover / radius - 1) / kGrowth));
            if (steps < 1) continue;
            if (const int k = growthSteps(*path[up].batch, centre, radius, steps, most)) {
                const double grown = radius * (1 + kGrowth * k);
                filterBall(*path[up].batch, centre, grown, mIndices, mGrown);
                return grown;
            }
        }
        return growAmongAll(cell, most);
    }

    /// Smallest number of steps with which the ball of points in @a batch is large enough; 0: none
    /// up to @a steps.
    int growthSteps(const PointBatch& batch, const Vec3d& centre, double radius, int steps,
                    std::size_t most)
    {
        mStepConfidence.assign(std::size_t(steps) + 1, 0.0);
        mStepCount.assign(std::size_t(steps) + 1, 0);
        const Vec3f c = centre.cast<float>();
        const auto reach = float(radius * (1 + kGrowth * steps));
        const auto perStep = float(1 / (kGrowth * radius));
        for (std::size_t i = 0; i < batch.size(); ++i) {
            const float dx = batch.x[i] - c[0], dy = batch.y[i] - c[1], dz = batch.z[i] - c[2];
            const float d2 = dx * dx + dy * dy + dz * dz;
            if (d2 >= reach * reach) continue;
            // The step whose ball is the first to hold the point.
            const float step = (std::sqrt(d2) - float(radius)) * perStep + 1;
            const auto k = std::min(std::size_t(std::max(step, 0.0f)), std::size_t(steps));
            mStepConfidence[k] += batch.confidence[i];
            ++mStepCount[k];
        }
        double sum = 0;
        std::size_t count = 0;
        for (int k = 0; k <= steps; ++k) {
            sum += mStepConfidence[std::size_t(k)];
            count += mStepCount[std::size_t(k)];
            if (k > 0 && count > 0 && (sum >= mFit.minPoints || count >= most)) return k;
        }
        return 0;
    }

    /// As grow(), for a cell whose ancestors' balls are not at hand: in a wide ball, kept for the
    /// cells that follow, and wider and wider if need be.
    double growAmongAll(const OctreeCell& cell, std::size_t most)
    {
        const Vec3d centre = mRoot.centre(cell);
        const double radius = supportRadius(cell.level);
        for (double wanted = 2.5 * radius;; wanted *= 2) {
            const double cover = mWideRadius - (mWideCentre - centre).norm();
            const int steps = int(std::floor((cover / radius - 1) / kGrowth));
            int k = steps > 0 ? growthSteps(mWide, centre, radius, steps, most) : 0;
            if (k == 0 && steps > 0 && mWide.size() == mPoints.size()) k = steps; // no more points
            if (k > 0) {
                const double grown = radius * (1 + kGrowth * k);
                filterBall(mWide, centre, grown, mIndices, mGrown);
                return grown;
            }
            mPoints.gather(cell, wanted, 1, mWide);
            mWideCentre = centre;
            mWideRadius = wanted;
        }
    }

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    FitSettings mFit;
    CellPoints mCell, mScratch;
    PointBatch mGrown, mWide;
    Vec3d mWideCentre = Vec3d::Zero(); ///< of the ball whose points mWide holds
    double mWideRadius = 0;
    std::vector<std::uint32_t> mIndices;
    std::vector<double> mStepConfidence;
    std::vector<std::size_t> mStepCount;
};

void countLeaf(MpuStatistics& statistics, const OctreeCell& cell, const Decision& decision,
               double tolerance)
{
    ++statistics.leaves;
    statistics.levels = std::max(statistics.levels, cell.level);
    if (decision.result.error > tolerance || decision.result.needsSplit)
        ++statistics.overTolerance;
    else
        statistics.maxError = std::max(statistics.maxError, decision.result.error);
}

/// Builds one subtree depth first.
class SubtreeBuilder
{
public:
    SubtreeBuilder(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
                   Progress& progress)
        : mPoints(points), mRoot(root), mSettings(settings), mProgress(progress),
          mFitter(points, root, settings)
    {
    }

    /// @param spacing  estimated for the parent; 0 if unknown.
    Octree build(const OctreeCell& cell, double spacing)
    {
        mTree = Octree{};
        mTree.root = mRoot;
        mTree.alpha = mSettings.alpha;
        mTree.nodes.resize(1);
        mPath.clear();
        PointBatch& ball = batches(0)[0];
        mPoints.gather(cell, mFitter.supportRadius(cell.level), 1, ball);
        if (ball.size() == 0)
            addEmpty(0, cell, nullptr, spacing > 0 ? spacing : mRoot.size(cell.level));
        else
            process(0, cell, ball, spacing, 0);
        return std::move(mTree);
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
        mTree.setLeaf(node, mTree.addFit(fit, mRoot.centre(cell)), support);
    }

    void process(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball,
                 double parentSpacing, std::size_t depth)
    {
        if (depth < 3) mProgress.check();
        const Vec3d centre = mRoot.centre(cell);
        const double radius = mFitter.supportRadius(cell.level);
        double spacing = parentSpacing;
        if (ball.size() <= kSpacingPoints && mSpacingDepth >= depth) {
            if (const double measured = measureSpacing(ball, centre, radius); measured > 0)
                spacing = measured;
            else if (!(spacing > 0))
                spacing = radius;
            mSpacingDepth = depth;
        }
        if (!(spacing > 0)) spacing = radius / 8; // more than kSpacingPoints in the ball
        const Decision decision = mFitter.decide(cell, ball, mPath, spacing);
        if (!decision.split) {
            mTree.setLeaf(node, mTree.addFit(decision.result.fit, centre),
                          supportOf(decision.gap, spacing, radius));
            countLeaf(mTree.statistics, cell, decision, mSettings.tolerance);
        } else {
            split(node, cell, ball, decision, spacing, depth);
        }
        if (mSpacingDepth == depth) mSpacingDepth = kNoDepth;
    }

    void split(std::uint32_t node, const OctreeCell& cell, const PointBatch& ball,
               const Decision& decision, double spacing, std::size_t depth)
    {
        const double childRadius = mFitter.supportRadius(cell.level + 1);
        Octants& octants = batches(depth + 1);
        bool someEmpty = false;
        for (int octant = 0; octant < 8; ++octant) {
            PointBatch& child = octants[std::size_t(octant)];
            filterBall(ball, mRoot.centre(cell.child(octant)), childRadius, mIndices, child);
            someEmpty |= child.size() == 0;
        }
        // Cells are stored before their descendants are built: the scratch still knows the parent.
        const bool inherit =
            someEmpty && decision.fitted && mFitter.lastIsHeldUp(decision, cell, spacing);
        const std::uint32_t inherited =
            inherit ? mTree.addFit(decision.result.fit, mRoot.centre(cell)) : 0;
        const auto first = std::uint32_t(mTree.nodes.size());
        mTree.nodes.resize(first + 8);
        mTree.nodes[node].index = first;
        mTree.statistics.cells += 8;
        for (int octant = 0; inherit && octant < 8; ++octant) {
            const OctreeCell child = cell.child(octant);
            if (octants[std::size_t(octant)].size() != 0) continue;
            mTree.setLeaf(first + std::uint32_t(octant), inherited,
                          mFitter.lastSupportIn(decision, cell, child, spacing));
            countEmpty(child);
        }
        mPath.push_back({&ball, mRoot.centre(cell), mFitter.supportRadius(cell.level)});
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

    static constexpr std::size_t kNoDepth = std::numeric_limits<std::size_t>::max();

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    Progress& mProgress;
    CellFitter mFitter;
    Octree mTree;
    std::deque<Octants> mBatches; ///< by depth; stable addresses
    std::vector<Ball> mPath;
    std::vector<std::uint32_t> mIndices;
    std::size_t mSpacingDepth = kNoDepth; ///< where on the path the spacing was measured
};

/// A cell of the upper levels, whose ball holds too many points to copy.
struct UpperCell {
    OctreeCell cell;
    std::uint32_t node = 0;
    double spacing = 0; ///< estimated from the cell's sample; before that, its parent's
    bool subtree = false;
    Decision decision;
};

class UpperBuilder
{
public:
    UpperBuilder(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
                 Progress& progress)
        : mPoints(points), mRoot(root), mSettings(settings), mProgress(progress)
    {
    }

    Octree build()
    {
        Octree tree;
        tree.root = mRoot;
        tree.alpha = mSettings.alpha;
        tree.nodes.resize(1);
        ++tree.statistics.cells;
        std::vector<UpperCell> level(1), subtrees;
        while (!level.empty()) {
            tbb::parallel_for(std::size_t(0), level.size(), [&](std::size_t n) {
                mProgress.check();
                decideUpper(level[n]);
            });
            level = nextLevel(tree, level, subtrees);
        }
        buildSubtrees(tree, subtrees);
        return tree;
    }

private:
    void decideUpper(UpperCell& upper) const
    {
        const OctreeCell& cell = upper.cell;
        CellFitter fitter(mPoints, mRoot, mSettings);
        const double radius = fitter.supportRadius(cell.level);
        const std::size_t around = mPoints.countAround(cell, radius, mPoints.size());
        if (around <= kSubtreePoints) {
            upper.subtree = true;
            return;
        }
        PointBatch sample;
        const std::size_t stride = around / (2 * kSampleFrom);
        mPoints.gather(cell, radius, stride, sample);
        if (sample.size() > kSample) {
            const double spacing =
                measureSpacing(sample, mRoot.centre(cell), radius); // of the sample
            upper.decision = fitter.decide(cell, sample, {}, spacing);
            if (!upper.decision.split) {
                mPoints.gather(cell, radius, 1, sample);
                upper.decision = fitter.decide(cell, sample, {}, spacing);
            }
            upper.spacing = spacing / std::sqrt(double(stride));
            return;
        }
        // Many points around, few in the ball: its own copy is small.
        upper.subtree = true;
    }

    std::vector<UpperCell> nextLevel(Octree& tree, std::vector<UpperCell>& level,
                                     std::vector<UpperCell>& subtrees) const
    {
        std::vector<UpperCell> next;
        for (UpperCell& upper : level) {
            if (upper.subtree) {
                subtrees.push_back(std::move(upper));
            } else if (!upper.decision.split) {
                const Decision& d = upper.decision;
                tree.setLeaf(upper.node, tree.addFit(d.result.fit, mRoot.centre(upper.cell)),
                             supportOf(d.gap, upper.spacing, tree.supportRadius(upper.cell.level)));
                countLeaf(tree.statistics, upper.cell, d, mSettings.tolerance);
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

    void buildSubtrees(Octree& tree, const std::vector<UpperCell>& subtrees) const
    {
        std::vector<Octree> built(subtrees.size());
        tbb::enumerable_thread_specific<SubtreeBuilder> builders(
            [&] { return SubtreeBuilder(mPoints, mRoot, mSettings, mProgress); });
        const double share = subtrees.empty() ? 0 : 1.0 / double(subtrees.size());
        tbb::parallel_for(std::size_t(0), subtrees.size(), [&](std::size_t n) {
            built[n] = builders.local().build(subtrees[n].cell, subtrees[n].spacing);
            mProgress.advance(share);
        });
        std::size_t nodes = tree.nodes.size(), fits = tree.fits.size(),
                    quadrics = tree.quadrics.size();
        for (const Octree& b : built) {
            nodes += b.nodes.size();
            fits += b.fits.size();
            quadrics += b.quadrics.size();
        }
        tree.nodes.reserve(nodes);
        tree.fits.reserve(fits);
        tree.quadrics.reserve(quadrics);
        for (std::size_t n = 0; n < built.size(); ++n) {
            tree.graft(subtrees[n].node, built[n]);
            built[n] = Octree{};
        }
    }

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    Progress& mProgress;
};

} // namespace

Octree buildOctree(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
                   Progress& progress)
{
    return UpperBuilder(points, root, settings, progress).build();
}

} // namespace mpuvdb
