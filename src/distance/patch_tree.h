// The nearest place on a surface's patches, from anywhere.
#pragma once
#include "surface/place_tree.h"
#include "surface/surface_patches.h"

namespace mpuvdb
{

/// One side of a surface. Lengths are voxels, places count from a voxel, the frame. All members are
/// safe to call from many threads.
class PatchTree
{
public:
    /// The nearest place of the surface.
    struct Near {
        float distance;
        Vec3f place;
        std::uint32_t patch = PlaceTree::kNone;

        bool isFound() const { return patch != PlaceTree::kNone; }
    };

    /// @param patches  have to outlive this. @param side  from which places look at the surface: 1
    /// outside, -1 inside.
    PatchTree(const SurfacePatches& patches, const openvdb::Coord& frame, float side,
              const Interrupter& progress);

    const openvdb::Coord& frame() const { return mFrame; }
    float side() const { return mSide; }
    const SurfacePatches& patches() const { return mPatches; }
    /// Of a patch, its place on the surface.
    Vec3f footOf(std::uint32_t patch) const;

    /// The nearest place to @a p; none if all feet are at least as far as @a most.
    Near nearest(const Vec3f& p, float most) const;
    /// Whether a foot is nearer to @a p than @a distance.
    bool isWithin(const Vec3f& p, float distance) const;

private:
    Vec3f nearestOfFan(const Vec3f& p, std::uint32_t vertex) const;

    const SurfacePatches& mPatches;
    openvdb::Coord mFrame;
    float mSide;
    std::vector<std::uint32_t> mPatchOf; ///< by place in the tree's order
    Places mFeet;
    PlaceTree mTree;
};

} // namespace mpuvdb
