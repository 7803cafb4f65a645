#include "signed_triangles.h"

#include "spatial/nearest_place.h"

#include <cmath>

namespace mpuvdb
{

SignedTriangles::SignedTriangles(Mesh mesh, double same, Interrupter& progress)
    : mMesh(std::move(mesh)), mSame(same), mTree(mMesh, progress)
{
}

std::array<Vec3d, 3> SignedTriangles::cornersOf(std::size_t slot) const
{
    const auto& [a, b, c] = mTree.corners(slot);
    return {a.cast<double>(), b.cast<double>(), c.cast<double>()};
}

Vec3d SignedTriangles::normal(std::size_t slot) const
{
    const auto& [a, b, c] = cornersOf(slot);
    return (b - a).cross(c - a).normalized();
}

SignedTriangles::Near SignedTriangles::nearest(const Vec3d& p, Hint& hint) const
{
    /// Factor of a bound that is the sum of two lengths. [derived: roundings of doubles, squared]
    constexpr double kRoundings = 1 + 1e-12;
    const Vec3d from = p - mMesh.frame;
    const double most = (hint.distance + (p - hint.place).norm()) * kRoundings + mSame;
    std::size_t slot = 0;
    const double square = mTree.squaredDistance(from, most * most, slot);
    hint = {p, std::sqrt(square)};
    return nearOn(slot, from, square);
}

SignedTriangles::Near SignedTriangles::nearest(const Vec3d& p, CellTriangles& gathered) const
{
    const Vec3d from = p - mMesh.frame;
    std::size_t slot = 0;
    const double square = gathered.squaredDistance(from, slot);
    return nearOn(slot, from, square);
}

SignedTriangles::Near SignedTriangles::nearOn(std::size_t slot, const Vec3d& from,
                                              double squaredDistance) const
{
    return {mMesh.frame + NearestPlace(from, cornersOf(slot)).place, std::sqrt(squaredDistance),
            slot};
}

/// By the nearest triangle where it lies straight below p, else by the normals of all that are
/// nearest, weighted with angles [Baerentzen05].
bool SignedTriangles::isBehind(const Vec3d& p, const Near& near) const
{
    const Vec3d from = p - mMesh.frame;
    const double height = normal(near.slot).dot(p - near.place);
    if (std::abs(height) > near.distance - mSame) return height < 0;
    const double farthest = near.distance + mSame;
    double sum = 0;
    mTree.forEachNear(from, farthest, [&](std::size_t slot) {
        const NearestPlace other(from, cornersOf(slot));
        if ((from - other.place).squaredNorm() > farthest * farthest) return;
        sum += other.angle * normal(slot).dot(from - other.place);
    });
    return sum < 0;
}

} // namespace mpuvdb
