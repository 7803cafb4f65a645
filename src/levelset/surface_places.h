// Where on the zero set the voxels of a band belong.
#pragma once
#include <mpuvdb/level_set.h>

namespace mpuvdb
{

/// For each active voxel of @a leaf, in order, the place on the zero set of the level set @a
/// surface that is nearest to it. @a leaf is one of the band's, or of a tree of the same voxels.
std::vector<SurfacePlace> surfacePlaces(const openvdb::FloatGrid& surface, const Lattice& lattice,
                                        const openvdb::FloatTree::LeafNodeType& leaf);

} // namespace mpuvdb
