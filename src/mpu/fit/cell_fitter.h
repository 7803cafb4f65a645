// The decision about a cell: a leaf with its fit, or eight children.
#pragma once
#include "fit_quality.h"
#include "local_fit.h"
#include "mpu/octree/octree.h"
#include "mpu/octree/sorted_points.h"
#include "noise_bias.h"

#include <algorithm>
#include <cmath>

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

/// Least radius of a ball, in standard deviations of the noise: a smaller ball cuts off points that
/// are far from the surface. [tuned: noise_bench]
constexpr double kMinNoiseRadius = 3;

/// Least radius of a ball among dense points, in standard deviations of the noise and in spacings.
/// [tuned: noise_bench]
constexpr double kMinDenseNoiseRadius = 2, kMinDenseRadius = 2.5;

/// Noise, in voxels, from which on cells below two voxels resolve edges no better.
/// [tuned: noise_bench]
constexpr double kMinBlurringNoise = 0.05;

/// Least edge of a cell, voxels, where the surface has no edge. [tuned: suite, time]
constexpr double kMinCell = 2;

/// Least edge of a cell, voxels, between walls so close that no fit represents both within the
/// tolerance. [tuned: reconstruct_test]
constexpr double kMinCellBetweenWalls = 0.5;

/// Least edge of a cell, voxels, among noise, where a ball holds both sides of a thin part.
/// [tuned: noise_bench]
constexpr double kMinCellThinNoisy = 1;

/// Fine detail: with noise from the tolerance up to a largest, in voxels, points show details of
/// about a voxel. Cells have a smaller least edge there, voxels, and fewer points separate a shape
/// from noise. [tuned: noise_bench]
constexpr double kFineDetailMaxNoise = 0.35, kFineDetailMinCell = 1.4;
constexpr std::size_t kFineDetailMinPoints = 50;

/// Largest radius of a ball, in standard deviations of the noise, that is enlarged, because it cuts
/// through the noise. [tuned: noise_bench]
constexpr double kMaxEnlargedRadius = 8;

/// Least noise of normals that weighs them, radians: a quadratic cannot follow all slopes of a
/// shape. [tuned: noise_bench]
constexpr double kMinNormalNoise = 0.04;

/// Largest noise of normals that separate the faces of an edge, radians. [tuned: noise_bench]
constexpr double kMaxEdgeNormalNoise = 0.3;

