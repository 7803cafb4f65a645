// The volume and the area of a level set's solid, in one quick pass.
#pragma once
#include "grid/block_parts.h"

#include <openvdb/openvdb.h>

namespace mpuvdb
{

struct SolidSums {
    double volume = 0, area = 0; ///< cubed and squared: voxels of a leaf, world units of a solid
};

/// Of one leaf, in voxels: the sums of what each voxel has of them, of which the surface's place
/// between voxels is taken from their distances; second order where these are true, and blind to
/// what passes between voxels. Beside edges and in gaps voxels may be near a surface that does not
/// reach them: these are inside as a whole, or not at all. @param inside  its voxels that are.
SolidSums sumLeaf(const openvdb::FloatTree::LeafNodeType& leaf, const SignWords& inside,
                  const openvdb::FloatTree& tree, float voxelSize);

} // namespace mpuvdb
