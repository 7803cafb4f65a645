// Colors and scalars as grids beside a level set.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/surface_attributes.h>

namespace mpuvdb
{

class Interrupter;

/// What @a attributes say of the zero set of @a levelSet, on the active voxels of its band: each
/// has what the nearest place on the zero set has. Colors become a Vec3f grid kColorName (linear,
/// to be written as half floats), scalars float grids of their names. Same transform; class
/// unknown; inactive voxels 0. The same for any number of threads.
/// @throws UsageError for scalars called like the level set or each other, Interrupted.
std::vector<openvdb::GridBase::Ptr> sampleAttributes(const LevelSet& levelSet,
                                                     const SurfaceAttributes& attributes,
                                                     Interrupter* interrupter = nullptr);

} // namespace mpuvdb
