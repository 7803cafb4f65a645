// Whether a level set encloses anything.
#pragma once
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// Whether a voxel or tile is inside. A band without any has no surface: the part that it was made
/// of is so thin that it lies between voxels.
bool hasInside(const openvdb::FloatTree& tree);

} // namespace mpuvdb
