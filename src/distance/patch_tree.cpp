#include "patch_tree.h"

#include "spatial/nearest_place.h"

#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

std::vector<std::uint32_t> standing(const SurfacePatches& patches)
{
    std::vector<std::uint32_t> numbers;
    numbers.reserve(patches.patches.size());
    for (std::uint32_t n = 0; n < patches.patches.size(); ++n)
        if (!patches.isSuperseded(n)) numbers.push_back(n);
    return numbers;
}

Places feetOf(const SurfacePatches& patches, const std::vector<std::uint32_t>& numbers,
              const openvdb::Coord& frame)
{
    Places feet;
    feet.positions.reserve(numbers.size());
    feet.normals.reserve(numbers.size());
    for (const std::uint32_t n : numbers) {
        feet.positions.push_back(-patches.patches[n].to(frame));
        feet.normals.push_back(patches.patches[n].normal);
    }
    return feet;
}

} // namespace

PatchTree::PatchTree(const SurfacePatches& patches, const openvdb::Coord& frame, float side,
                     const Interrupter& progress)
    : mPatches(patches), mFrame(frame), mSide(side), mPatchOf(standing(patches)),
      mFeet(feetOf(patches, mPatchOf, frame)), mTree(mFeet, progress)
{
    std::vector<std::uint32_t> inOrder;
    inOrder.reserve(mPatchOf.size());
    for (const std::uint32_t n : mTree.order()) inOrder.push_back(mPatchOf[n]);
    mPatchOf.swap(inOrder);
}

Vec3f PatchTree::footOf(std::uint32_t patch) const
{
    return -mPatches.patches[patch].to(mFrame);
}

PatchTree::Near PatchTree::nearest(const Vec3f& p, float most) const
{
    Near near{most, Vec3f::Zero()};
    const std::uint32_t found = mTree.nearest(mFeet, p, near.distance);
    if (found == PlaceTree::kNone) return near;
    const Vec3f foot = mFeet.positions[found];
    near.patch = mPatchOf[found];
    near.place = mPatches.isVertex(near.patch)
                     ? nearestOfFan(p, near.patch)
                     : Vec3f(foot + mPatches.patches[near.patch].nearest(p - foot, mSide));
    near.distance = (p - near.place).norm();
    return near;
}

bool PatchTree::isWithin(const Vec3f& p, float distance) const
{
    float reach = distance;
    mTree.search([&](const PlaceTree::Node& node) { return node.squaredDistance(p, reach); },
                 [&](std::uint32_t n) {
                     if ((mFeet.positions[n] - p).squaredNorm() < reach * reach) reach = 0;
                 });
    return reach < distance;
}

/// The nearest place of the facets about a vertex.
Vec3f PatchTree::nearestOfFan(const Vec3f& p, std::uint32_t vertex) const
{
    double least = std::numeric_limits<double>::max();
    Vec3f place = footOf(vertex);
    for (const std::uint32_t* f = mPatches.fanBegin(vertex); f != mPatches.fanEndOf(vertex); ++f) {
        const SurfaceFacet& facet = mPatches.facets[*f];
        const openvdb::Coord from = facet.voxel - mFrame;
        const Vec3d shift(from[0], from[1], from[2]), at = p.cast<double>() - shift;
        std::array<Vec3d, 4> corners;
        for (std::size_t n = 0; n < 4; ++n) corners[n] = facet.corners[n].cast<double>();
        for (const std::size_t n : {1, 2}) {
            const NearestPlace near(at, {corners[0], corners[n], corners[n + 1]});
            const double squared = (near.place - at).squaredNorm();
            if (!(squared < least)) continue;
            least = squared;
            place = (near.place + shift).cast<float>();
        }
    }
    return place;
}

} // namespace mpuvdb
