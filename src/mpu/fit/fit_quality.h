// How good a local fit is: near its points, free of a pattern, and nowhere far from the data.
#pragma once
#include "cell_points.h"
#include "quadric.h"

namespace mpuvdb
{

/// Largest confidence * |Q| / |grad Q| over the points within @a testRadius [Ohtake03 eq. 7, §6].
double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius);

/// Whether what @a fit leaves of the points within @a testRadius looks like noise of standard
/// deviation @a noise (up to twice that: local noise differs), and not like a shape that it misses:
/// the means over sixteen parts of the ball scatter no more than such noise lets them.
bool residualsAreNoise(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise);

/// Root mean square of what the residuals are beside noise: what they have in common in parts of
/// the ball, and scatter far louder than the noise.
double residualPattern(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise);

/// Weighted mean over the points of the squares of residuals, and of the turns of normals, both in
/// standard deviations and of each no more than 9 (it may be no point of the surface): about 3 for
/// a fit that is right. @param normalNoise  radians, about each of two axes; above 0, as @a noise.
double noisyMisfit(const LocalFit& fit, const CellPoints& points, double noise, double normalNoise);

/// How far from the points the zero set of @a fit ventures where it rules the ball of @a radius
/// about @a center (relative to the points' center): from 15 probes two Newton steps lead onto it;
/// of those that land within 0.85 radius the largest distance to the nearest point. If none lands,
/// what the fit says of the ball is its distance from the middle's foot: how far that is from the
/// nearest point, less 0.25 of its distance from the middle.
/// A gap up to @a enough may be told as any smaller one.
double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& center, double radius,
                  double enough);

/// The same for a ball without points, which a fit rules by carrying on what others say. How far
/// a foot lies past the rim of the points counts four times more: a gap between random samples has
/// points all around it, a hole has them on one side.
double zeroSetGapBeyond(const LocalFit& fit, const CellPoints& points, const Vec3d& center,
                        double radius, double enough);

} // namespace mpuvdb