/// Pattern of the residuals from which on a fit is unresolved, in standard deviations of the noise.
/// [tuned: noise_bench]
constexpr double kMinPattern = 0.4;

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
    /// At this noise the points do not determine the shape, and do not follow the fit.
    bool unresolved = false;
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
    CellFitter(const SortedPoints& points, const RootCube& root, const MpuSettings& settings)
        : mPoints(points), mRoot(root), mSettings(settings)
    {
        mFit.tolerance = settings.tolerance;
        mFit.noise = settings.noise;
        mFit.normalNoise = settings.normalNoise;
        if (settings.normalNoise > 0)
            mFit.lever = settings.noise / std::max(settings.normalNoise, kMinNormalNoise);
        mFit.minPoints = settings.minPoints;
        if (showsFineDetail()) mFit.fewPoints = kFineDetailMinPoints;
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
        const double radius = supportRadius(cell.level), size = mRoot.size(cell.level);
        Decision decision;
        if (ball.size() > kMinSampledPoints) {
            mFilter.strided(ball, ball.size() / kSamplePoints, mGrown);
            decision = decideOn(mGrown, cell, radius, radius, spacing);
            if (decision.split) return decision;
        }
        if (ball.size() < std::size_t(mFit.minPoints) && radius > kMinRimRadius * spacing &&
            mRoot.size(cell.level + 1) >= 2 * mSettings.voxelSize) {
            // The ball is at the rim of the data, which do not say how the surface goes on.
            decision.split = true;
            decision.fitted = false;
            return decision;
        }
        if (gatherEnlarged(cell, path)) {
            decision = decideOn(mGrown, cell, enlargedRadius(radius), radius, spacing);
        } else {
            const double grown = grow(ball, cell, path);
            decision = decideOn(grown > radius ? mGrown : ball, cell, grown, grown, spacing);
        }
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
                decision.unresolved = isUnresolved(sharp, cell, spacing);
            }
        }
        if (!decision.split && radius >= kMinNoiseRadius * mSettings.noise &&
            mayHaveNoisyEdge(decision.result)) {
            if (const auto edge = fitNoisyEdge(mCell, decision.result.fit, mFit, mScratch)) {
                decision.result.fit = *edge;
                decision.result.error = taubinError(*edge, mCell, radius);
                decision.result.accepted = true;
                decision.gap = zeroSetGap(*edge, mCell, Vec3d::Zero(), radius,
                                          fullSupportGap(spacing, radius));
            }
        }
        return decision;
    }

    /// Whether empty children may inherit the rejected fit of the last decide().
    bool lastMayBeInherited(const Decision& decision, const OctreeCell& cell, double spacing) const
    {
        const double radius = supportRadius(cell.level);
        // The fit of an edge or of two surfaces means little away from its points.
        if (decision.result.error > kMaxInheritedError * radius) return false;
        const double gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                      maxSupportedGap(radius, mCell.radius, spacing));
        return gap <= maxSupportedGap(radius, mCell.radius, spacing);
    }

    /// Support of the inherited fit in an empty child.
    double inheritedSupport(const Decision& decision, const OctreeCell& cell,
                            const OctreeCell& child, double spacing) const
    {
        return supportInEmpty(decision.result.fit, mRoot.center(child) - mRoot.center(cell),
                              supportRadius(child.level), spacing);
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

    /// Whether noise may hide an edge that normals show.
    bool mayHaveNoisyEdge(const FitResult& result) const
    {
        return mSettings.sharp && mSettings.noise >= kMinBlurringNoise * mSettings.voxelSize &&
               mSettings.normalNoise > 0 && mSettings.normalNoise < kMaxEdgeNormalNoise &&
               result.spreadNormals && !result.fit.isSharp();
    }

    /// Whether a ball of @a radius is too small for this noise.
    bool isTooSmallForNoise(double radius, double spacing) const
    {
        if (radius >= kMinNoiseRadius * mSettings.noise) return false;
        if (!(mSettings.normalNoise > 0)) return true;
        return radius < kMinDenseNoiseRadius * mSettings.noise ||
               radius < kMinDenseRadius * spacing;
    }

    /// Whether @a result, of the smallest ball for this noise, does not represent the points:
    /// normals are opposed, or residuals have a pattern.
    bool isUnresolved(const FitResult& result, const OctreeCell& cell, double spacing) const
    {
        if (!(mSettings.noise > 0) || !isTooSmallForNoise(supportRadius(cell.level + 1), spacing))
            return false;
        if (result.opposedNormals && !result.fit.isSharp()) return true;
        if (result.accepted) return false;
        return residualPattern(result.fit, mCell, supportRadius(cell.level), mSettings.noise) >
               kMinPattern * mSettings.noise;
    }

    /// Whether points show details of about a voxel.
    bool showsFineDetail() const
    {
        return mSettings.noise >= mSettings.tolerance &&
               mSettings.noise <= kFineDetailMaxNoise * mSettings.voxelSize;
    }

    bool mayBeSplit(const OctreeCell& cell, const FitResult& result, double spacing) const
    {
        const bool fine = mSettings.noise < kMinBlurringNoise * mSettings.voxelSize &&
                          (result.fit.isSharp() || result.opposedNormals ||
                           (mSettings.sharp && result.spreadNormals && !result.accepted));
        if (isTooSmallForNoise(supportRadius(cell.level + 1), spacing)) return false;
        const bool isBetweenWalls = result.opposedNormals && !result.accepted;
        const double least = fine ? (isBetweenWalls ? kMinCellBetweenWalls : 1)
                                  : (isBetweenWalls      ? kMinCellThinNoisy
                                     : showsFineDetail() ? kFineDetailMinCell
                                                         : kMinCell);
        return cell.level < SortedPoints::kMaxLevel &&
               mRoot.size(cell.level + 1) >= least * mSettings.voxelSize;
    }

    /// @param reach  largest lateral distance of points with a weight.
    Decision decideOn(const PointBatch& batch, const OctreeCell& cell, double ballRadius,
                      double reach, double spacing)
    {
        const double radius = supportRadius(cell.level);
        mCell.assign(batch, mRoot.center(cell), ballRadius);
        if (mSettings.noise > 0) mCell.weightLaterally(meanNormal(mCell), reach);
        FitSettings fit = mFit;
        if (mSettings.noise > kMinBiasNoise * mSettings.tolerance) fit.reach = reach;
        fit.maxSharpPoints = mSettings.sharp ? 2 * std::size_t(mFit.minPoints) : 0;
        Decision decision;
        decision.result = fitCell(mCell, mRoot.size(cell.level), radius, fit, mScratch);
        const bool mayBe = mayBeSplit(cell, decision.result, spacing);
        if (decision.result.needsSplit || decision.result.turnsAway || !decision.result.accepted) {
            decision.split = mayBe;
            if (mayBe) return decision;
        }
        decision.gap = zeroSetGap(decision.result.fit, mCell, Vec3d::Zero(), radius,
                                  fullSupportGap(spacing, radius));
        decision.unresolved = isUnresolved(decision.result, cell, spacing);
        // A fit of few points at the data's rim is within tolerance, but not supported in the ball.
        decision.split = mayBe && decision.gap > maxSupportedGap(radius, ballRadius, spacing) &&
                         (ballRadius <= 1.5 * radius || radius > 3 * spacing);
        return decision;
    }

    /// Radius of a ball enlarged by the noise.
    double enlargedRadius(double radius) const { return radius + 3 * mSettings.noise; }

    /// Gather the points of an enlarged ball in mGrown where the ball cuts through the noise.
    /// @return whether it does, and they are enough.
    bool gatherEnlarged(const OctreeCell& cell, const std::vector<Ball>& path)
    {
        const Vec3d center = mRoot.center(cell);
        const double radius = supportRadius(cell.level), wanted = enlargedRadius(radius);
        if (!(radius < kMaxEnlargedRadius * mSettings.noise)) return false;
        for (std::size_t up = path.size(); up-- > 0;) {
            if (path[up].radius - (path[up].center - center).norm() < wanted) continue;
            mFilter.ball(*path[up].batch, center, wanted, mGrown);
            return isEnough(mGrown);
        }
        if (mWideRadius - (mWideCenter - center).norm() < wanted) {
            mWideRadius = 1.5 * wanted;
            mWideCenter = center;
            mPoints.gather(mPoints.around(cell, mWideRadius), 1, mFilter, mWide);
        }
        mFilter.ball(mWide, center, wanted, mGrown);
        return isEnough(mGrown);
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
    FitSettings mFit;
    CellPoints mCell, mScratch;
    BatchFilter mFilter;
    PointBatch mGrown, mWide;
    Vec3d mWideCenter = Vec3d::Zero(); ///< center of the ball whose points are in mWide
    double mWideRadius = 0;
};

} // namespace mpuvdb
