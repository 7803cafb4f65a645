// Level sets from other programs: normalized, or refused.
#pragma once
#include <mpuvdb/level_set.h>

#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A level set of @a grid that satisfies the conventions of level_set.h: the grid itself, or a copy
/// in which
/// - active tiles and active values of the background's magnitude or more are inactive, as dense
///   arrays clipped to the band have them,
/// - values clipped below the background are inactive: they are no distances,
/// - the background is the half-width that the band has, where values are clipped there, where it
///   exceeds that by more than two voxels, or is less than 1.5 voxels of a wider band,
/// - inactive values are plus or minus the background,
/// - it is empty where no value is negative.
/// @param notes  a note is appended if the half-width changes, or the surface is none.
/// @throws InputError as LevelSet's constructor and requireFinite() do, Interrupted.
LevelSet levelSetFromGrid(const openvdb::FloatGrid::ConstPtr& grid, std::vector<std::string>& notes,
                          Interrupter* interrupter = nullptr);

/// What is wrong, for the user, where faces between inside and outside lie beside an inactive voxel
/// or tile, where there is no distance; else empty. @throws Interrupted.
std::string missingBand(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

/// Require that a band lies between inside and outside, nearly everywhere.
/// @param cure  last sentence of the error's text.
/// @return missingBand(). @throws InputError if it finds more than one in ten faces; Interrupted.
std::string requireBand(const LevelSet& levelSet, const std::string& cure,
                        Interrupter* interrupter = nullptr);

/// Whether check() takes the values of @a levelSet for distances by their slopes. @throws
/// Interrupted.
bool hasSlopesOfDistances(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
