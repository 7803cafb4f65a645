// The grids beside a level set, for what an operation makes of it.
#pragma once
#include "level_set_verb.h"

namespace mpuvdb::command
{

/// The grids of @a input for @a made. Attributes of the surface (colors, scalars, the coverage) are
/// sampled anew: each place has those of the place of the old surface nearest to where it was. What
/// analyze measured no longer holds: it is left out, with a warning. Other grids go along as they
/// are.
openvdb::GridCPtrVec carriedGrids(const LevelSet& made, const GridInput& input,
                                  const WayBack& wayBack, Session& session);

/// The grids for @a made, a morph from one solid to another at @a t: attributes of both, mixed,
/// what only one has as it is there; the coverage of the nearer one. Other grids of @a from go
/// along as they are.
openvdb::GridCPtrVec morphedGrids(const LevelSet& made, const GridInput& from, const GridInput& to,
                                  double t, Session& session);

} // namespace mpuvdb::command
