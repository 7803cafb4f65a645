// Filters of distance values, before distances are restored.
#pragma once
#include <mpuvdb/operations.h>

namespace mpuvdb
{

/// @throws UsageError for settings out of range.
void requireSmoothSettings(const SmoothSettings& settings);

/// The filtering between two restorations of the distance.
struct FilterPass {
    double halfWidth = 0; ///< of the band that the filter reads, voxels
    int steps = 1;        ///< of passesOf()
};

/// The number of steps that @a settings ask for.
int passesOf(const SmoothSettings& settings);

/// The pass after @a done steps.
FilterPass nextPass(const SmoothSettings& settings, int done);

/// The values of @a wide, filtered wherever the filtered zero set may lie; of the same topology,
/// with the right signs. @throws Interrupted.
openvdb::FloatGrid::Ptr filter(const LevelSet& wide, const SmoothSettings& settings,
                               const FilterPass& pass, Interrupter& progress);

} // namespace mpuvdb
