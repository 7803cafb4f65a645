// Distances to a surface: re-distancing, wider bands, offsets, shells.
#pragma once
#include <mpuvdb/level_set.h>

#include <string>
#include <vector>

namespace mpuvdb
{

/// The same surface with a band of @a halfWidth voxels: values in the old band stay unchanged, new
/// ones are distances (world units) to the surface. Where values are no distances, as outside edges
/// of fits, a wider band keeps those within a voxel of the surface, and goes over to distances.
/// @param halfWidth  in [1.5, 1000].
/// @throws UsageError (half-width), LimitError (number of voxels beside the surface), Interrupted.
LevelSet withHalfWidth(const LevelSet& levelSet, double halfWidth,
                       Interrupter* interrupter = nullptr);

/// The level set of the zero set of @a grid, whose values have the right sign and cross zero
/// between active voxels, but need not be distances. The surface stays in place.
/// @param grid  satisfies LevelSet's constructor. @param halfWidth  voxels, in [1.5, 1000].
/// @throws UsageError (half-width), LimitError (number of voxels beside the surface), Interrupted.
LevelSet redistance(const openvdb::FloatGrid& grid, double halfWidth,
                    Interrupter* interrupter = nullptr);

/// A level set of @a grid whose values are distances: as levelSetFromGrid() takes it, measured anew
/// by redistance() where hasSlopesOfDistances() says that they are none.
/// @param cure  last sentence of an error's text. @param notes  what was mended is appended, and
/// where the band is missing.
/// @throws InputError as levelSetFromGrid() and requireBand(), LimitError as redistance(),
/// Interrupted.
LevelSet distancesFromGrid(const openvdb::FloatGrid::ConstPtr& grid, const std::string& cure,
                           std::vector<std::string>& notes, Interrupter* interrupter = nullptr);

/// The solid grown by @a distance (shrunk where it is negative), by as many voxels as may be: the
/// exact distance to the surface minus @a distance. An empty level set if nothing is left.
/// Advances the running stage of @a progress by about one unit.
LevelSet offset(const LevelSet& levelSet, double distance, Interrupter* interrupter = nullptr);

/// Where the wall of a shell lies beside the surface.
enum class Wall { Inward, Outward, Centered };

/// The wall of @a thickness > 0 along the surface. Thinner than two voxels is a LimitError: no
/// level set can show it. Advances the running stage of @a progress by about one unit.
LevelSet shell(const LevelSet& levelSet, double thickness, Wall wall,
               Interrupter* interrupter = nullptr);

} // namespace mpuvdb
