// Pictures of plane cuts of level sets.
#pragma once
#include <mpuvdb/contours.h>

#include <filesystem>

namespace mpuvdb
{

class Interrupter;

/// Writes a picture of the distances on @a plane as PNG: warm inside, cool outside, a stripe for
/// each voxel of distance, the surface black, plain beyond the band. The picture shows the box of
/// the whole solid, so that slices of one solid lie over each other.
/// @param pixels  along the longer side, in [16, 8192].
/// @throws UsageError for settings out of range, IoError, Interrupted.
void writeSlicePicture(const std::filesystem::path& file, const LevelSet& levelSet,
                       const SlicePlane& plane, int pixels, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
