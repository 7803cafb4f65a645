// Pruning of narrow bands.
#pragma once
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// Turn nodes without active voxels and with values of one sign into tiles of +-background. Unlike
/// openvdb::tools::pruneLevelSet() it looks at all of a node's signs: where a region ends, a node
/// may hold inside and outside without any active voxel.
void pruneBand(openvdb::FloatTree& tree);

} // namespace mpuvdb
