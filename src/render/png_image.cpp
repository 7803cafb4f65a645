#include "png_image.h"
#include "files/atomic_file.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

#include <csetjmp>
#include <cstdio>
#include <png.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// Leave as libpng does of itself, which prints a message before.
[[noreturn]] void leave(png_structp png, png_const_charp /*message*/)
{
    png_longjmp(png, 1);
}
void passOver(png_structp /*png*/, png_const_charp /*message*/) {}

/// Owns libpng's structures.
struct PngWriter {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, leave, passOver);
    png_infop info = png ? png_create_info_struct(png) : nullptr;
    ~PngWriter() { png_destroy_write_struct(&png, &info); }
};

/// Writes all rows. No object with a destructor may live here: libpng leaves by longjmp.
/// @return false if writing failed or was stopped.
bool writeRows(png_structp png, png_infop info, std::FILE* file, const Image& image,
               const Interrupter& progress)
{
    if (setjmp(png_jmpbuf(png))) return false;
    png_init_io(png, file);
    png_set_IHDR(png, info, png_uint_32(image.width), png_uint_32(image.height), 8,
                 PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (int row = 0; row < image.height && !progress.stopped(); ++row)
        png_write_row(png, &image.rgb[std::size_t(3) * image.width * row]);
    if (progress.stopped()) return false;
    png_write_end(png, info);
    return true;
}

void writeTo(const fs::path& file, const fs::path& temporary, const Image& image,
             const Interrupter& progress)
{
    PngWriter writer;
    std::FILE* stream = std::fopen(temporary.c_str(), "wb");
    bool written =
        stream && writer.info && writeRows(writer.png, writer.info, stream, image, progress);
    if (stream && std::fclose(stream) != 0) written = false;
    progress.check();
    if (!written)
        throw IoError(fmt::format(
            "{}: cannot be written. Free some space, or write to another disk", file.string()));
}

} // namespace

void writePng(const fs::path& file, const Image& image, const Interrupter& progress)
{
    writeAtomically(file,
                    [&](const fs::path& temporary) { writeTo(file, temporary, image, progress); });
}

} // namespace mpuvdb
