// Contiguous copies of the points near a cell.
#pragma once
#include "unset_vector.h"
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Neighbors of a point that its spacing is measured with. [tuned: coverage_test]
constexpr std::size_t kSpacingNeighbors = 12;

/// Points that somebody else holds, one array per coordinate, local coordinates.
struct PointArrays {
    const float *x = nullptr, *y = nullptr, *z = nullptr;
    const float *nx = nullptr, *ny = nullptr, *nz = nullptr, *confidence = nullptr;
    std::size_t count = 0;

    std::size_t size() const { return count; }
};

/// Points near a cell, one array per coordinate, local coordinates.
struct PointBatch {
    using Floats = UnsetVector<float>;

    Floats x, y, z, nx, ny, nz, confidence;

    operator PointArrays() const // NOLINT: implicit, as of a string
    {
        return {x.data(),  y.data(),  z.data(),          nx.data(),
                ny.data(), nz.data(), confidence.data(), size()};
    }
    std::size_t size() const { return x.size(); }
    void clear()
    {
        forEach([](Floats& a) { a.clear(); });
    }
    /// Change the size; new points are unset.
    void resize(std::size_t n)
    {
        forEach([n](Floats& a) { a.resize(n); });
    }
    std::size_t bytes() const { return 7 * sizeof(float) * x.capacity(); }

    template <typename F>
    void forEach(F f)
    {
        f(x), f(y), f(z), f(nx), f(ny), f(nz), f(confidence);
    }
};

/// Selection of points of a batch, with the scratch memory of one thread.
class BatchFilter
{
public:
    /// Copy to @a out the points of @a from within @a radius of @a center.
    void ball(const PointArrays& from, const Vec3d& center, double radius, PointBatch& out);
    /// ball() for the eight centers @a center +- @a half along each axis; octant bits: x, y, z.
    void octants(const PointArrays& from, const Vec3d& center, double half, double radius,
                 std::array<PointBatch, 8>& out);
    /// Copy to @a out the @a count (above 0) points of @a from nearest to @a center, and up to half
    /// as many more (or all at equal distance). @return an upper bound of their distances.
    double nearest(const PointArrays& from, const Vec3d& center, std::size_t count,
                   PointBatch& out);
    /// Index of the point of @a from (not empty) nearest to @a center; the first of several.
    std::size_t nearestOf(const PointArrays& from, const Vec3d& center);
    /// Copy to @a out the points in the least ball of radius @a radius (1 + n @a growth), 0 < n <=
    /// @a most, that holds @a wanted points. @return n; 0, with @a out unchanged, if there is none.
    int grownBall(const PointArrays& from, const Vec3d& center, double radius, double growth,
                  int most, std::size_t wanted, PointBatch& out);
    /// Copy to @a out every @a stride th point.
    void strided(const PointArrays& from, std::size_t stride, PointBatch& out);
    /// Append to @a out the points begin, begin + stride, ... below @a end within the ball.
    void appendBall(const PointArrays& from, std::size_t begin, std::size_t end, std::size_t stride,
                    const Vec3d& center, double radius, PointBatch& out);
    /// Spacing of the points: median of sqrt(pi/k) d over a few points near the middle of the ball,
    /// where k >= kSpacingNeighbors neighbors are within d. 0 for too few points.
    double spacing(const PointArrays& ball, const Vec3d& center, double radius);

private:
    void select(float below);
    void append(const PointArrays& from, PointBatch& out) const;
    void appendMarked(const PointArrays& from, std::size_t begin, std::uint32_t bits,
                      PointBatch& out) const;

    PointBatch::Floats mDistance2;
    UnsetVector<std::uint32_t> mMask, mIndices;
    std::size_t mSelected = 0; ///< number of indices in use
};

} // namespace mpuvdb
