// Facets of the zero set beside creases, with vertices on the creases.
#pragma once
#include "crease_zone.h"

namespace mpuvdb
{

/// Add vertices and facets to @a patches, those of @a zone, for the cells between voxels beside
/// creases, and mark the patches that they supersede. @throws LimitError, Interrupted.
void addCreaseFacets(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress);

} // namespace mpuvdb
