// Filters of a distance, before it is made a distance again.
#pragma once
#include <mpuvdb/operations.h>

namespace mpuvdb
{

/// @throws UsageError for settings out of range.
void demandSmoothSettings(const SmoothSettings& settings);

/// What is filtered before the result is made a distance again.
struct FilterPass {
    double halfWidth = 0; ///< voxels: what the filter reads of the band where the zero set may come
    int steps = 1;        ///< of all the passes
};

/// All steps that @a settings ask for.
int passesOf(const SmoothSettings& settings);

/// What comes after @a done steps.
FilterPass nextPass(const SmoothSettings& settings, int done);

/// The values of @a wide filtered wherever the filtered zero set may come to lie: same topology,
/// signs right. @throws Interrupted.
openvdb::FloatGrid::Ptr filter(const LevelSet& wide, const SmoothSettings& settings,
                               const FilterPass& pass, Interrupter& progress);

} // namespace mpuvdb
