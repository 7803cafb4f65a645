// The zero set of a level set as small curved patches, one for each voxel beside it.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Progress;

/// The curvature of a point: its radius is below what counts.
constexpr float kPointCurvature = 1e3f;

/// A place on the zero set and how the surface bends there. Lengths are voxels.
struct SurfacePatch {
    openvdb::Coord voxel; ///< the voxel from whose neighbourhood it was made
    Vec3f foot;           ///< the place, relative to that voxel
    Vec3f normal;         ///< unit, outward
    Vec3f tangent;        ///< unit, along the first principal direction
    float curvature[2];   ///< along the tangent and across, positive where convex
    bool bounded = false; ///< there is a crease near: beside the patch the surface may end

    /// From the place to @a at.
    Vec3f to(const openvdb::Coord& at) const
    {
        return Vec3f(float(at[0] - voxel[0]), float(at[1] - voxel[1]), float(at[2] - voxel[2])) -
               foot;
    }
    /// Distance to the patch, never more than to the place. @param from  see to(). @param side
    /// 1 outside, -1 inside.
    float distance(const Vec3f& from, float side) const;
};

/// What a grid's values are.
enum class Values {
    Distances, ///< near the surface, true ones
    Implicit   ///< a function with the right zero set
};

/// What the values around a voxel look like.
enum class PatchKind : std::uint8_t {
    Smooth,
    Plane, ///< on one side of a crease
    Rough  ///< neither
};

/// Patches of all voxels with a neighbour of the other sign, by leaf and voxel, and behind them
/// those on creases and corners: each belongs to a voxel beside it that has a patch of its own.
struct SurfacePatches {
    using Leaf = openvdb::FloatTree::LeafNodeType;

    std::vector<const Leaf*> leaves;  ///< all of the tree
    std::vector<std::uint32_t> first; ///< patches of leaf n: [first[n], first[n + 1])
    std::vector<SurfacePatch> patches;
    std::vector<PatchKind> kinds; ///< of the patches before those on creases
};

/// The patches of @a tree. @param voxelSize  world units. @throws LimitError, Interrupted.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree, double voxelSize, Values values,
                              Progress& progress);

} // namespace mpuvdb
