// Patches beside creases, fitted to their faces.
#pragma once
#include "crease_zone.h"

namespace mpuvdb
{

/// Fit the patches of @a zone that are beside creases and not rough to the feet of the same face
/// around them: their own gradients may mix both sides of a crease, or come from one octant.
/// Patches without others on their plane become rough. Leaves with few faces stay unchanged and
/// leave the zone. @param patches  those of @a zone. @throws Interrupted.
void fitToFaces(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress);

} // namespace mpuvdb
