#include "ball_centres.h"

#include "leaf_crossings.h"

#include <mpuvdb/progress.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;

constexpr int kDim = FloatTree::LeafNodeType::DIM, kHalo = kDim + 2;
constexpr int kStride[3] = {kHalo * kHalo, kHalo, 1};
/// Half the way across a leaf and the voxels around it, and what distances may err.
constexpr float kAcross = 10;
constexpr float kExtent = 0.9f;        ///< how far the boundary is flat about a place
constexpr float kLeastGradient = 0.7f; ///< a shorter one is of two surfaces

} // namespace

/// The places in one leaf.
class BallCentres::Reader
{
public:
    Reader(const Solid& a, const Solid& b, float radius)
        : mA(a.tree), mB(b.tree), mScaleA(a.scale), mScaleB(b.scale), mRadius(radius)
    {
    }

    std::vector<Place> placesIn(const Coord& origin)
    {
        std::vector<Place> places;
        if (!mA.probeConstLeaf(origin) && !mB.probeConstLeaf(origin)) return places;
        if (std::abs(roomAt(origin.offsetBy(kDim / 2))) > kAcross) return places;
        load(origin);
        for (int x = 0; x < kDim; ++x)
            for (int y = 0; y < kDim; ++y)
                for (int z = 0; z < kDim; ++z) addPlaces(Coord(x, y, z), places);
        return places;
    }

private:
    /// How much more room than the ball needs there is.
    float roomAt(const Coord& at) const
    {
        return std::min(mScaleA * mA.getValue(at), mScaleB * mB.getValue(at)) - mRadius;
    }

    /// The same at the leaf's voxels and around them.
    void load(const Coord& origin)
    {
        float* room = mRoom.data();
        for (int x = -1; x <= kDim; ++x)
            for (int y = -1; y <= kDim; ++y)
                for (int z = -1; z <= kDim; ++z) {
                    *room++ = roomAt(origin.offsetBy(x, y, z));
                }
    }

    void addPlaces(const Coord& voxel, std::vector<Place>& places) const
    {
        const int in = (voxel[0] + 1) * kStride[0] + (voxel[1] + 1) * kStride[1] + voxel[2] + 1;
        const float* const here = &mRoom[std::size_t(in)];
        for (int axis = 0; axis < 3; ++axis) {
            const float next = here[kStride[axis]];
            if ((*here < 0) == (next < 0)) continue;
            Place place{toVec(voxel), Vec3f::Zero()};
            place.point[axis] += *here / (*here - next);
            Vec3f gradient;
            for (int k = 0; k < 3; ++k) gradient[k] = 0.5f * (here[kStride[k]] - here[-kStride[k]]);
            const float length = gradient.norm();
            if (length > kLeastGradient) place.normal = gradient / length;
            places.push_back(place);
        }
    }

    openvdb::tree::ValueAccessor<const FloatTree> mA, mB;
    float mScaleA, mScaleB, mRadius;
    std::array<float, std::size_t(kHalo) * kHalo * kHalo> mRoom;
};

BallCentres::BallCentres(const Solid& a, const Solid& b, float radius, float reach,
                         const std::vector<Coord>& origins, Progress& progress)
    : mReach(reach)
{
    const int leaves = (int(std::ceil(reach)) + kDim - 1) / kDim;
    for (int x = -leaves; x <= leaves; ++x)
        for (int y = -leaves; y <= leaves; ++y)
            for (int z = -leaves; z <= leaves; ++z)
                mAround.push_back(Coord(x * kDim, y * kDim, z * kDim));
    std::stable_sort(mAround.begin(), mAround.end(), [](const Coord& l, const Coord& r) {
        return toVec(l).squaredNorm() < toVec(r).squaredNorm();
    });
    std::unordered_set<Coord> wanted;
    const std::size_t there = a.tree.leafCount() + b.tree.leafCount();
    if (origins.size() * mAround.size() > there) { // all that there are is less
        for (const FloatTree* tree : {&a.tree, &b.tree})
            for (auto leaf = tree->cbeginLeaf(); leaf; ++leaf) wanted.insert(leaf->origin());
    } else {
        for (const Coord& origin : origins) {
            progress.check();
            for (const Coord& around : mAround) wanted.insert(origin + around);
        }
    }
    const std::vector<Coord> at(wanted.begin(), wanted.end());
    std::vector<std::vector<Place>> found(at.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, at.size(), 16),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          Reader reader(a, b, radius);
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              found[n] = reader.placesIn(at[n]);
                      });
    for (std::size_t n = 0; n < at.size(); ++n)
        if (!found[n].empty()) mPlaces.emplace(at[n], std::move(found[n]));
}

