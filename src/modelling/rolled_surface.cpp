#include "rolled_surface.h"

#include "core/parallel_each.h"

#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

/// The depth, in voxels, to which a ball may reach into the surface that it touches: the error of
/// patches, which are not on one smooth surface. [tuned: combine_test]
constexpr float kRoughness = 0.1f;
/// The cosine between the normals of facets at a vertex above which they are one face's. [derived:
/// 26 degrees, below which the chord of a ball's way around an edge errs by 2.5 percent]
constexpr float kOneFace = 0.9f;
/// The distance to the other's surface, voxels, at which creases are. [derived: a voxel's diagonal]
constexpr float kBesideCrease = 1.75f;

} // namespace

RolledSurface::RolledSurface(const BallSolid& solid, double voxelSize, float radius,
                             std::vector<Coord> near, std::vector<const Leaf*> beside,
                             const Coord& frame, Interrupter& progress)
    : mSolid(solid), mScale(solid.side / float(voxelSize)), mRadius(radius), mNear(std::move(near)),
      mPatches(
          surfacePatches(solid.tree, std::move(beside), voxelSize, Values::Distances, progress)),
      mTree(std::make_unique<PatchTree>(mPatches, frame, solid.side, progress))
{
}

void RolledSurface::roll(const RolledSurface& other, float halfWidth, std::vector<Vec3f>& seeds,
                         std::vector<Coord>& unreached, Interrupter& progress)
{
    constexpr std::size_t kGrain = 256; // [free: grain size]
    mContacts.assign(mPatches.patches.size(), BallContact::Unknown);
    std::vector<Ball> balls = gatherParallel<Ball>(
        mPatches.patches.size(), kGrain, progress,
        [&](std::size_t n, std::vector<Ball>& found) { addBalls(std::uint32_t(n), found); });
    forEachParallel(balls.size(), kGrain, progress,
                    [&](std::size_t n) { balls[n].contact = meet(other, balls[n], balls[n].gap); });
    for (const Ball& ball : balls) {
        const Coord voxel = mPatches.patches[ball.patch].voxel;
        // At an edge, where several balls touch: the one that meets least.
        BallContact& contact = mContacts[ball.patch];
        if (contact == BallContact::Unknown || ball.contact < contact) contact = ball.contact;
        if (ball.contact == BallContact::Own) {
            mHasHollows = true;
            mIsTooNarrow |= std::abs(other.valueAt(voxel)) < kBesideCrease;
            continue;
        }
        mRoom.positions.push_back(ball.center);
        mRoom.normals.push_back(ball.normal);
        if (std::abs(ball.gap) < ball.spacing) seeds.push_back(ball.center);
        if (ball.contact == BallContact::Free) {
            mFree.positions.push_back(ball.center);
            mFree.normals.push_back(ball.normal);
        } else if (other.valueAt(voxel) > -halfWidth) {
            unreached.push_back(voxel & ~(int(Leaf::DIM) - 1));
        }
    }
    if (mHasHollows) mRoomTree = std::make_unique<PlaceTree>(mRoom, progress);
}

bool RolledSurface::holds(const Vec3f& p) const
{
    using Access = openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>;
    const Coord& frame = mTree->frame();
    const openvdb::Vec3R at(double(p[0]) + frame[0], double(p[1]) + frame[1],
                            double(p[2]) + frame[2]);
    const Access access(mSolid.tree);
    return mScale * openvdb::tools::BoxSampler::sample(access, at) < 0;
}

float RolledSurface::roomDistance(const Vec3f& p, float most) const
{
    mRoomTree->nearest(mRoom, p, most);
    return most;
}

void RolledSurface::addBalls(std::uint32_t patch, std::vector<Ball>& balls) const
{
    const SurfacePatch& at = mPatches.patches[patch];
    if (mPatches.isSuperseded(patch) ||
        !std::binary_search(mNear.begin(), mNear.end(), at.voxel & ~(int(Leaf::DIM) - 1)))
        return;
    if (mPatches.isVertex(patch)) {
        addBallsAtVertex(patch, balls);
        return;
    }
    const float sharpest =
        std::max({mSolid.side * at.curvature[0], mSolid.side * at.curvature[1], 0.0f});
    addBall(patch, mSolid.side * at.normal, 1 + std::min(sharpest * mRadius, mRadius), balls);
}

