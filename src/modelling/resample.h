// The band and the memory that resampling a level set takes.
#pragma once
#include <mpuvdb/field.h>

namespace mpuvdb
{

/// The working memory of resampling, in grids like its result. [tuned: plan_bench; 1.5 to 3, as
/// arrays double where they are full]
constexpr double kResamplingGrids = 3;

/// The half-width, in voxels of @a from, to which the band of a level set is widened so that its
/// surface is found on @a to in a band of @a halfWidth voxels of that.
double widthToResample(const Lattice& from, const Lattice& to, double halfWidth);

/// Whether distances beyond that are searched for the voxels of @a to: larger ones, of which there
/// are fewer than in a band of @a from as wide.
bool isSearched(const Lattice& from, const Lattice& to);

} // namespace mpuvdb
