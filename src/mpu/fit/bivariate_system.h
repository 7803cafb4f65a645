// The normal equations of a height that is quadratic over a plane.
#pragma once
#include "cell_points.h"
#include "quadric.h"

namespace mpuvdb
{

/// Axes of a plane, and its normal w.
struct Frame {
    Vec3d u, v, w;
    explicit Frame(const Vec3d& normal) : w(normal)
    {
        u = w.unitOrthogonal();
        v = w.cross(u);
    }
};

/// Normal equations for w ~ quadratic(u, v) of points (u, v, w), scaled to unit variance in (u, v).
struct BivariateSystem {
    Eigen::Matrix<double, 6, 6> M; ///< basis u^2, uv, v^2, u, v, 1
    Eigen::Matrix<double, 6, 1> r;
    double scale = 0; ///< 1 / length; 0: the points have no extent
};

/// The system of @a points about @a origin, whose weights sum up to @a totalWeight.
BivariateSystem bivariateSystem(const CellPoints& points, const Frame& frame, const Vec3d& origin,
                                double totalWeight);

/// Add the slopes of the points' normals to a system, each weighted as a height at a lever's
/// distance.
void addSlopes(const CellPoints& points, const Frame& frame, const Vec3d& origin,
               double totalWeight, double lever, BivariateSystem& system);

/// Q = w - quadratic(u, v) without its constant, from the solution @a k of a system, in world
/// units.
Quadric heightAbove(const Frame& frame, const Eigen::Matrix<double, 5, 1>& k, double scale);

} // namespace mpuvdb
