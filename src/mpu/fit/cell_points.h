// What local fits work on: the points of one cell, in double precision about its center.
#pragma once
#include "mpu/octree/point_batch.h"
#include "quadric.h"

#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The points of one cell's ball about the cell's center, with the weights of the fit. Padded to
/// whole SIMD groups with the last point again, of weight and confidence 0.
struct CellPoints {
    static constexpr std::size_t kGroup = 4;

    UnsetVector<double> x, y, z, nx, ny, nz;
    UnsetVector<double> weight; ///< confidence * b(1.5 |y| / radius) [Ohtake03 eq. 3, §6]
    UnsetVector<double> confidence;
    std::size_t count = 0; ///< without the padding
    double radius = 0;     ///< of the (grown) ball

    /// Take @a batch (all of it inside the ball) relative to @a center.
    void assign(const PointBatch& batch, const Vec3d& center, double ballRadius);
    /// Weigh by the distance from the line through the center along @a normal instead of from the
    /// center: of points that noise spreads along the normal those near the center would count
    /// more, and the fit would come to meet it. 0 from @a reach on.
    void weightLaterally(const Vec3d& normal, double reach);
    /// Put every point nearer than @a farthest to the zero set of @a q above its foot there: along
    /// @a normal, by as much as that is above the zero set as the point is off its foot. A point
    /// that noise throws along a curved surface's normal is then seen where it came from.
    void projectLaterally(const Quadric& q, const Vec3d& normal, double farthest);
    /// Take the points @a members of @a other.
    void assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members);

    /// Make room for @a n points; once they are written, pad().
    void setCount(std::size_t n);
    void pad();

    std::size_t paddedCount() const { return x.size(); }
    Vec3d position(std::size_t i) const { return {x[i], y[i], z[i]}; }
    Vec3d normal(std::size_t i) const { return {nx[i], ny[i], nz[i]}; }
};

/// Normalised weighted mean of the normals; +z where they cancel.
Vec3d meanNormal(const CellPoints& points);

} // namespace mpuvdb
