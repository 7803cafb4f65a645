// How many parts a level set's solid has, and how many cavities.
#pragma once
#include <cstdint>

namespace mpuvdb
{

class Interrupter;
class SolidBlocks;

struct PartCounts {
    std::uint64_t parts = 0;    ///< of the solid, connected by faces of voxels
    std::uint64_t cavities = 0; ///< connected parts of what it encloses
};

/// Parts and cavities of at least eight voxels, two along each axis: a corner of something larger
/// may hold fewer that are alone. @throws Interrupted.
PartCounts countParts(const SolidBlocks& blocks, Interrupter& progress);

} // namespace mpuvdb
