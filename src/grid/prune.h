// Bands without nodes that say nothing.
#pragma once
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// Turn nodes without active voxels, all of one sign, into tiles of that sign: background or minus
/// background. Unlike openvdb::tools::pruneLevelSet() it does not take the sign of a node's first
/// voxel for that of all: where a band ends, as that of a region does, a node may hold a part of
/// the inside without any of its surface.
void pruneBand(openvdb::FloatTree& tree);

} // namespace mpuvdb
