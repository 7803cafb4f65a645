#include "ball_room.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;
using Leaf = RolledSurface::Leaf;
using Leaves = std::vector<const Leaf*>;

/// The distance, voxels, by which the center of a ball at one face is nearer than the path if that
/// face hides it: more than such centers err, a voxel apart as they are. [tuned: combine_test]
constexpr float kNearerFace = 0.1f;
/// The largest distance of a leaf's voxels from the middle of all, voxels. [derived: half their
/// diagonal]
constexpr float kHalfLeaf = 6.07f;
/// The cosine between gradients below which surfaces are opposed. [derived: edges sharper than 30
/// degrees]
constexpr float kOpposedCosine = -0.87f;

/// The leaves of a tree with values of less than two voxels, which hold all its patches.
Leaves surfaceLeaves(const FloatTree& tree, double voxelSize)
{
    const auto most = float(2 * voxelSize);
    Leaves leaves;
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) {
        const float* const values = leaf->buffer().data();
        if (std::any_of(values, values + Leaf::SIZE, [&](float v) { return std::abs(v) < most; }))
            leaves.push_back(&*leaf);
    }
    std::sort(leaves.begin(), leaves.end(),
              [](const Leaf* l, const Leaf* r) { return l->origin() < r->origin(); });
    return leaves;
}

/// Those of @a leaves with a place at most @a distance from one in @a others.
Leaves leavesNear(const Leaves& leaves, const Leaves& others, float distance,
                  const Interrupter& progress)
{
    if (others.empty()) return {};
    const Coord frame = others.front()->origin();
    const auto placeOf = [&](const Leaf* leaf) {
        const Coord at = leaf->origin() - frame;
        return Vec3f(float(at[0]), float(at[1]), float(at[2]));
    };
    Places places;
    for (const Leaf* leaf : others) places.positions.push_back(placeOf(leaf));
    places.normals.assign(places.size(), Vec3f::Zero());
    const PlaceTree tree(places, progress);
    Leaves near;
    for (const Leaf* leaf : leaves) {
        float most = distance + 2 * kHalfLeaf + 2;
        if (tree.nearest(places, placeOf(leaf), most) != PlaceTree::kNone) near.push_back(leaf);
    }
    return near;
}

std::vector<Coord> originsOf(const Leaves& leaves)
{
    std::vector<Coord> origins;
    origins.reserve(leaves.size());
    for (const Leaf* leaf : leaves) origins.push_back(leaf->origin());
    return origins;
}

} // namespace

/// The nearest places of both surfaces to a voxel, and their signed distances.
struct BallRoom::Feet {
    PatchTree::Near a, b;
    float distanceA, distanceB;
};

BallRoom::BallRoom(const BallSolid& a, const BallSolid& b, double voxelSize, float radius,
                   float halfWidth, Interrupter& progress)
    : mRadius(radius), mHalfWidth(halfWidth), mFarthest(2 * radius + halfWidth)
{
    const Leaves allA = surfaceLeaves(a.tree, voxelSize), allB = surfaceLeaves(b.tree, voxelSize);
    progress.check();
    const Leaves nearA = leavesNear(allA, allB, 2 * radius, progress);
    const Leaves nearB = leavesNear(allB, allA, 2 * radius, progress);
    if (nearA.empty() || nearB.empty()) return;
    mFrame = nearA.front()->origin();
    const auto surface = [&](const BallSolid& solid, const Leaves& all, const Leaves& near) {
        return std::make_unique<RolledSurface>(solid, voxelSize, radius, originsOf(near),
                                               leavesNear(all, near, 2 * radius, progress), mFrame,
                                               progress);
    };
    mA = surface(a, allA, nearA);
    mB = surface(b, allB, nearB);
    std::vector<Vec3f> seeds;
    mA->roll(*mB, halfWidth, seeds, mUnreached, progress);
    mB->roll(*mA, halfWidth, seeds, mUnreached, progress);
    std::sort(mUnreached.begin(), mUnreached.end());
    mUnreached.erase(std::unique(mUnreached.begin(), mUnreached.end()), mUnreached.end());
    if (mUnreached.empty()) return;
    mPath = std::make_unique<BallPath>(*mA, *mB, radius, std::move(seeds), progress);
    for (const RolledSurface* one : {mA.get(), mB.get()}) {
        const Places& free = one->free();
        mFaces.positions.insert(mFaces.positions.end(), free.positions.begin(),
                                free.positions.end());
        mFaces.normals.insert(mFaces.normals.end(), free.normals.begin(), free.normals.end());
    }
    mFaceTree = std::make_unique<PlaceTree>(mFaces, progress);
}

BallRoom::~BallRoom() = default;

bool BallRoom::isTooNarrow() const
{
    return mA && (mA->isTooNarrow() || mB->isTooNarrow());
}

Vec3f BallRoom::placeOf(const Coord& voxel) const
{
    const Coord at = voxel - mFrame;
    return {float(at[0]), float(at[1]), float(at[2])};
}

