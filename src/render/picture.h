// Pictures of level sets.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/vec.h>

#include <cstdint>
#include <filesystem>

namespace mpuvdb
{

class Interrupter;

/// Settings of writePicture().
struct PictureSettings {
    int width = 800, height = 600; ///< pixels, in [16, 8192]
    double azimuth = 30;   ///< of the camera about the up axis, degrees in [-360, 360], from +Z on,
                           ///< or from -Y where Z is up
    double elevation = 20; ///< of the camera above the horizon, degrees in [-90, 90]
    UpAxis up = UpAxis::Y;
    std::uint64_t maxBytes = 0; ///< memory for the surface's triangles, bytes; 0: no limit
};

/// Writes a shaded picture of the zero set as PNG, by the mesh's triangles.
/// @throws UsageError for settings out of range, LimitError, IoError, Interrupted.
void writePicture(const std::filesystem::path& file, const LevelSet& levelSet,
                  const PictureSettings& settings, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
