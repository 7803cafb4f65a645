// Grids of colors and scalars for a level set.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/surface_attributes.h>

namespace mpuvdb
{

class Interrupter;

/// @a attributes of the zero set of @a levelSet, on the active voxels of its band: each has those
/// of its nearest place on the zero set. Colors become a Vec3f grid kColorName (linear RGB, saved
/// as half floats), scalars float grids of their names. Same transform; class unknown; inactive
/// voxels 0. The same for any number of threads.
/// @throws UsageError if two grids would have one name, Interrupted.
std::vector<openvdb::GridBase::Ptr> sampleAttributes(const LevelSet& levelSet,
                                                     const SurfaceAttributes& attributes,
                                                     Interrupter* interrupter = nullptr);

} // namespace mpuvdb
