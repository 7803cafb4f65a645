// The mesh of a level set in parts: the same as that of the whole.
#pragma once
#include "parted_grid.h"
#include <mpuvdb/mesh.h>

#include <string>

namespace mpuvdb
{

class Interrupter;

/// What extractMesh() makes of the one grid, to the byte, of which one part's voxels are held at a
/// time. Vertices are numbered by their cells' blocks, in the order of the one tree, and by their
/// sheets: so parts refer to each other's. Vertices of triangles that fold over are retracted in
/// the rounds of the whole: after each, all parts know of all.
/// @param grid  a closed level set in parts.
/// @param maxBytes  memory for the mesh; 0: no limit.
/// @throws LimitError (memory, beyond 2^32 vertices), InputError (damaged files), Interrupted.
Mesh meshOfParts(const PartedGrid& grid, const std::string& prefix, const ExtractSettings& settings,
                 std::uint64_t maxBytes, Interrupter& progress);

} // namespace mpuvdb
