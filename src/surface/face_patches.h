// Patches beside creases, each fitted to its face.
#pragma once
#include "crease_zone.h"

namespace mpuvdb
{

/// Fit those of @a patches, the zone's, that are beside creases and not rough to what the feet of
/// the same face around them say of where they lie and how they bend: their own gradients may be
/// from both sides of a crease, or from one octant of a voxel. Those that no others lie beside, as
/// planes between two faces may be, become rough. Leaves that few faces are found in stay as they
/// are, and leave the zone. @throws Interrupted.
void fitToFaces(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress);

} // namespace mpuvdb
