// Distances to a surface, carried outwards from its patches.
#pragma once
#include "surface/surface_patches.h"

#include <functional>
#include <memory>
#include <vector>

namespace mpuvdb
{

/// How far from the surface distances are wanted, voxels; 0: not on that side.
struct Reach {
    float outside = 0, inside = 0;
};

constexpr std::uint32_t kNoPatch = ~std::uint32_t(0);

/// Signed distances of a leaf's voxels, in voxels; +-infinity beyond the reach. They are found as
/// they are asked for, by one thread.
class LeafDistances
{
public:
    virtual ~LeafDistances() = default;
    virtual float at(int voxel) const = 0;
    /// No nearer to zero, and found at once.
    virtual float atMost(int voxel) const = 0;
    /// The patch with the nearest foot, by its number; kNoPatch beyond the reach.
    virtual std::uint32_t patch(int voxel) const = 0;
};

/// What becomes of a leaf: voxels, or one value throughout.
struct FinishedLeaf {
    openvdb::Coord origin;
    std::unique_ptr<SurfacePatches::Leaf> leaf; ///< or none
    float tile = 0;                             ///< where there is no leaf
};

/// Turns distances into what is wanted of them; called from many threads. The leaf that gives the
/// signs is null in a tile.
using FinishLeaf = std::function<FinishedLeaf(
    const openvdb::Coord& origin, const SurfacePatches::Leaf* signs, const LeafDistances&)>;

/// Carry the distance to @a patches, made from @a signs, as far as @a reach, and finish each leaf
/// within as soon as it is settled, so that its distances need not be kept. Each voxel gets the
/// distance to the nearest of the patches that its neighbors know, with the sign it has in
/// @a signs. The leaves come in an order that does not depend on the number of threads.
/// @param units  by which the running stage advances, in all. @throws Interrupted.
std::vector<FinishedLeaf> spreadDistances(const openvdb::FloatTree& signs,
                                          const SurfacePatches& patches, const Reach& reach,
                                          const FinishLeaf& finish, Interrupter& progress,
                                          double units);

} // namespace mpuvdb