/// The balls that touch an edge or a corner: their centers lie on an arc or in a spherical triangle
/// between those that touch its faces.
void RolledSurface::addBallsAtVertex(std::uint32_t vertex, std::vector<Ball>& balls) const
{
    std::vector<Vec3f> faces;
    for (const std::uint32_t* f = mPatches.fanBegin(vertex); f != mPatches.fanEndOf(vertex); ++f)
        for (const std::size_t half : {1, 2}) {
            const Vec3f normal = outwards(mPatches.facets[*f], half);
            const bool isNew = std::none_of(faces.begin(), faces.end(), [&](const Vec3f& face) {
                return face.dot(normal) > kOneFace;
            });
            if (isNew && normal.squaredNorm() > 0) faces.push_back(normal);
        }
    if (faces.size() == 1) addBall(vertex, faces[0], 1, balls);
    const auto steps = [&](const Vec3f& from, const Vec3f& to) {
        return 1 + int(mRadius * std::acos(std::clamp(from.dot(to), -1.0f, 1.0f)));
    };
    const auto addBetween = [&](const Vec3f& from, const Vec3f& to, int count) {
        for (int n = 0; n <= count; ++n) {
            const Vec3f between = from + float(n) / float(count) * (to - from);
            if (between.squaredNorm() > 0) addBall(vertex, between.normalized(), 1, balls);
        }
    };
    if (faces.size() == 2) addBetween(faces[0], faces[1], steps(faces[0], faces[1]));
    for (std::size_t a = 2; a < faces.size(); ++a) { // a fan of triangles
        const int rows = std::max(steps(faces[0], faces[a - 1]), steps(faces[0], faces[a]));
        for (int row = 0; row <= rows; ++row) {
            const float share = float(row) / float(rows);
            addBetween(faces[0] + share * (faces[a - 1] - faces[0]),
                       faces[0] + share * (faces[a] - faces[0]),
                       1 + int(share * float(steps(faces[a - 1], faces[a]))));
        }
    }
}

/// The normal of one of a facet's triangles, from the solid; zero for a sliver.
Vec3f RolledSurface::outwards(const SurfaceFacet& facet, std::size_t half) const
{
    const Vec3f &a = facet.corners[0], &b = facet.corners[half], &c = facet.corners[half + 1];
    const Vec3f normal = (b - a).cross(c - a);
    // [derived: the area of a triangle with the sides of rounding errors]
    constexpr float kSliver = 1e-6f;
    if (!(normal.squaredNorm() > kSliver)) return Vec3f::Zero();
    const Vec3f unit = normal.normalized(), middle = (a + b + c) / 3;
    const auto valueBeside = [&](float by) {
        const Vec3f p = middle + by * unit;
        return valueAt(facet.voxel + Coord(int(std::lround(p[0])), int(std::lround(p[1])),
                                           int(std::lround(p[2]))));
    };
    return valueBeside(1) < valueBeside(-1) ? Vec3f(-unit) : unit;
}

void RolledSurface::addBall(std::uint32_t patch, const Vec3f& normal, float spacing,
                            std::vector<Ball>& balls) const
{
    balls.push_back(
        {patch, mTree->footOf(patch) + mRadius * normal, normal, spacing, BallContact::Unknown, 0});
}

/// @param gap  becomes the distance to the other solid, below 0 where the ball would meet it; not
/// where it would meet its own.
BallContact RolledSurface::meet(const RolledSurface& other, const Ball& ball, float& gap) const
{
    if (holds(ball.center) || mTree->isWithin(ball.center, mRadius - kRoughness))
        return BallContact::Own;
    const float distance = other.mTree->nearest(ball.center, mRadius + ball.spacing).distance;
    gap = (other.holds(ball.center) ? -distance : distance) - mRadius;
    return gap < 0 ? BallContact::Other : BallContact::Free;
}

BallContact RolledSurface::contactAt(const PatchTree::Near& near, const Vec3f& p, float distance,
                                     const RolledSurface& other) const
{
    /// The distance, voxels, from which on the direction from the surface is its normal. [derived:
    /// places err by hundredths of a voxel]
    constexpr float kLeastDistance = 0.5f;
    const BallContact any = mContacts[near.patch];
    if (any == BallContact::Unknown) return any;
    Vec3f normal = mSolid.side * mPatches.patches[near.patch].normal;
    if (std::abs(distance) > kLeastDistance)
        normal = (p - near.place) / distance;
    else if (mPatches.isVertex(near.patch))
        return any;
    float gap = 0;
    return meet(other, {near.patch, near.place + mRadius * normal, normal, 0, any, 0}, gap);
}

} // namespace mpuvdb
