// Images as PNG files.
#pragma once
#include <cstdint>
#include <filesystem>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// An image of 8 bits per channel, its top row first.
struct Image {
    int width, height;             ///< pixels
    std::vector<std::uint8_t> rgb; ///< 3 width height
};

/// Writes @a image as PNG, whole or not at all. @throws IoError, Interrupted.
void writePng(const std::filesystem::path& file, const Image& image, const Interrupter& progress);

} // namespace mpuvdb
