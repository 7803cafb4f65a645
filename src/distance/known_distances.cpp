#include "known_distances.h"

#include "spatial/point_triangle.h"

#include <algorithm>
#include <limits>

namespace mpuvdb
{
using openvdb::Coord;

/// The minimum of the distances that are offered for a voxel.
class KnownDistances::Nearest
{
public:
    Nearest(const Coord& voxel, float distance2)
        : mVoxel(voxel), mDistance2(distance2), mDistance(std::sqrt(distance2))
    {
    }
    float distance() const { return mDistance; }
    void offer(float distance) { mDistance = std::min(mDistance, distance); }
    /// @param number  of the facet, which every vertex of it offers.
    void offer(const SurfaceFacet& facet, std::uint32_t number)
    {
        const Coord d = mVoxel - facet.voxel;
        const Vec3f at{float(d[0]), float(d[1]), float(d[2])};
        const float beyond = mDistance + facet.radius;
        if ((at - facet.middle()).squaredNorm() >= beyond * beyond) return;
        const auto end = mTried.begin() + mTriedCount;
        if (std::find(mTried.begin(), end, number) != end) return;
        if (mTriedCount < mTried.size()) mTried[mTriedCount++] = number;
        const auto& p = facet.corners;
        const float d2 = std::min(squaredDistance<float>(at, {p[0], p[1], p[2]}),
                                  squaredDistance<float>(at, {p[0], p[2], p[3]}));
        if (d2 < mDistance2) mDistance = std::min(mDistance, std::sqrt(d2));
        mDistance2 = std::min(mDistance2, d2);
    }

private:
    Coord mVoxel;
    float mDistance2, mDistance;
    std::array<std::uint32_t, 16> mTried; ///< facets offered before
    std::size_t mTriedCount = 0;
};

float KnownDistances::at(int voxel) const
{
    const std::uint32_t patch = mKnown.patch[std::size_t(voxel)];
    const float side = mKnown.isNegative(voxel) ? -1.0f : 1.0f;
    if (patch == kNoPatch) return side * kInfinity;
    if (mSurface.isVertex(patch)) return side * distanceToFacets(voxel, side);
    return side * distanceToPatch(patch, mOrigin + ClosestPatches::coordOf(voxel), side);
}

float KnownDistances::atMost(int voxel) const
{
    const auto n = std::size_t(voxel);
    const bool found = mKnown.patch[n] != kNoPatch;
    const float distance = found ? std::sqrt(mKnown.distance2[n]) : kInfinity;
    return mKnown.isNegative(voxel) ? -distance : distance;
}

float KnownDistances::distanceToPatch(std::uint32_t patch, const Coord& at, float side) const
{
    const SurfacePatch& p = mSurface.patches[patch];
    return p.distance(p.to(at), side);
}

/// The nearest vertex need not belong to the nearest facet: the closest patches of the voxel's
/// neighbors in the leaf count too.
float KnownDistances::distanceToFacets(int voxel, float side) const
{
    const Coord at = ClosestPatches::coordOf(voxel), place = mOrigin + at;
    Nearest nearest(place, mKnown.distance2[std::size_t(voxel)]);
    std::array<std::uint32_t, 28> seen;
    auto end = seen.begin();
    const auto offer = [&](std::uint32_t patch) {
        if (patch == kNoPatch || std::find(seen.begin(), end, patch) != end) return;
        *end++ = patch;
        if (mSurface.isVertex(patch))
            offerFan(patch, nearest);
        else
            nearest.offer(distanceToPatch(patch, place, side));
    };
    offer(mKnown.patch[std::size_t(voxel)]);
    for (int n = 0; n < 27; ++n) {
        const Coord to = at.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
        if (((to[0] | to[1] | to[2]) & ~(kBlockDim - 1)) == 0)
            offer(mKnown.patch[SurfacePatches::Leaf::coordToOffset(to)]);
    }
    return nearest.distance();
}

void KnownDistances::offerFan(std::uint32_t vertex, Nearest& nearest) const
{
    for (const std::uint32_t* f = mSurface.fanBegin(vertex); f != mSurface.fanEndOf(vertex); ++f)
        nearest.offer(mSurface.facets[*f], *f);
}

} // namespace mpuvdb
