// Volume and area of a level set's solid, in one pass.
#pragma once
#include "grid/block_parts.h"

#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// Share of the volume of a ball four voxels across, the smallest that a band resolves, that linear
/// interpolation may remove.
/// [derived: (|k| + |l|) h^2 / 8 over its surface, by its volume, at a radius of 2 h]
constexpr double kSmallBallShare = 3.0 / 16;

struct SolidSums {
    double volume = 0, area = 0; ///< cubed and squared: voxels of a leaf, world units of a solid
};

/// Volume and area in one leaf, voxels: sums over voxels as if a plane passed each at its distance.
/// Second order where values are distances; parts between voxels are missed. Voxels without a face
/// neighbor of the other sign, as beside edges and in gaps, count as a whole or not at all.
/// @param inside  the leaf's inside voxels.
SolidSums sumLeaf(const openvdb::FloatTree::LeafNodeType& leaf, const SignWords& inside,
                  const openvdb::FloatTree& tree, float voxelSize);

} // namespace mpuvdb