BallCentres::Search::Search(const BallCentres& centres, const Coord& origin)
    : mReach(centres.mReach), mLast(origin), mLastDistance(centres.mReach)
{
    const auto add = [&](const auto& places) {
        mSources.push_back({places.first, &places.second});
    };
    if (centres.mPlaces.size() > centres.mAround.size()) {
        for (const Coord& around : centres.mAround) {
            const auto places = centres.mPlaces.find(origin + around);
            if (places != centres.mPlaces.end()) add(*places);
        }
    } else {
        for (const auto& places : centres.mPlaces) add(places);
        const auto gap2 = [&](const Source& source) {
            return toVec(source.origin - origin).squaredNorm();
        };
        std::sort(mSources.begin(), mSources.end(), [&](const Source& l, const Source& r) {
            return gap2(l) != gap2(r) ? gap2(l) < gap2(r) : l.origin < r.origin;
        });
    }
}

float BallCentres::Search::distanceFrom(const Coord& voxel, float most, float enough)
{
    constexpr float kSlack = 0.01f; // for rounding
    const float bound = mLastDistance + toVec(voxel - mLast).norm() + kSlack;
    const float limit = std::min({mReach, most, bound});
    float best = limit;
    // What was nearest last time is likely to be so again, and the rest is farther.
    for (std::size_t n = 0; n <= mSources.size() && best > enough; ++n) {
        const std::size_t source = n == 0 ? mNearest : n - 1;
        if (source == mSources.size() || (n > 0 && source == mNearest)) continue;
        const float nearest = nearestIn(mSources[source], voxel, best);
        if (nearest < best) {
            best = nearest;
            mNearest = source;
        }
    }
    if (best < limit) {
        mLast = voxel;
        mLastDistance = best;
    }
    return best;
}

/// The distance to the nearest place of a leaf, or @a best if that is less.
float BallCentres::Search::nearestIn(const Source& source, const Coord& voxel, float best)
{
    constexpr float kRounding = 1 + 1e-5f;
    const Coord r = voxel - source.origin;
    float farthest2 = (best + kExtent) * (best + kExtent), best2 = best * best * kRounding;
    if (squaredGap(r) >= farthest2) return best;
    const Vec3f here = toVec(r);
    for (const Place& place : *source.places) {
        const Vec3f to = here - place.point;
        const float length2 = to.squaredNorm();
        if (length2 >= farthest2) continue;
        float distance = 0;
        if (place.normal == Vec3f::Zero()) {
            distance = std::sqrt(length2);
        } else {
            const float along = place.normal.dot(to), along2 = along * along;
            if (along2 >= best2) continue;
            const float aside = std::sqrt(std::max(length2 - along2, 0.0f));
            const float beyond = std::max(aside - kExtent, 0.0f);
            if (along2 + beyond * beyond >= best2) continue;
            distance = std::hypot(along, beyond);
        }
        if (distance >= best) continue;
        best = distance;
        best2 = best * best * kRounding;
        farthest2 = (best + kExtent) * (best + kExtent);
    }
    return best;
}

} // namespace mpuvdb
