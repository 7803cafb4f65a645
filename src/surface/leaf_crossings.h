// Crossings of the surface with the edges between voxels.
#pragma once
#include <mpuvdb/field.h>

#include <algorithm>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

/// Zero crossings on the edges that start in one leaf, voxels from the leaf's origin.
using Crossings = std::vector<Vec3f>;

inline Vec3f toVec(const openvdb::Coord& c)
{
    return {float(c[0]), float(c[1]), float(c[2])};
}

/// Squared distance, voxels, from a voxel at @a from relative to a leaf's origin to the leaf and
/// the edges that start there.
inline float squaredGap(const openvdb::Coord& from)
{
    float gap2 = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto gap = float(std::max({0, -from[axis], from[axis] - kBlockDim}));
        gap2 += gap * gap;
    }
    return gap2;
}

/// Crossings on the edges from active voxels of @a leaf to their upper neighbors, and the voxels of
/// value 0 between inside and outside.
Crossings crossingsOf(const openvdb::FloatTree& tree, const openvdb::FloatTree::LeafNodeType& leaf);

} // namespace mpuvdb
