// Particles in the point grids of .vdb files.
#pragma once
#include <mpuvdb/particles.h>

#include <filesystem>
#include <string>
#include <vector>

namespace mpuvdb
{

/// The particles of all point grids of @a file. @param scalars  attributes to keep.
/// @param maxBytes  limit of all its grids; 0: none.
/// @throws as readGrids(); InputError where there are no points, or not all the attributes.
Particles readPointGrids(const std::filesystem::path& file, const std::vector<std::string>& scalars,
                         std::uint64_t maxBytes, Interrupter& progress);

} // namespace mpuvdb
