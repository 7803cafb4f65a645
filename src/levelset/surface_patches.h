// The zero set of a level set as small curved patches, one for each voxel beside it.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Progress;
using Vec2f = Eigen::Vector2f;

/// The curvature of a point: its radius is below what counts.
constexpr float kPointCurvature = 1e3f;

/// Where a patch ends at creases: curves in its tangent plane, around the foot.
struct PatchEnds {
    /// The patch goes on to places p, along the tangent and across, with
    /// outward . p <= at - bend/2 (p beside outward)^2; at >= 0.
    struct End {
        Vec2f outward;
        float at;
        float bend;

        /// As a straight line, where it is @a beside what outward points to.
        End straight(float beside) const;
        /// How far a place is from the line through the foot along outward.
        float beside(const Vec2f& place) const
        {
            return outward.x() * place.y() - outward.y() * place.x();
        }
    };
    static constexpr int kMost = 3;
    std::array<End, kMost> ends;
    int count = 0;
    float reach = 0; ///< farther from the foot the patch does not go, voxels

    /// The place within the ends that is nearest to @a place.
    Vec2f nearest(const Vec2f& place) const;
    /// The ends as seen from another place.
    PatchEnds from(const Vec2f& place) const;
};

/// A place on the zero set and how the surface bends there. Lengths are voxels.
struct SurfacePatch {
    openvdb::Coord voxel;          ///< the voxel from whose neighbourhood it was made
    Vec3f foot;                    ///< the place, relative to that voxel
    Vec3f normal;                  ///< unit, outward
    Vec3f tangent;                 ///< unit, along the first principal direction
    float curvature[2];            ///< along the tangent and across, positive where convex
    std::uint32_t ends = kEndless; ///< number of its ends

    static constexpr std::uint32_t kEndless = ~std::uint32_t(0);

    /// From the place to @a at.
    Vec3f to(const openvdb::Coord& at) const
    {
        return Vec3f(float(at[0] - voxel[0]), float(at[1] - voxel[1]), float(at[2] - voxel[2])) -
               foot;
    }
    /// Find the principal curvatures from the Hessian of the distance at @a height above the foot.
    void bend(const Eigen::Matrix3f& hessian, float height);
    /// Distance to the patch, never more than to the place. @param from  see to(). @param side
    /// 1 outside, -1 inside. @param ends  null: there is no crease near.
    float distance(const Vec3f& from, float side, const PatchEnds* ends) const;
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

/// Patches of all voxels with a neighbour of the other sign, by leaf and voxel.
struct SurfacePatches {
    using Leaf = openvdb::FloatTree::LeafNodeType;

    std::vector<const Leaf*> leaves;  ///< all of the tree
    std::vector<std::uint32_t> first; ///< patches of leaf n: [first[n], first[n + 1])
    std::vector<SurfacePatch> patches;
    std::vector<PatchKind> kinds; ///< of the patches
    std::vector<PatchEnds> ends;

    /// From a voxel at @a at on a side (1 outside, -1 inside) to a patch.
    float distance(const SurfacePatch& patch, const openvdb::Coord& at, float side) const
    {
        return patch.distance(patch.to(at), side,
                              patch.ends == SurfacePatch::kEndless ? nullptr : &ends[patch.ends]);
    }
};

/// The patches of @a tree. @param voxelSize  world units. @throws LimitError, Interrupted.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree, double voxelSize, Values values,
                              Progress& progress);

} // namespace mpuvdb
