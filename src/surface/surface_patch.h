// Small curved patches of a zero set, and flat facets beside its creases.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Curvature that stands for a point, per voxel. [derived: a radius below the error of distances]
constexpr float kPointCurvature = 1e3f;
/// Difference from the background, relative to it, from which on a value lies beyond the band.
/// [derived: roundings of half floats]
constexpr float kRimTolerance = 1e-3f;
/// Radius of a patch, voxels: about the distance to the next. [tuned: offset_bench]
constexpr float kPatchRadius = 0.9f;
/// Radius of patches of planes and edges beside creases, beyond which the surface turns away,
/// voxels. [tuned: offset_bench]
constexpr float kCreasePatchRadius = 0.2f;

/// A place on the zero set with the surface's curvature there. Lengths are voxels.
struct SurfacePatch {
    openvdb::Coord voxel; ///< the voxel from whose neighborhood it was made
    Vec3f foot;           ///< the place, relative to that voxel
    Vec3f normal;         ///< unit, outward
    Vec3f tangent;        ///< unit, along the first principal direction
    float curvature[2];   ///< along the tangent and across, positive where convex
    float extent;         ///< radius of the patch

    /// A patch of a single point, @a foot from @a voxel.
    static SurfacePatch point(const openvdb::Coord& voxel, const Vec3f& foot);
    /// The vector from the place to @a at.
    Vec3f to(const openvdb::Coord& at) const
    {
        return Vec3f(float(at[0] - voxel[0]), float(at[1] - voxel[1]), float(at[2] - voxel[2])) -
               foot;
    }
    /// Set the tangent to the direction across the normal of the largest second derivative in
    /// @a hessian. @returns the second derivatives along and across it.
    std::array<float, 2> turnTangent(const Eigen::Matrix3f& hessian);
    /// Set the principal curvatures from the Hessian of the distance at @a height above the foot.
    void bend(const Eigen::Matrix3f& hessian, float height);
    /// Distance to the patch, at most that to the place. @param from  see to(). @param side  1
    /// outside, -1 inside.
    float distance(const Vec3f& from, float side) const;
    /// The nearest place of the patch, relative to the foot. @param from  see to(). @param side  1
    /// outside, -1 inside.
    Vec3f nearest(const Vec3f& from, float side) const;
};

/// Meaning of a grid's values.
enum class Values {
    Distances, ///< true distances near the surface
    Implicit   ///< any function with the right zero set
};

/// Shape of the values around a voxel.
enum class PatchKind : std::uint8_t {
    Smooth,
    Plane, ///< on one side of a crease
    Rough  ///< neither
};

/// Two triangles on both sides of the diagonal from the first to the third of four vertices.
struct SurfaceFacet {
    openvdb::Coord voxel;
    std::array<Vec3f, 4> corners; ///< relative to the voxel
    float radius;                 ///< of the ball about the diagonal's middle that holds it

    Vec3f middle() const { return 0.5f * (corners[0] + corners[2]); }
};

/// Patches of all voxels with a neighbor of the other sign, by leaf and voxel. Those beside creases
/// are superseded by the vertices of facets, which follow as patches of single points. Further
/// patches come from refineByShellProjection().
struct SurfacePatches {
    using Leaf = openvdb::FloatTree::LeafNodeType;

    std::vector<const Leaf*> leaves;  ///< all of the tree
    std::vector<std::uint32_t> first; ///< patches of leaf n: [first[n], first[n + 1])
    std::vector<SurfacePatch> patches;
    std::vector<PatchKind> kinds;      ///< of the patches of voxels
    std::vector<char> superseded;      ///< by patch, at least those of voxels; others are false
    std::vector<SurfaceFacet> facets;  ///< together with the patches beside them, the zero set
    std::vector<std::uint32_t> fans;   ///< facets by vertex
    std::vector<std::uint32_t> fanEnd; ///< end in fans of the facets of vertex n

    std::uint32_t voxelPatches() const { return first.back(); }
    bool isVertex(std::uint32_t patch) const
    {
        return patch >= voxelPatches() && patch - voxelPatches() < fanEnd.size();
    }
    /// @{ The facets about a vertex, by their numbers.
    const std::uint32_t* fanBegin(std::uint32_t patch) const
    {
        const std::uint32_t n = patch - voxelPatches();
        return fans.data() + (n == 0 ? 0 : fanEnd[n - 1]);
    }
    const std::uint32_t* fanEndOf(std::uint32_t patch) const
    {
        return fans.data() + fanEnd[patch - voxelPatches()];
    }
    /// @}
    bool isSuperseded(std::uint32_t patch) const
    {
        return patch < superseded.size() && superseded[patch];
    }
};

/// @throws LimitError if there are more @a patches than can be numbered.
void requireIndexable(std::uint64_t patches);

} // namespace mpuvdb
