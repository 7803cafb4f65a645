// Distances to a surface, propagated outwards from its patches.
#pragma once
#include "leaf_distances.h"
#include "surface/surface_patches.h"

#include <functional>
#include <memory>
#include <vector>

namespace mpuvdb
{

/// A finished leaf: voxels, or one value throughout.
struct FinishedLeaf {
    openvdb::Coord origin;
    std::unique_ptr<SurfacePatches::Leaf> leaf; ///< null: a tile
    float tile = 0;                             ///< value of the tile
};

/// Makes a leaf of distances; called from many threads. @a signs, the leaf with the signs, is null
/// in a tile.
using FinishLeaf = std::function<FinishedLeaf(
    const openvdb::Coord& origin, const SurfacePatches::Leaf* signs, const LeafDistances&)>;

/// Propagate the distance to @a patches, made from @a signs, as far as @a reach, and finish each
/// leaf as soon as it is settled, so that its distances need not be kept. Each voxel gets the
/// distance to the closest of its neighbors' closest patches, with its sign in @a signs. The order
/// of the leaves does not depend on the number of threads.
/// @param units  by which the running stage advances, in all. @throws Interrupted.
std::vector<FinishedLeaf> spreadDistances(const openvdb::FloatTree& signs,
                                          const SurfacePatches& patches, const Reach& reach,
                                          const FinishLeaf& finish, Interrupter& progress,
                                          double units);

} // namespace mpuvdb
