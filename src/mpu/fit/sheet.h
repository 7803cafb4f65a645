// One sheet of a noisy surface: a quadric fitted to the points that are probably of it.
#pragma once
#include "bivariate_system.h"
#include "cell_points.h"
#include "quadric.h"

#include <cmath>
#include <vector>

namespace mpuvdb
{

/// Least noise of normals that weighs them, radians: a quadratic cannot follow all slopes of a
/// shape. [tuned: noise_bench]
constexpr double kMinNormalNoise = 0.04;

/// Scatter of a cloud's points about the surface.
struct PointNoise {
    double sigma = 0; ///< standard deviation along the surface's normal, world units, above 0
    double tau = 0;   ///< standard deviation of normals about each of two axes, radians, above 0
    /// Distance, world units, at which the noise of a normal's tilt moves a height by sigma; 0:
    /// normals only tell sheets apart, as they are estimated from the positions.
    double lever = 0;
    /// Standard deviation of points along the surface, world units: it moves what is curved.
    double tangential = 0;
    /// Distance, world units, by which a sheet may differ from the surface that it stands for.
    double tolerance = 0;

    /// Standard deviation of points about a sheet, world units.
    double spread() const { return std::hypot(sigma, tolerance); }
};

/// Residuals of points about a sheet, summed for estimates of their noise.
struct NoiseSums {
    double count = 0, squares = 0; ///< weighted: of the points, and of their squared distances
    double unknowns = 0;           ///< of the sheet
    /// Squared turns of normals y about both axes, and per tangential variance x, the sum of the
    /// squared curvatures where a point is: sums of 1, x, y, xx, xy.
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;

    NoiseSums& operator+=(const NoiseSums& other);
};

/// Sum of the squares of a point's distance from a sheet and of the turn of its normal, both in
/// standard deviations, above which it is not of the sheet. [derived: chi-square of three with a
/// probability of 2e-4, so that none of a ball's few hundred points is lost by chance]
constexpr double kUnlikely = 20;

/// A quadric over a plane, and how well the points determine it. About the points' center.
struct Sheet {
    Quadric q;
    Vec3d axis = Vec3d::UnitZ(); ///< normal of the plane
    double count = 0;            ///< effective number of points
    double unknowns = 3;         ///< coefficients that were fitted

    /// Variance of the height at @a y, in sigma squared.
    double variance(const Vec3d& y) const;
    /// The same sheet about the place @a y.
    Sheet about(const Vec3d& y) const;
    /// variance() at @a y by the mean variance at the points: about 1 among them, growing with a
    /// power of the distance beyond.
    double extrapolation(const Vec3d& y) const { return variance(y) * count / unknowns; }

    Vec3d origin = Vec3d::Zero(); ///< of the normal equations
    double scale = 1;             ///< 1 / length, of the normal equations
    /// Covariance of the coefficients of u^2, uv, v^2, u, v, 1, in sigma squared.
    Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Height of a sheet's zero set over @a at along @a axis.
double heightOver(const Sheet& sheet, const Vec3d& at, const Vec3d& axis);

/// The plane through @a point with @a normal, as a sheet.
Sheet planeSheet(const Vec3d& point, const Vec3d& normal);

/// Weigh @a points by confidence, by the distance from the line through the center along the
/// sheet's axis (0 from @a reach on), and by how probably they are of the sheet: by their distance
/// from it and by the turn of their normals.
void weighBySheet(CellPoints& points, const Sheet& sheet, double reach, const PointNoise& noise);

/// Fit a quadric over the plane across @a axis to weighted points and their normals; the plane
/// where curvatures gain less than their coefficients cost (BIC), or points are few.
Sheet fitSheet(const CellPoints& points, const Vec3d& axis, const PointNoise& noise);

/// The sheet that begins as @a seed, grown over @a points by steps of fits to those that are
/// probably of it, from @a start to @a reach. @param scratch  set to the points, weighed.
Sheet growSheet(const CellPoints& points, const Sheet& seed, double start, double reach,
                const PointNoise& noise, CellPoints& scratch);

/// Fit again to the points of a grown sheet, which are in @a scratch, where their feet are: from
/// there noise along a curved surface's normals has moved them.
Sheet overFeet(const Sheet& sheet, double reach, const PointNoise& noise, CellPoints& scratch);

/// The plane of the points of commonest normal among those nearest to the center.
/// @param taken  points that are of other sheets, a flag for each.
/// @param reach  set to the distance of the farthest that is used. @return its count is 0 if too
/// few are left.
Sheet seedSheet(const CellPoints& points, const std::vector<std::uint8_t>& taken,
                const PointNoise& noise, double& reach);

/// Set the flags of points that are probably of @a sheet; returns how many flags are not set then.
std::size_t takePoints(const CellPoints& points, const Sheet& sheet, const PointNoise& noise,
                       std::vector<std::uint8_t>& taken);

/// Sum the residuals of the points of @a sheet within @a reach of the center, across its axis.
NoiseSums residualsOf(const CellPoints& points, const Sheet& sheet, double reach,
                      const PointNoise& noise);

/// Move the zero set of @a sheet back by which tangential noise moves the mean of points on a
/// curved surface outward: half its variance times the sum of the principal curvatures.
void removeTangentialBias(Sheet& sheet, const PointNoise& noise);

} // namespace mpuvdb
