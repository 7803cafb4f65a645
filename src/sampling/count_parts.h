// Counts of connected parts and cavities of a level set's solid.
#pragma once
#include <cstdint>

namespace mpuvdb
{

class Interrupter;
class LevelSet;
class SolidBlocks;

struct PartCounts {
    std::uint64_t parts = 0;    ///< connected parts of the solid
    std::uint64_t cavities = 0; ///< connected parts of the enclosed outside
};

/// Parts and cavities of at least eight voxels, or as many as the largest part has: fewer may be
/// the isolated corner of a larger one. They are connected as the mesh is, see DiagonalLinks.
/// @param blocks  of @a levelSet.
/// @throws Interrupted.
PartCounts countParts(const LevelSet& levelSet, const SolidBlocks& blocks, Interrupter& progress);

} // namespace mpuvdb
