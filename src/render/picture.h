// Pictures of level sets.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/vec.h>

#include <filesystem>

namespace mpuvdb
{

class Interrupter;

/// A shaded picture of the zero set as PNG, by OpenVDB's ray tracer.
/// @throws UsageError for settings out of range, IoError, Interrupted.
struct PictureSettings {
    int width = 800, height = 600;       ///< pixels, in [16, 8192]
    double azimuth = 30, elevation = 20; ///< degrees: of the camera about the axis that points
                                         ///< up, from +Z (or -Y, if Z does) on, in [-360, 360],
                                         ///< and above the horizon, in [-90, 90]
    UpAxis up = UpAxis::Y;
};
void writePicture(const std::filesystem::path& file, const LevelSet& levelSet,
                  const PictureSettings& settings, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
