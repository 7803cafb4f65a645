// Level sets that were made elsewhere: taken in, or refused before work is lost on them.
#pragma once
#include <mpuvdb/level_set.h>

#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// @a grid as operations expect it: the grid itself, or a copy in which
/// - what is active and has the background's magnitude or more is inactive, as are active tiles:
///   dense arrays that were cut off at the band's rim are written like that,
/// - the background is what the band holds, where it promises two voxels more than that, or holds
///   less than 1.5 voxels of a wider band,
/// - inactive values are plus or minus the background.
/// @param notes  gets what changes the half-width, if anything does.
/// @throws InputError as LevelSet's constructor and demandFinite() do, Interrupted.
LevelSet takeLevelSet(const openvdb::FloatGrid::ConstPtr& grid, std::vector<std::string>& notes,
                      Interrupter* interrupter = nullptr);

/// Look whether the values of @a levelSet may be distances at all; check() looks closer.
/// @param cure  ends the error's text: how to make distances of them.
/// @throws InputError if the median slope beside the zero set, where a distance has 1, is outside
/// [0.4, 2.5], or if more than one in ten faces between inside and outside lie beside an inactive
/// voxel or tile, where there is no distance; Interrupted.
void demandDistances(const LevelSet& levelSet, const std::string& cure,
                     Interrupter* interrupter = nullptr);

} // namespace mpuvdb