BallRoom::Feet BallRoom::feetOf(const Coord& voxel) const
{
    const Vec3f p = placeOf(voxel);
    Feet feet{mA->tree().nearest(p, mFarthest), mB->tree().nearest(p, mFarthest), 0, 0};
    feet.distanceA = std::copysign(feet.a.distance, mA->valueAt(voxel));
    feet.distanceB = std::copysign(feet.b.distance, mB->valueAt(voxel));
    return feet;
}

/// What the ball meets that touches the union's place which is nearest to a voxel.
BallContact BallRoom::contactFor(const Coord& voxel) const
{
    const Feet feet = feetOf(voxel);
    const bool isA = feet.distanceA < feet.distanceB;
    const PatchTree::Near& near = isA ? feet.a : feet.b;
    if (std::min(feet.distanceA, feet.distanceB) >= mRadius) return BallContact::Free;
    if (!near.isFound()) return BallContact::Unknown;
    const Vec3f p = placeOf(voxel);
    return isA ? mA->contactAt(near, p, feet.distanceA, *mB)
               : mB->contactAt(near, p, feet.distanceB, *mA);
}

/// How much farther the ball stays away from a voxel because of one solid's own hollows.
float BallRoom::hollowAt(const Coord& voxel) const
{
    const Feet feet = feetOf(voxel);
    const Vec3f p = placeOf(voxel);
    const auto roomOf = [&](const RolledSurface& one, const PatchTree::Near& near, float distance) {
        const float nearest = mRadius - distance;
        if (!near.isFound() || one.contactAt(near.patch) != BallContact::Own) return nearest;
        return std::max(nearest, one.roomDistance(p, mFarthest));
    };
    return std::max(roomOf(*mA, feet.a, feet.distanceA), roomOf(*mB, feet.b, feet.distanceB)) -
           std::max(mRadius - feet.distanceA, mRadius - feet.distanceB);
}

std::optional<BallRoom::Fill> BallRoom::fillAt(const Coord& voxel, float sharp) const
{
    const Vec3f p = placeOf(voxel);
    const BallPath::Near path = mPath->nearest(p, mFarthest);
    if (path.distance <= mRadius - mHalfWidth) return {};
    const bool isPlain = path.isFound && path.isBeside && path.isBetween &&
                         !isBehindFace(p, path.distance - kNearerFace);
    const float distance = isPlain ? path.distance : faceDistance(p, path.distance);
    float least = std::min(sharp, mHalfWidth);
    // Beyond the rim of a fillet the sharp value is more exact, if it is right.
    if (!isPlain && path.isBeside) least -= kNearerFace;
    if (!(mRadius - distance < least)) return {};
    if (!isPlain) {
        const BallContact contact = contactFor(voxel);
        if (contact == BallContact::Unknown || contact == BallContact::Free) return {};
        if (contact == BallContact::Own && !path.isBeside) least -= kNearerFace;
    }
    const float hollow = mA->hasHollows() || mB->hasHollows() ? hollowAt(voxel) : 0;
    const float value = mRadius - distance + hollow;
    if (!(value < least)) return {};
    return Fill{value, isPlain && hollow == 0};
}

/// Whether a ball that touches one solid alone has its center nearer to @a p than @a distance.
bool BallRoom::isBehindFace(const Vec3f& p, float distance) const
{
    return mFaceTree->nearest(mFaces, p, distance) != PlaceTree::kNone;
}

/// The distance to the face that such centers lie on, if it is less than @a most; else @a most.
float BallRoom::faceDistance(const Vec3f& p, float most) const
{
    /// The extent of the face about a center, voxels. [derived: half the way to the next]
    constexpr float kExtent = 0.5f;
    const std::uint32_t face = mFaceTree->nearest(mFaces, p, most);
    if (face == PlaceTree::kNone) return most;
    const Vec3f from = p - mFaces.positions[face];
    const float height = from.dot(mFaces.normals[face]);
    const float beside = (from - height * mFaces.normals[face]).norm();
    return std::hypot(height, std::max(0.0f, beside - kExtent));
}

BallRoom::Whole BallRoom::wholeLeaf(const Coord& origin) const
{
    constexpr int kHalf = int(Leaf::DIM) / 2; // [derived: half a leaf]
    const Coord middle = origin.offsetBy(kHalf, kHalf, kHalf);
    const Vec3f p = placeOf(middle);
    const float path = mPath->nearest(p, mFarthest).distance;
    if (path + kHalfLeaf + 1 <= mRadius - mHalfWidth) return Whole::Kept;
    const bool isFull = faceDistance(p, path) - kHalfLeaf - 1 >= mRadius + mHalfWidth &&
                        !mA->hasHollows() && !mB->hasHollows() &&
                        contactFor(middle) == BallContact::Other;
    return isFull ? Whole::Full : Whole::Neither;
}

float BallRoom::roomBetween(const Coord& voxel) const
{
    const Feet feet = feetOf(voxel);
    const Vec3f p = placeOf(voxel);
    if (!feet.a.isFound() || !feet.b.isFound()) return 0;
    const Vec3f toA = feet.a.place - p, toB = feet.b.place - p;
    if (toA.dot(toB) > kOpposedCosine * toA.norm() * toB.norm()) return 0;
    return std::min(feet.distanceA, feet.distanceB);
}

} // namespace mpuvdb
