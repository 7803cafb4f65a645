// The three kinds of local fit [Ohtake03 §4]: pure functions of a cell's points.
#pragma once
#include "cell_points.h"
#include "quadric.h"

#include <optional>
#include <vector>

namespace mpuvdb
{

/// Settings of the fits.
struct FitSettings {
    double tolerance = 0; ///< world units
    double noise = 0;     ///< standard deviation of the points, world units; 0: they are exact
    /// Distance, world units, at which the noise of a normal's tilt moves a height by the noise of
    /// positions; 0: normals only orient.
    double lever = 0;
    double normalNoise = 0;          ///< standard deviation of the normals, radians; 0: unknown
    int minPoints = 15;              ///< N_min
    std::size_t maxSharpPoints = 30; ///< most points of an edge or a corner
};

/// A fit and its quality.
struct FitResult {
    LocalFit fit;
    double error = 0; ///< max of confidence * |Q| / |grad Q| over points within the test radius
    bool accepted = false;       ///< within tolerance, or residuals are noise
    bool opposedNormals = false; ///< some normal turns by pi/2 or more from the mean
    bool spreadNormals = false;  ///< normals turn enough for a feature
    /// Accepted, but exact normals differ from it, and points are too many for a feature: split if
    /// possible.
    bool turnsAway = false;
    bool needsSplit = false; ///< no auxiliary point was usable [Ohtake03 §4a]: split if possible
};

/// Fit the paper's choice of shape to @a points, error tested within @a testRadius of the center.
/// @param cellSize  edge of the cell, for the auxiliary points of a general quadric.
FitResult fitCell(const CellPoints& points, double cellSize, double testRadius,
                  const FitSettings& settings, CellPoints& scratch);

/// (b) Bivariate quadratic over the plane of the mean normal [Ohtake03 §4b]; a plane for fewer than
/// @a minQuadratic points. With a lever (see FitSettings) also to the slopes of the normals.
Quadric fitBivariate(const CellPoints& points, const Vec3d& normal, std::size_t minQuadratic = 6,
                     double lever = 0);

/// Bivariate quadratic as (b), exactly through the origin, over the plane of @a normal; a plane
/// where the points do not determine more.
Quadric fitBivariateThroughOrigin(const CellPoints& points, const Vec3d& normal);

/// (a) General quadric [Ohtake03 §4a eq. 11] with values @a auxValues at @a auxPoints.
Quadric fitGeneral(const CellPoints& points, const std::vector<Vec3d>& auxPoints,
                   const std::vector<double>& auxValues);

/// (c) Edge or corner of up to four faces [Ohtake03 §4c]; nothing if the normals show none.
std::optional<LocalFit> fitSharp(const CellPoints& points, CellPoints& scratch);

} // namespace mpuvdb
