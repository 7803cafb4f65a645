// The points of one cell, in double precision about its center, for local fits.
#pragma once
#include "quadric.h"
#include "spatial/point_batch.h"
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Least cosine between a surface's normal and the axis of a height over a plane: steeper parts are
/// left out, or their height is limited. [tuned: noise_bench]
constexpr double kMinHeightCosine = 0.4;

/// The points of one cell's ball about the cell's center, with the weights of the fit. Padded to
/// whole SIMD groups with copies of the last point of weight and confidence 0.
struct CellPoints {
    static constexpr std::size_t kGroup = 4; ///< points of a group [derived: doubles of a Group]

    UnsetVector<double> x, y, z, nx, ny, nz;
    UnsetVector<double> weight; ///< confidence * b(1.5 |y| / radius) [Ohtake03 eq. 3, §6]
    UnsetVector<double> confidence;
    std::size_t count = 0; ///< without the padding
    double radius = 0;     ///< radius of the (grown) ball

    /// Copy @a batch (all of it inside the ball) relative to @a center.
    void assign(const PointBatch& batch, const Vec3d& center, double ballRadius);
    /// Weight by the distance from the line through the center along @a normal, and not from the
    /// center, which would draw the fit towards itself as noise spreads points along the normal. 0
    /// from @a reach on.
    void weightLaterally(const Vec3d& normal, double reach);
    /// Move every point nearer than @a farthest to the zero set of @a q sideways, over its foot
    /// there, with the same distance from the zero set, now along @a normal: to the place from
    /// which noise along a curved surface's normal has moved it.
    void projectLaterally(const Quadric& q, const Vec3d& normal, double farthest);
    /// Copy the points @a members of @a other.
    void assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members);

    /// Make room for @a n points; once they are written, pad().
    void setCount(std::size_t n);
    /// Set the padding.
    void pad();

    std::size_t paddedCount() const { return x.size(); }
    Vec3d position(std::size_t i) const { return {x[i], y[i], z[i]}; }
    Vec3d normal(std::size_t i) const { return {nx[i], ny[i], nz[i]}; }
};

/// Normalized weighted mean of the normals; +z where they cancel.
Vec3d meanNormal(const CellPoints& points);

} // namespace mpuvdb
