// The number of voxels that grids of very different voxel sizes take on one lattice.
#pragma once
#include <vector>

namespace mpuvdb
{

/// A grid that is to be resampled.
struct Resampled {
    double voxels = 0;    ///< active voxels
    double voxelSize = 0; ///< world units
    double to = 0;        ///< new voxel size, world units
    double halfWidth = 0; ///< voxels
};

/// Checks the size of a lattice that no user chose. @throws LimitError where @a grids would take
/// more than 64 times the voxels that they have.
void requireFewVoxels(const std::vector<Resampled>& grids);

} // namespace mpuvdb
