// What grids of voxels of very different sizes come to on one lattice.
#pragma once
#include <vector>

namespace mpuvdb
{

/// A grid that is to be resampled.
struct Resampled {
    double voxels = 0;    ///< active
    double voxelSize = 0; ///< world units
    double to = 0;        ///< the new voxels' size, world units
    double halfWidth = 0; ///< voxels
};

/// @throws LimitError where @a grids would take more than 64 times the voxels that they have, on
/// voxels that nobody chose. [derived: 8 x 8, where each voxel of a surface becomes a face of
/// OpenVDB's leaves, that is, where the new lattice holds nothing of the grid but interpolation]
void demandFewVoxels(const std::vector<Resampled>& grids);

} // namespace mpuvdb
