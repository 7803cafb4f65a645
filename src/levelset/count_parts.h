// How many parts a level set's solid has, and how many cavities.
#pragma once
#include <mpuvdb/level_set.h>

#include <cstdint>

namespace mpuvdb
{

class Progress;

struct PartCounts {
    std::uint64_t parts = 0;    ///< of the solid, connected by faces of voxels
    std::uint64_t cavities = 0; ///< connected parts of what it encloses
};

/// Parts and cavities of at least eight voxels, two along each axis: a corner of something larger
/// may hold fewer that are alone. @throws Interrupted.
PartCounts countParts(const LevelSet& levelSet, Progress& progress);

} // namespace mpuvdb
