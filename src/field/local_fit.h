// The three kinds of local fit [Ohtake03 §4]: pure functions of a cell's points.
#pragma once
#include "quadric.h"
#include "sorted_points.h"

#include <optional>
#include <vector>

namespace mpuvdb
{

/// The points of one cell's ball about the cell's centre, with the weights of the fit. Padded to
/// whole SIMD groups with the last point again, of weight and confidence 0.
struct CellPoints {
    static constexpr std::size_t kGroup = 4;

    std::vector<double> x, y, z, nx, ny, nz;
    std::vector<double> weight; ///< confidence * b(1.5 |y| / radius) [Ohtake03 eq. 3, §6]
    std::vector<double> confidence;
    std::size_t count = 0; ///< without the padding
    double radius = 0;     ///< of the (grown) ball

    /// Take @a batch (all of it inside the ball) relative to @a centre.
    void assign(const PointBatch& batch, const Vec3d& centre, double ballRadius);
    /// Take the points @a members of @a other.
    void assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members);

    /// Make room for @a n points; once they are written, pad().
    void setCount(std::size_t n);
    void pad();

    std::size_t paddedCount() const { return x.size(); }
    Vec3d position(std::size_t i) const { return {x[i], y[i], z[i]}; }
    Vec3d normal(std::size_t i) const { return {nx[i], ny[i], nz[i]}; }
};

/// What the fits need besides the points.
struct FitSettings {
    double tolerance = 0; ///< world units
    double noise = 0;     ///< standard deviation of the points, world units; 0: they are exact
    int minPoints = 15;   ///< N_min
    std::size_t maxSharpPoints = 30; ///< edges and corners are tried up to so many points
};

/// A fit and how good it is.
struct FitResult {
    LocalFit fit;
    double error = 0; ///< max of confidence * |Q| / |grad Q| over points within the test radius
    bool accepted = false;       ///< within tolerance, or all that is left is noise
    bool opposedNormals = false; ///< some normal turns by pi/2 or more from the mean
    bool spreadNormals = false;  ///< the normals turn enough for a feature
    bool needsSplit = false; ///< no auxiliary point was usable [Ohtake03 §4a]: split if possible
};

/// Fit the paper's choice of shape to @a points, error tested within @a testRadius of the centre.
/// @param cellSize  edge of the cell, for the auxiliary points of a general quadric.
FitResult fitCell(const CellPoints& points, double cellSize, double testRadius,
                  const FitSettings& settings, CellPoints& scratch);

/// (b) Bivariate quadratic over the plane of the mean normal [Ohtake03 §4b]; a plane for fewer than
/// @a minQuadratic points.
Quadric fitBivariate(const CellPoints& points, const Vec3d& normal, std::size_t minQuadratic = 6);

/// As (b), through the origin exactly: quadratic in the plane of @a normal about it. A plane where
/// the points do not say more.
Quadric fitBivariateThroughOrigin(const CellPoints& points, const Vec3d& normal);

/// (a) General quadric [Ohtake03 §4a eq. 11] with values @a auxValues at @a auxPoints.
Quadric fitGeneral(const CellPoints& points, const std::vector<Vec3d>& auxPoints,
                   const std::vector<double>& auxValues);

/// (c) Edge or corner of up to four faces [Ohtake03 §4c]; nothing if the normals show none.
std::optional<LocalFit> fitSharp(const CellPoints& points, CellPoints& scratch);

/// Normalised weighted mean of the normals; +z where they cancel.
Vec3d meanNormal(const CellPoints& points);

/// Largest confidence * |Q| / |grad Q| over the points within @a testRadius [Ohtake03 eq. 7, §6].
double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius);

/// Whether what @a fit leaves of the points within @a testRadius looks like noise of standard
/// deviation @a noise (up to twice that: local noise differs), and not like a shape that it misses:
/// the means over sixteen parts of the ball scatter no more than such noise lets them.
bool residualsAreNoise(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise);

/// Square of the distance from @a y to the nearest point, or to some point within sqrt(@a enough);
/// infinite without points.
double nearestSquared(const CellPoints& points, const Vec3d& y, double enough = 0);

/// How far from the points the zero set of @a fit ventures inside the ball of @a radius about
/// @a centre (relative to the points' centre): from 15 probes two Newton steps lead onto it; of
/// those that land within 0.85 radius the largest distance to the nearest point. 0 if none lands.
/// A gap up to @a enough may be told as any smaller one.
double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& centre, double radius,
                  double enough);

} // namespace mpuvdb
