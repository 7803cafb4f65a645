// The zero set beside creases as facets, the vertices of which lie on creases where these pass.
#pragma once
#include "crease_zone.h"

namespace mpuvdb
{

/// Add vertices and facets to @a patches, the zone's, for the cells between voxels beside creases,
/// and mark the patches superseded by them. @throws LimitError, Interrupted.
void addCreaseFacets(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress);

} // namespace mpuvdb
