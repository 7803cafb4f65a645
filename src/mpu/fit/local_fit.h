// The three kinds of local fit [Ohtake03 §4]: pure functions of a cell's points.
#pragma once
#include "cell_points.h"
#include "quadric.h"

#include <optional>
#include <vector>

namespace mpuvdb
{

/// What the fits need besides the points.
struct FitSettings {
    double tolerance = 0; ///< world units
    double noise = 0;     ///< standard deviation of the points, world units; 0: they are exact
    /// Positions are off by as much at this distance from where a normal's tilt is known; 0:
    /// normals only orient. World units.
    double lever = 0;
    double normalNoise = 0; ///< standard deviation of the normals, radians; 0: unknown
    /// Of the points that count, across the surface, world units; above 0 where noise hides its
    /// feet: fits are then made again of the points over their feet.
    double reach = 0;
    int minPoints = 15;              ///< N_min
    std::size_t fewPoints = 120;     ///< with noise: no more points tell a shape from it
    std::size_t maxSharpPoints = 30; ///< edges and corners are tried up to so many points
};

/// A fit and how good it is.
struct FitResult {
    LocalFit fit;
    double error = 0; ///< max of confidence * |Q| / |grad Q| over points within the test radius
    bool accepted = false;       ///< within tolerance, or all that is left is noise
    bool opposedNormals = false; ///< some normal turns by pi/2 or more from the mean
    bool spreadNormals = false;  ///< the normals turn enough for a feature
    /// Accepted, but exact normals turn away from it, and there are too many for a feature: split
    /// if possible.
    bool turnsAway = false;
    bool needsSplit = false; ///< no auxiliary point was usable [Ohtake03 §4a]: split if possible
};

/// Fit the paper's choice of shape to @a points, error tested within @a testRadius of the center.
/// @param cellSize  edge of the cell, for the auxiliary points of a general quadric.
FitResult fitCell(const CellPoints& points, double cellSize, double testRadius,
                  const FitSettings& settings, CellPoints& scratch);

/// (b) Bivariate quadratic over the plane of the mean normal [Ohtake03 §4b]; a plane for fewer than
/// @a minQuadratic points. With a lever (see FitSettings) also to the slopes that normals tell, as
/// far as they are surer than those of the positions.
Quadric fitBivariate(const CellPoints& points, const Vec3d& normal, std::size_t minQuadratic = 6,
                     double lever = 0);

/// As (b), through the origin exactly: quadratic in the plane of @a normal about it. A plane where
/// the points do not say more.
Quadric fitBivariateThroughOrigin(const CellPoints& points, const Vec3d& normal);

/// (a) General quadric [Ohtake03 §4a eq. 11] with values @a auxValues at @a auxPoints.
Quadric fitGeneral(const CellPoints& points, const std::vector<Vec3d>& auxPoints,
                   const std::vector<double>& auxValues);

/// (c) Edge or corner of up to four faces [Ohtake03 §4c]; nothing if the normals show none.
std::optional<LocalFit> fitSharp(const CellPoints& points, CellPoints& scratch);

/// The same among noise, where normals tell the faces apart: an edge or corner that is much nearer
/// to the points and their normals than @a smooth; else nothing.
std::optional<LocalFit> fitNoisyEdge(const CellPoints& points, const LocalFit& smooth,
                                     const FitSettings& settings, CellPoints& scratch);

/// The two sides of a wall or gap so thin that noise mixes their points: one sheet (b) between
/// them, and how far each is from it. Nothing if the normals are not about one axis, if more than
/// noise is left, or if noise hides which side is above.
std::optional<LocalFit> fitOpposedSheets(const CellPoints& points, double testRadius,
                                         const FitSettings& settings, CellPoints& scratch);

} // namespace mpuvdb
