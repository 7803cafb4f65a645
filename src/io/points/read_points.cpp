// Reads files by the reader for each, and joins them to one cloud.
#include "files/text_scan.h"
#include "mesh_points.h"
#include "points/import/rounded_positions.h"
#include "readers.h"
#include "stand_ins.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <exception>

namespace mpuvdb
{
namespace
{

using Reader = FilePoints (*)(const ByteSource&, const ScalarNames&, Interrupter&);

// The reader for the content's first bytes; null where they are no magic.
Reader readerByMagic(const std::string& head)
{
    const auto starts = [&](std::string_view magic) { return head.rfind(magic, 0) == 0; };
    if (starts("ply\n") || starts("ply\r") || starts("ply ")) return readPly;
    if (starts("LASF")) return readLas;
    for (const char* magic : {"OFF", "COFF", "NOFF", "CNOFF", "STOFF"})
        if (starts(magic) && head.size() > std::string_view(magic).size() &&
            (isSeparator(head[std::string_view(magic).size()]) ||
             head[std::string_view(magic).size()] == '\n'))
            return readOff;
    if (starts("# .PCD") || starts("VERSION .7") || starts("VERSION 0.7")) return readPcd;
    return nullptr;
}

Reader readerByExtension(const std::string& extension)
{
    static const std::map<std::string, Reader> readers = {
        {".ply", readPly},        {".obj", readObj},     {".off", readOff},
        {".stl", readStl},        {".pcd", readPcd},     {".las", readLas},
        {".ptx", readPtx},        {".xyz", readColumns}, {".xyzn", readColumns},
        {".xyzrgb", readColumns}, {".pts", readPts},     {".pwn", readPwn},
        {".txt", readColumns},    {".csv", readColumns}, {".asc", readColumns},
        {".tsv", readColumns},
    };
    const auto found = readers.find(extension);
    return found == readers.end() ? nullptr : found->second;
}

} // namespace

FilePoints readFormat(const std::filesystem::path& file, const ScalarNames& scalars,
                      Interrupter& progress)
{
    const ByteSource source(file, progress);
    if (source.size() == 0)
        throw InputError(fmt::format("{}: is empty. Check what was exported.", source.name()));
    refuseStandIns(source.name(), source.head(256));
    const std::string extension = lowerCase(file.extension().string());
    Reader reader = readerByMagic(source.head(64));
    if (!reader) reader = file == "-" ? readColumns : readerByExtension(extension);
    if (!reader && extension == ".laz")
        throw InputError(
            fmt::format("{}: is compressed (LAZ). Decompress it first, for example with "
                        "'pdal translate in.laz out.las'.",
                        source.name()));
    if (!reader)
        throw InputError(
            fmt::format("{}: is of no kind that can be read. Name a .ply, .conf, .xyz, "
                        ".pts, .pwn, .txt, .csv, .ptx, .obj, .off, .stl, .pcd or .las "
                        "file.",
                        source.name()));
    FilePoints points = reader(source, scalars, progress);
    points.name = source.name();
    scaleColors(points, progress);
    if (source.commas() == Commas::Decimal)
        points.notes.insert(points.notes.begin(), "its numbers have decimal commas");
    const Groups groups = source.groups();
    if (groups == Groups::Dots || groups == Groups::Commas || groups == Groups::Blanks)
        points.notes.insert(points.notes.begin(),
                            fmt::format("{} group the digits of its numbers",
                                        groups == Groups::Dots     ? "dots"
                                        : groups == Groups::Commas ? "commas"
                                                                   : "blanks"));
    return points;
}

namespace
{

FilePoints readFile(const std::filesystem::path& file, BadPoints badPoints,
                    const ScalarNames& scalars, Interrupter& progress)
{
    FilePoints points = readFormat(file, scalars, progress);
    addMeshNormals(points);
    cleanPoints(points, badPoints, progress);
    if (const auto warning = findRounding(points, progress)) points.warnings.push_back(*warning);
    return points;
}

// A file to read, and the motion of its points to the world.
struct Part {
    PlacedScan scan;
    bool placed = false;
    std::string set;      ///< name of the set that lists it
    std::size_t file = 0; ///< index of the file that lists it, or is it
};

std::vector<Part> listParts(const std::vector<std::filesystem::path>& files,
                            std::vector<std::string>& notes, Interrupter& progress)
{
    std::vector<Part> parts;
    for (std::size_t f = 0; f < files.size(); ++f) {
        const std::filesystem::path& file = files[f];
        if (lowerCase(file.extension().string()) != ".conf") {
            Part part;
            part.scan.file = file;
            part.file = f;
            parts.push_back(std::move(part));
            continue;
        }
        std::vector<std::string> ofSet;
        for (PlacedScan& scan : readScanSet(file, ofSet, progress))
            parts.push_back({std::move(scan), true, file.string(), f});
        for (const std::string& note : ofSet) notes.push_back(file.string() + ": " + note);
    }
    return parts;
}

void place(FilePoints& points, const PlacedScan& scan)
{
    for (PointBlock& block : points.blocks) movePoints(block, scan.rotation, scan.translation);
    points.mesh.reset(); // as it was not moved
}

// Adds equal notes of a set's scans once.
void gatherSetNotes(const std::vector<Part>& parts, std::vector<FilePoints>& inputs,
                    std::vector<std::string>& notes)
{
    for (std::size_t i = 0; i < parts.size(); ++i) {
        if (!parts[i].placed) continue;
        for (const std::string& note : inputs[i].notes) {
            const std::string said = fmt::format("scans of {}: {}", parts[i].set, note);
            if (std::find(notes.begin(), notes.end(), said) == notes.end()) notes.push_back(said);
        }
        inputs[i].notes.clear();
    }
}

/// Bytes to read; infinite where some come from a pipe, so that no share is told of.
double bytesOf(const std::vector<Part>& parts)
{
    double bytes = 0;
    for (const Part& part : parts) {
        std::error_code error;
        const auto size = std::filesystem::file_size(part.scan.file, error);
        if (error) return HUGE_VAL;
        bytes += double(size);
    }
    return bytes;
}

} // namespace

PointInput readPoints(const std::vector<std::filesystem::path>& files, BadPoints badPoints,
                      const std::vector<Vec3d>& viewpoints, const std::vector<std::string>& scalars,
                      Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (files.empty()) throw UsageError("no input: name at least one file of points");
    if (viewpoints.size() > 1 && viewpoints.size() != files.size())
        throw UsageError(fmt::format("{} viewpoints for {} inputs. Give one for all of them, or "
                                     "one for each",
                                     viewpoints.size(), files.size()));
    if (scalars.size() > kMaxScalars)
        throw UsageError(
            fmt::format("{} scalars are too many. Name at most {}", scalars.size(), kMaxScalars));
    std::vector<std::string> notes;
    const std::vector<Part> parts = listParts(files, notes, progress);
    progress.beginStage("read", bytesOf(parts));
    std::vector<FilePoints> inputs(parts.size());
    std::vector<std::exception_ptr> errors(parts.size());
    tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t i) {
        try {
            inputs[i] = readFile(parts[i].scan.file, badPoints, scalars, progress);
            if (parts[i].placed) place(inputs[i], parts[i].scan);
            if (viewpoints.empty()) return;
            const Vec3d& eye = viewpoints[viewpoints.size() == 1 ? 0 : parts[i].file];
            for (PointBlock& block : inputs[i].blocks) block.seenFrom = Viewpoint{eye, false};
        } catch (...) {
            errors[i] = std::current_exception();
        }
    });
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
    gatherSetNotes(parts, inputs, notes);
    PointInput result = joinPoints(std::move(inputs), badPoints, scalars, progress);
    result.notes.insert(result.notes.begin(), notes.begin(), notes.end());
    progress.endStage();
    return result;
}

} // namespace mpuvdb
