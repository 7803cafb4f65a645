// The decision about a cell: a leaf with its fit, or eight children.
#pragma once
#include "fit_quality.h"
#include "local_fit.h"
#include "mpu/octree/octree.h"
#include "mpu/octree/sorted_points.h"
#include "noisy_cell_fitter.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace mpuvdb
{

/// Points of a ball above which a sample is fitted first, and points of the sample.
/// [tuned: suite, time]
constexpr std::size_t kMinSampledPoints = 400;
constexpr std::size_t kSamplePoints = 150;

/// Growth of the radius of balls with too few points, per step. [paper: Ohtake03 eq. 6, lambda]
constexpr double kGrowth = 0.1;

/// Radius, in spacings, from which on a ball with fewer than N_min points is at the data's rim.
/// [tuned: unseen_bench]
constexpr double kMinRimRadius = 6;

/// Least edge of a cell, voxels, where the surface has no edge. [tuned: suite, time]
constexpr double kMinCell = 2;

/// Least edge of a cell, voxels, between walls so close that no fit represents both within the
/// tolerance. [tuned: reconstruct_test]
constexpr double kMinCellBetweenWalls = 0.5;

/// Range over which support falls from 1 to 0, in gaps of full support. [tuned: unseen_bench]
constexpr double kSupportFade = 0.3;

/// Largest error of a fit that empty cells inherit, radii. [tuned: reconstruct_test]
constexpr double kMaxInheritedError = 0.02;

/// The ball of a cell or of an ancestor, with all points within radius of center.
struct Ball {
    const PointBatch* batch;
    Vec3d center;
    double radius;
};

/// The decision about a cell.
struct Decision {
    bool split = false;
    bool fitted = true; ///< false: split without a fit
    FitResult result;   ///< accepted, or rejected and split
    double gap = 0;     ///< zeroSetGap of the fit, world units
    double support = 1; ///< of the fit by data in the cell's ball, in [0, 1]
};

/// Largest gap of full support: two spacings, as random samples have gaps, or a part of the size of
/// a large cell.
inline double fullSupportGap(double spacing, double radius)
{
    return std::max(2 * spacing, 0.16 * radius);
}

/// Support of a fit whose zero set is up to @a gap from the data: 1 up to fullSupportGap(), then
/// falling smoothly to 0.
inline double supportOf(double gap, double spacing, double radius)
{
    const double full = fullSupportGap(spacing, radius);
    const double t = std::clamp((gap / full - 1) / kSupportFade, 0.0, 1.0);
    return 1 - t * t * (3 - 2 * t);
}

/// Decides cells, with the scratch memory of one thread.
class CellFitter
{
public:
    /// @param scan  null: the points are exact.
    CellFitter(const SortedPoints& points, const RootCube& root, const MpuSettings& settings,
               const NoisyScan* scan)
        : mPoints(points), mRoot(root), mSettings(settings)
    {
        if (scan) mNoisy.emplace(*scan, root, settings.sharp);
        mFit.tolerance = settings.tolerance;
        mFit.noise = settings.noise;
        mFit.normalNoise = settings.normalNoise;
        if (settings.normalNoise > 0)
            mFit.lever = settings.noise / std::max(settings.normalNoise, kMinNormalNoise);
        mFit.minPoints = settings.minPoints;
    }

    /// Forget points gathered for other cells: their order, and with it the last bit of a fit, must
    /// not depend on the subtrees built before.
    void forget() { mWideRadius = 0; }

    double supportRadius(int level) const
    {
        return mSettings.alpha * std::sqrt(3.0) * mRoot.size(level);
    }

    /// Decide a cell whose ball holds @a ball (not empty). @a path: balls of its ancestors.
    Decision decide(const OctreeCell& cell, const PointBatch& ball, const std::vector<Ball>& path,
                    double spacing)
    {
        if (mNoisy) return decideNoisy(cell, ball, path, spacing);
        Decision decision = decideExact(cell, ball, path, spacing);
        decision.support = supportOf(decision.gap, spacing, supportRadius(cell.level));
        return decision;
    }

private:
    Decision decideExact(const OctreeCell& cell, const PointBatch& ball,
                         const std::vector<Ball>& path, double spacing)
    {
        const double radius = supportRadius(cell.level), size = mRoot.size(cell.level);
        Decision decision;
        if (ball.size() > kMinSampledPoints) {
            mFilter.strided(ball, ball.size() / kSamplePoints, mGrown);
            decision = decideOn(mGrown, cell, radius, spacing);
            if (decision.split) return decision;
        }
        if (ball.size() < std::size_t(mFit.minPoints) && radius > kMinRimRadius * spacing &&
            mRoot.size(cell.level + 1) >= 2 * mSettings.voxelSize) {
            // The ball is at the rim of the data, which do not say how the surface goes on.
            decision.split = true;
            decision.fitted = false;
            return decision;
        }
        const double grown = grow(ball, cell, path);
        decision = decideOn(grown > radius ? mGrown : ball, cell, grown, spacing);
        const bool isPoor = !decision.result.accepted || decision.result.turnsAway;
        if (!decision.split && isPoor && mSettings.sharp &&
            mCell.count <= 8 * std::size_t(mFit.minPoints)) {
            // The level limit stops the descent to few points: try a feature here.
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

public:
    /// Fit a cell that is split without a fit, for its children without points.
    void fitForChildren(Decision& decision, const OctreeCell& cell, const PointBatch& ball,
                        const std::vector<Ball>& path)
    {
        // A fit of a much larger radius than the points allow means nothing.
        if (!mNoisy || decision.fitted ||
            mNoisy->isTooLarge(mRoot.center(cell), supportRadius(cell.level + 1)))
            return;
        decision = fitNoisy(cell, ball, path);
        decision.split = true;
    }

    /// Whether empty children may inherit the rejected fit of the last decide().
    bool lastMayBeInherited(const Decision& decision, const OctreeCell& cell, double spacing) const
    {
        const double radius = supportRadius(cell.level);
        // The fit of an edge or of two surfaces means little away from its points.
        if (mNoisy) return !decision.result.fit.isSharp();
        if (decision.result.error > kMaxInheritedError * radius) return false;
        const double gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                      maxSupportedGap(radius, mCell.radius, spacing));
        return gap <= maxSupportedGap(radius, mCell.radius, spacing);
    }

    /// Support of the inherited fit in an empty child.
    double inheritedSupport(const Decision& decision, const OctreeCell& cell,
                            const OctreeCell& child, double spacing) const
    {
        const Vec3d center = mRoot.center(child) - mRoot.center(cell);
        const double radius = supportRadius(child.level);
        return mNoisy ? mNoisy->support(decision.result.fit, center, radius)
                      : supportInEmpty(decision.result.fit, center, radius, spacing);
    }

    /// A fit for a cell with no points in its ball: the plane of the N_min points nearest to it
    /// [Ohtake03 §3] among @a near (not empty).
    LocalFit fitEmpty(const OctreeCell& cell, const PointBatch& near, double spacing,
                      double& support)
    {
        const Vec3d center = mRoot.center(cell);
        const double last = mFilter.nearest(near, center, std::size_t(mFit.minPoints), mGrown);
        const double grown = last * (1 + 1e-6);
        mCell.assign(mGrown, center, grown);
        keepSheetOf(mFilter.nearestOf(mGrown, center));
        LocalFit fit;
        fit.pieces[0] = fitBivariate(mCell, meanNormal(mCell), mCell.count + 1);
        support = supportInEmpty(fit, Vec3d::Zero(), supportRadius(cell.level), spacing);
        return fit;
    }

    /// fitEmpty() among a sample of all points.
    LocalFit fitEmpty(const OctreeCell& cell, double spacing, double& support)
    {
        PointBatch near;
        for (double cover = 2 * supportRadius(cell.level); near.size() == 0; cover *= 2) {
            const SortedPoints::Around around = mPoints.around(cell, cover);
            mPoints.gather(around, 1 + around.points / kMinSampledPoints, mFilter, near);
        }
        return fitEmpty(cell, near, spacing, support);
    }

private:
    /// Take their weights from the points of mCell that look away from point @a n: they are of
    /// another sheet.
    void keepSheetOf(std::size_t n)
    {
        const Vec3d normal = mCell.normal(n);
        for (std::size_t i = 0; i < mCell.count; ++i)
            if (mCell.normal(i).dot(normal) < kAway) mCell.weight[i] = 0;
    }

    /// Largest gap of a fit that need not be split, and that empty children may inherit.
    static double maxSupportedGap(double radius, double ballRadius, double spacing)
    {
        return std::max(0.2 * radius, std::min(0.45 * ballRadius, 5 * spacing));
    }

    /// Support of @a fit in an empty cell. @param center  of the cell, relative to mCell's.
    double supportInEmpty(const LocalFit& fit, const Vec3d& center, double radius,
                          double spacing) const
    {
        const double gap =
            zeroSetGapBeyond(fit, mCell, center, radius, fullSupportGap(spacing, radius));
        return supportOf(gap, spacing, radius);
    }

    /// decide() among noise: cells are split until the fits' radii hold for them.
    Decision decideNoisy(const OctreeCell& cell, const PointBatch& ball,
                         const std::vector<Ball>& path, double spacing)
    {
        const double radius = supportRadius(cell.level), half = mRoot.size(cell.level + 1);
        const bool mayBe = cell.level < SortedPoints::kMaxLevel && half >= mSettings.voxelSize,
                   mayBeRim = mayBe && half >= kMinCell * mSettings.voxelSize;
        const bool isRim =
            ball.size() < std::size_t(mFit.minPoints) && radius > kMinRimRadius * spacing;
        if ((mayBe && mNoisy->isTooLarge(mRoot.center(cell), radius)) || (mayBeRim && isRim)) {
            Decision unfitted;
            unfitted.split = true;
            unfitted.fitted = false;
            return unfitted;
        }
        Decision decision = fitNoisy(cell, ball, path);
        decision.split = (mayBeRim && decision.support < 1 &&
                          (mCell.radius <= 1.5 * radius || radius > 3 * spacing)) ||
                         (mayBe && decision.result.accepted &&
                          mNoisy->leavesSheets(decision.result.fit, radius));
        return decision;
    }

    /// Fit the sheets of a cell.
    Decision fitNoisy(const OctreeCell& cell, const PointBatch& ball, const std::vector<Ball>& path)
    {
        const double radius = supportRadius(cell.level), grown = grow(ball, cell, path);
        mCell.assign(grown > radius ? mGrown : ball, mRoot.center(cell), grown);
        Decision decision;
        decision.result.accepted =
            mNoisy->fit(mCell, mRoot.center(cell), grown, decision.result.fit);
        if (!decision.result.accepted)
            decision.result.fit.pieces[0] = fitBivariate(mCell, meanNormal(mCell), mCell.count + 1);
        decision.result.error = taubinError(decision.result.fit, mCell, radius);
        decision.support = mNoisy->support(decision.result.fit, Vec3d::Zero(), radius);
        return decision;
    }

    bool mayBeSplit(const OctreeCell& cell, const FitResult& result) const
    {
        const bool isBetweenWalls = result.opposedNormals && !result.accepted;
        const bool fine = result.fit.isSharp() || result.opposedNormals ||
                          (mSettings.sharp && result.spreadNormals && !result.accepted);
        const double least = isBetweenWalls ? kMinCellBetweenWalls : fine ? 1 : kMinCell;
        return cell.level < SortedPoints::kMaxLevel &&
               mRoot.size(cell.level + 1) >= least * mSettings.voxelSize;
    }

    Decision decideOn(const PointBatch& batch, const OctreeCell& cell, double ballRadius,
                      double spacing)
    {
        const double radius = supportRadius(cell.level);
        mCell.assign(batch, mRoot.center(cell), ballRadius);
        if (mSettings.noise > 0) mCell.weightLaterally(meanNormal(mCell), ballRadius);
        FitSettings fit = mFit;
        fit.maxSharpPoints = mSettings.sharp ? 2 * std::size_t(mFit.minPoints) : 0;
        Decision decision;
        decision.result = fitCell(mCell, mRoot.size(cell.level), radius, fit, mScratch);
        const bool mayBe = mayBeSplit(cell, decision.result);
        if (decision.result.needsSplit || decision.result.turnsAway || !decision.result.accepted) {
            decision.split = mayBe;
            if (mayBe) return decision;
        }
        decision.gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                  fullSupportGap(spacing, radius));
        // A fit of few points at the data's rim is within tolerance, but not supported in the ball.
        decision.split = mayBe && decision.gap > maxSupportedGap(radius, ballRadius, spacing) &&
                         (ballRadius <= 1.5 * radius || radius > 3 * spacing);
        return decision;
    }

    bool isEnough(const PointBatch& batch) const
    {
        return batch.size() >= std::size_t(mFit.minPoints);
    }

    /// Grow the ball until it holds N_min points [Ohtake03 eq. 6]: their number counts, not the sum
    /// of their confidences [Ohtake03 §6], as larger balls would blur parts where all confidences
    /// are low, such as rims of scans. @return the radius; where it grew, mGrown holds the points.
    double grow(const PointBatch& ball, const OctreeCell& cell, const std::vector<Ball>& path)
    {
        const Vec3d center = mRoot.center(cell);
        const double radius = supportRadius(cell.level);
        if (isEnough(ball)) return radius;
        for (std::size_t up = path.size(); up-- > 0;) {
            const double cover = path[up].radius - (path[up].center - center).norm();
            const int steps = int(std::floor((cover / radius - 1) / kGrowth));
            if (steps < 1) continue;
            if (const int k = growIn(*path[up].batch, center, radius, steps))
                return radius * (1 + kGrowth * k);
        }
        return growAmongAll(cell);
    }

    /// Gather the points of @a batch in a ball that is large enough in mGrown. @return the steps by
    /// which it grew; 0 if none up to @a steps is.
    int growIn(const PointBatch& batch, const Vec3d& center, double radius, int steps)
    {
        return isEnough(batch) ? mFilter.grownBall(batch, center, radius, kGrowth, steps,
                                                   std::size_t(mFit.minPoints), mGrown)
                               : 0;
    }

    /// grow() without the balls of ancestors: in a wide ball, kept for the cells that follow, and
    /// enlarged as needed.
    double growAmongAll(const OctreeCell& cell)
    {
        const Vec3d center = mRoot.center(cell);
        const double radius = supportRadius(cell.level);
        for (double wanted = 2.5 * radius;; wanted *= 2) {
            const double cover = mWideRadius - (mWideCenter - center).norm();
            const int steps = int(std::floor((cover / radius - 1) / kGrowth));
            if (const int k = growIn(mWide, center, radius, steps))
                return radius * (1 + kGrowth * k);
            if (steps > 0 && mWide.size() == mPoints.size()) { // no more points
                const double grown = radius * (1 + kGrowth * steps);
                mFilter.ball(mWide, center, grown, mGrown);
                return grown;
            }
            mPoints.gather(mPoints.around(cell, wanted), 1, mFilter, mWide);
            mWideCenter = center;
            mWideRadius = wanted;
        }
    }

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    const MpuSettings& mSettings;
    std::optional<NoisyCellFitter> mNoisy;
    FitSettings mFit;
    CellPoints mCell, mScratch;
    BatchFilter mFilter;
    PointBatch mGrown, mWide;
    Vec3d mWideCenter = Vec3d::Zero(); ///< center of the ball whose points are in mWide
    double mWideRadius = 0;
};

} // namespace mpuvdb
