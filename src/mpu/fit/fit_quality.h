// Quality of a local fit: its error, patterns of its residuals, gaps between it and the data.
#pragma once
#include "cell_points.h"
#include "quadric.h"

#include <functional>

namespace mpuvdb
{

/// Largest distance of a point from its surface by noise, in standard deviations of it.
/// [tuned: noise_bench]
constexpr double kMaxNoiseDistance = 8;

/// Largest cosine between two normals that look away from each other: 15 degrees beyond a right
/// angle, as beside a right edge either face may be in effect. [tuned: reconstruct_test; with -0.5
/// pits in thin walls come back, and the rms of a tube is .034 of a spacing instead of .012]
constexpr double kAway = -0.25;

/// Largest share of its points that a fit may look away from. [tuned: edge_bench; a part's edges
/// are 1.1 times as far off with 0.05, and a tube's with one normal of 500 flipped 1.4 times with
/// 0.2]
constexpr double kMaxAwayShare = 0.1;

/// Largest confidence * |Q| / |grad Q| over the points within @a testRadius [Ohtake03 eq. 7, §6].
double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius);

/// taubinError() of a height over a plane, also over the points beyond the radius that it looks
/// away from: those on it have flipped normals, all others are of a sheet that it cannot meet.
double heightError(const Quadric& height, const CellPoints& points, double testRadius);

/// taubinError() of a fit that may turn back; infinite if it looks away from more points than may
/// have flipped normals: it is near them by chance, and has its inside outside.
double sidedError(const LocalFit& fit, const CellPoints& points, double testRadius);

/// Whether the residuals of the points within @a testRadius look like noise of standard deviation
/// @a noise (up to twice that, as noise varies): their means over sixteen parts of the ball scatter
/// no more than those of noise.
bool residualsAreNoise(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise);

/// Weighted mean over the points of the squares of residuals and of turns of normals, both in
/// standard deviations and at most 9 each (for outliers): about 3 for a right fit.
/// @param normalNoise  radians, about each of two axes; above 0, as @a noise.
double noisyMisfit(const LocalFit& fit, const CellPoints& points, double noise, double normalNoise);

/// Number of points with a weight whose squares of residual and turn of the normal, in standard
/// deviations, together are above @a limit. Noises as in noisyMisfit().
std::size_t countUnlikely(const LocalFit& fit, const CellPoints& points, double noise,
                          double normalNoise, double limit);

/// Largest distance between the points and the zero set of @a fit in the ball of @a radius about
/// @a center (relative to the points' center): of 15 probes, moved onto it by two Newton steps,
/// those within 0.85 radius count. If there is none, it is the distance from the center's foot to
/// the nearest point, less 0.25 of the foot's distance from the center. A gap up to @a enough may
/// be returned as any smaller one.
double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& center, double radius,
                  double enough);

/// Largest @a of(foot) over the places on the zero set of @a fit at which zeroSetGap() measures.
double largestOnZeroSet(const LocalFit& fit, const Vec3d& center, double radius,
                        const std::function<double(const Vec3d&)>& of);

/// zeroSetGap() for a ball without points, in which a fit is extrapolated. The distance of a foot
/// past the rim of the points is added four times: a gap between random samples has points all
/// around it, a hole has them on one side.
double zeroSetGapBeyond(const LocalFit& fit, const CellPoints& points, const Vec3d& center,
                        double radius, double enough);

} // namespace mpuvdb
