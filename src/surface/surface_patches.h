// The zero set of a level set as small curved patches, one for each voxel beside it; and beside
// creases as flat facets between vertices, some of which lie on the crease.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The curvature of a point: its radius is below what counts.
constexpr float kPointCurvature = 1e3f;

/// A place on the zero set and how the surface bends there. Lengths are voxels.
struct SurfacePatch {
    openvdb::Coord voxel; ///< the voxel from whose neighborhood it was made
    Vec3f foot;           ///< the place, relative to that voxel
    Vec3f normal;         ///< unit, outward
    Vec3f tangent;        ///< unit, along the first principal direction
    float curvature[2];   ///< along the tangent and across, positive where convex
    float extent;         ///< how far around the place it goes

    /// A patch that is but a place, @a foot from @a voxel.
    static SurfacePatch point(const openvdb::Coord& voxel, const Vec3f& foot);
    /// From the place to @a at.
    Vec3f to(const openvdb::Coord& at) const
    {
        return Vec3f(float(at[0] - voxel[0]), float(at[1] - voxel[1]), float(at[2] - voxel[2])) -
               foot;
    }
    /// Lay the tangent along the direction across the normal in which @a hessian bends most;
    /// @returns its second derivatives there and across.
    std::array<float, 2> turnTangent(const Eigen::Matrix3f& hessian);
    /// Find the principal curvatures from the Hessian of the distance at @a height above the foot.
    void bend(const Eigen::Matrix3f& hessian, float height);
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

/// Four vertices in a row: two triangles on both sides of the diagonal from the first to the third.
struct SurfaceFacet {
    openvdb::Coord voxel;
    std::array<Vec3f, 4> corners; ///< relative to the voxel
    float radius;                 ///< of the ball about the diagonal's middle that it lies in

    Vec3f middle() const { return 0.5f * (corners[0] + corners[2]); }
};

/// Patches of all voxels with a neighbor of the other sign, by leaf and voxel. Those beside
/// creases are superseded by the vertices of facets, which follow: patches that are but their foot.
/// After these there may be others, of voxels farther off; see amendBySight().
struct SurfacePatches {
    using Leaf = openvdb::FloatTree::LeafNodeType;

    std::vector<const Leaf*> leaves;  ///< all of the tree
    std::vector<std::uint32_t> first; ///< patches of leaf n: [first[n], first[n + 1])
    std::vector<SurfacePatch> patches;
    std::vector<PatchKind> kinds;      ///< of the patches of voxels
    std::vector<char> superseded;      ///< by patch, at least those of voxels; others are not
    std::vector<SurfaceFacet> facets;  ///< together with the patches beside them, the zero set
    std::vector<std::uint32_t> fans;   ///< facets by vertex
    std::vector<std::uint32_t> fanEnd; ///< those of vertex n end here in fans

    std::uint32_t voxelPatches() const { return first.back(); }
    bool isVertex(std::uint32_t patch) const
    {
        return patch >= voxelPatches() && patch - voxelPatches() < fanEnd.size();
    }
    bool isSuperseded(std::uint32_t patch) const
    {
        return patch < superseded.size() && superseded[patch];
    }
};

/// The same of some of a tree's leaves.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree,
                              std::vector<const SurfacePatches::Leaf*> leaves, double voxelSize,
                              Values values, Interrupter& progress);

/// @throws LimitError if there are more @a patches than can be numbered.
void demandNumbers(std::uint64_t patches);

/// The patches of @a tree. @param voxelSize  world units. @throws LimitError, Interrupted.
SurfacePatches surfacePatches(const openvdb::FloatTree& tree, double voxelSize, Values values,
                              Interrupter& progress);

} // namespace mpuvdb
