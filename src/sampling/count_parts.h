// Counts of connected parts and cavities of a level set's solid.
#pragma once
#include <cstdint>

namespace mpuvdb
{

class Interrupter;
class SolidBlocks;

struct PartCounts {
    std::uint64_t parts = 0;    ///< face-connected parts of the solid
    std::uint64_t cavities = 0; ///< face-connected parts of the enclosed outside
};

/// Parts and cavities of at least eight voxels: fewer may be the isolated corner of a larger one.
/// @throws Interrupted.
PartCounts countParts(const SolidBlocks& blocks, Interrupter& progress);

} // namespace mpuvdb
