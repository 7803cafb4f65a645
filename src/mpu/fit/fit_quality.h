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

/// Largest confidence * |Q| / |grad Q| over the points within @a testRadius [Ohtake03 eq. 7, §6].
double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius);

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
