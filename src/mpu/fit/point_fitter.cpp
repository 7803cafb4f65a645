#include "point_fitter.h"

#include <cstring>

namespace mpuvdb
{
namespace
{

/// Radius of a fit's ball per distance of its last neighbor, whose weight would be 0 on the border.
/// [tuned: interpolation_test]
constexpr double kBallMargin = 1.2;

/// Radius, in parts of the ball, within which neighbors weigh alike; beyond, weights fall with the
/// square of the distance. [tuned: interpolation_test]
constexpr double kEqualWeightRadius = 0.2;

Vec3f positionOf(const PointBatch& batch, std::size_t n)
{
    return {batch.x[n], batch.y[n], batch.z[n]};
}

Vec3d normalOf(const PointBatch& batch, std::size_t n)
{
    return Vec3d(batch.nx[n], batch.ny[n], batch.nz[n]);
}

} // namespace

std::size_t PointFitter::Hash::operator()(const Key& key) const
{
    std::uint32_t bits[3];
    const Vec3f plusZero = key.at + Vec3f::Zero(); // -0 equals 0
    std::memcpy(bits, plusZero.data(), sizeof bits);
    std::uint64_t h = (bits[0] | std::uint64_t(bits[1]) << 32) * 0x9e3779b97f4a7c15ull;
    h = (h ^ h >> 29 ^ bits[2]) * 0x9e3779b97f4a7c15ull;
    return std::size_t(h ^ h >> 32);
}

std::size_t PointFitter::pointsIn(const OctreeCell& cell, const PointBatch& ball,
                                  std::array<std::size_t, 2>& found) const
{
    std::size_t count = 0;
    for (std::size_t n = 0; n < ball.size() && count < found.size(); ++n)
        if (mRoot.holds(cell, positionOf(ball, n).cast<double>())) found[count++] = n;
    return count;
}

/// Collect the nearest neighbors of @a at; returns the distance of the last.
double PointFitter::gatherNearest(const Vec3d& at, const OctreeCell& cell,
                                  const std::vector<Ball>& path)
{
    for (std::size_t up = path.size(); up-- > 0;) {
        const Ball& ball = path[up];
        if (ball.batch->size() < mMinPoints) continue;
        const double last = mFilter.nearest(*ball.batch, at, mMinPoints, mNear);
        if (last + (at - ball.center).norm() < ball.radius) return last;
    }
    const Vec3d center = mRoot.center(cell);
    for (double radius = 2 * path.front().radius;; radius *= 2) {
        mPoints.gather(mPoints.around(cell, radius), 1, mFilter, mWide);
        const bool all = mWide.size() == mPoints.size();
        if (mWide.size() < mMinPoints && !all) continue;
        const double last = mFilter.nearest(mWide, at, mMinPoints, mNear);
        if (all || last + (at - center).norm() < radius) return last;
    }
}

/// Fit to mNear, with larger weights near the point: where neighbors' fits miss it, the surface
/// gets a dimple. Points that face the other way are of another sheet.
Quadric PointFitter::fitNear(const Vec3f& at, const Vec3d& normal, double radius)
{
    mCell.assign(mNear, at.cast<double>(), radius);
    const double near2 = kEqualWeightRadius * kEqualWeightRadius * radius * radius;
    for (std::size_t i = 0; i < mCell.count; ++i)
        mCell.weight[i] *= std::max(mCell.normal(i).dot(normal), 0.0) * near2 /
                           (mCell.position(i).squaredNorm() + near2);
    const Vec3d mean = meanNormal(mCell);
    return fitBivariateThroughOrigin(mCell, mean.dot(normal) > 0 ? mean : normal);
}

PointFitter::PointFit PointFitter::fitThrough(std::size_t n, const OctreeCell& cell,
                                              const std::vector<Ball>& path, OctreeDraft& tree)
{
    const PointBatch& ball = *path.back().batch;
    const Vec3f at = positionOf(ball, n);
    const auto [entry, isNew] = mFits.try_emplace(Key{at});
    if (isNew) {
        const double last = gatherNearest(at.cast<double>(), cell, path);
        const double radius = kBallMargin * std::max(last, std::numeric_limits<double>::min());
        entry->second = {tree.addFitThrough(at, fitNear(at, normalOf(ball, n), radius)), radius};
    }
    return entry->second;
}

std::uint32_t PointFitter::fitWithin(const PointBatch& ball, std::size_t n, double radius,
                                     const PointBatch& around, OctreeDraft& tree)
{
    const Vec3f at = positionOf(ball, n);
    mFilter.ball(around, at.cast<double>(), radius, mNear);
    return tree.addFitThrough(at, fitNear(at, normalOf(ball, n), radius));
}

} // namespace mpuvdb
