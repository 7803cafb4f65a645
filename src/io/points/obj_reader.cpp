// OBJ: v, vn and f lines.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "mesh_points.h"
#include "polygons.h"
#include "readers.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <charconv>
#include <limits>
#include <utility>

namespace mpuvdb
{
namespace
{

// Corners are kept as written, since a negative one counts back from the vertices before its line.
struct ObjRows {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> colors;
    std::vector<Vec3f> normals;
    std::vector<std::int64_t> corners;
    struct Face {
        std::size_t corners;        // how many
        std::size_t verticesBefore; // of this batch; then of the file
        std::uint64_t line;
    };
    std::vector<Face> faces;
    struct Call {
        std::string file;
        std::uint64_t line;
    };
    std::vector<Call> calls; ///< of other files, which are not read
    /// A backslash continues a face in the next line, which may be the first of the next batch.
    bool goesOn = false;
    std::vector<std::int64_t> cornersBefore; ///< of first lines that continue another batch's
    bool begun = false;                      ///< whether other lines followed
};

[[noreturn]] void throwBadLine(const ByteSource& source, std::uint64_t number,
                               std::string_view line)
{
    throw InputError(fmt::format("{}: line {}: {} is not a valid line of OBJ. "
                                 "Export the file again.",
                                 source.name(), number, inQuotes(line)));
}

// v x y z [w] or v x y z r g b
bool parseVertex(LineScanner& scan, ObjRows& rows)
{
    double values[6];
    int count = 0;
    while (count < 6 && !scan.atEndOrComment()) {
        if (!scan.number(values[count])) return false;
        ++count;
    }
    if (count < 3) return false;
    rows.positions.emplace_back(values[0], values[1], values[2]);
    if (count == 6) rows.colors.emplace_back(float(values[3]), float(values[4]), float(values[5]));
    return true;
}

// v v/t v//n v/t/n ..., and a backslash if the face continues
bool parseCorners(LineScanner& scan, std::vector<std::int64_t>& corners, bool& goesOn)
{
    goesOn = false;
    while (!scan.atEndOrComment()) {
        std::string_view word = scan.word();
        if (word.back() == '\\' && scan.atEnd()) {
            goesOn = true;
            word.remove_suffix(1);
            if (word.empty()) break;
        }
        std::int64_t corner = 0;
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), corner);
        if (error != std::errc() || corner == 0) return false;
        if (end != word.data() + word.size() && *end != '/') return false;
        corners.push_back(corner);
    }
    return true;
}

// Whether the line, of numbers, may continue a face of the batch before.
bool parseFirstLine(std::string_view line, ObjRows& rows)
{
    const bool wanted = rows.cornersBefore.empty() || rows.goesOn;
    if (!wanted || line.find_first_of("0123456789-") != line.find_first_not_of(" \t")) return false;
    const std::size_t before = rows.cornersBefore.size();
    LineScanner scan(line);
    if (parseCorners(scan, rows.cornersBefore, rows.goesOn)) return true;
    rows.cornersBefore.resize(before);
    rows.goesOn = false;
    return false;
}

bool parseFace(LineScanner& scan, std::uint64_t line, ObjRows& rows)
{
    const std::size_t first = rows.corners.size();
    const bool good = parseCorners(scan, rows.corners, rows.goesOn);
    rows.faces.push_back({rows.corners.size() - first, rows.positions.size(), line});
    return good;
}

void parseLine(const ByteSource& source, std::string_view line, std::uint64_t number, ObjRows& rows)
{
    if (!rows.begun && parseFirstLine(line, rows)) return;
    rows.begun = true;
    LineScanner scan(line);
    if (rows.goesOn) {
        const std::size_t before = rows.corners.size();
        if (rows.faces.empty() || !parseCorners(scan, rows.corners, rows.goesOn))
            throwBadLine(source, number, line);
        rows.faces.back().corners += rows.corners.size() - before;
        return;
    }
    const std::string_view keyword = scan.word();
    bool good = true;
    if (keyword == "v") {
        good = parseVertex(scan, rows);
    } else if (keyword == "vn") {
        double x = 0, y = 0, z = 0;
        good = scan.number(x) && scan.number(y) && scan.number(z);
        rows.normals.emplace_back(float(x), float(y), float(z));
    } else if (keyword == "f") {
        good = parseFace(scan, number, rows);
    } else if (keyword == "call") {
        rows.calls.push_back({std::string(scan.word()), number});
    }
    if (!good) throwBadLine(source, number, line);
}

struct ObjFile {
    PointBlock points;
    std::vector<Vec3f> normals;
    std::vector<std::int64_t> corners; // zero-based
    std::vector<ObjRows::Face> faces;
    std::vector<ObjRows::Call> calls;

    void merge(const ByteSource& source, ObjRows&& rows)
    {
        if (goesOn)
            for (const std::int64_t corner : rows.cornersBefore)
                append(source, corner, faces.back());
        auto corner = rows.corners.begin();
        for (ObjRows::Face face : rows.faces) {
            const auto end = corner + std::ptrdiff_t(std::exchange(face.corners, 0));
            face.verticesBefore += points.size();
            faces.push_back(face);
            for (; corner != end; ++corner) append(source, *corner, faces.back());
        }
        calls.insert(calls.end(), rows.calls.begin(), rows.calls.end());
        goesOn = rows.goesOn && (goesOn || rows.begun);
        PointBlock block;
        block.positions = std::move(rows.positions);
        block.rawColors = std::move(rows.colors);
        points.append(std::move(block));
        normals.insert(normals.end(), rows.normals.begin(), rows.normals.end());
    }

private:
    void append(const ByteSource& source, std::int64_t corner, ObjRows::Face& face)
    {
        const std::int64_t index =
            corner > 0 ? corner - 1 : std::int64_t(face.verticesBefore) + corner;
        if (index < 0 || index > std::int64_t(std::numeric_limits<std::uint32_t>::max()))
            throw InputError(
                fmt::format("{}: line {}: vertex {} does not exist. Export the file again.",
                            source.name(), face.line, corner));
        corners.push_back(index);
        ++face.corners;
    }

    bool goesOn = false; ///< the last face, in the next batch
};

// Says which other files are parts of this one.
void noteCalls(const std::vector<ObjRows::Call>& calls, FilePoints& result)
{
    if (calls.empty()) return;
    std::vector<std::string> files;
    for (const ObjRows::Call& call : calls) files.push_back(call.file);
    result.notes.push_back(fmt::format("line {} calls {}, which is not read: its points and faces "
                                       "are missing. Name it as an input "
                                       "of its own, or export all as one file",
                                       calls.front().line, listInQuotes(files)));
}

} // namespace

FilePoints readObj(const ByteSource& source, const ScalarNames&, Interrupter& progress)
{
    LineReader lines(source);
    ObjFile file;
    parseLines<ObjRows>(
        lines, std::numeric_limits<std::uint64_t>::max(), progress,
        [&](const LineBatch& batch, ObjRows& rows) {
            forEachLine(batch, [&](std::string_view line, std::uint64_t number) {
                parseLine(source, line, number, rows);
            });
        },
        [&](ObjRows&& rows) { file.merge(source, std::move(rows)); });

    FilePoints result;
    result.unit = "vertex";
    noteCalls(file.calls, result);
    Faces faces;
    std::vector<std::int64_t> polygon;
    auto corner = file.corners.begin();
    for (const ObjRows::Face& face : file.faces) {
        polygon.assign(corner, corner + std::ptrdiff_t(face.corners));
        corner += std::ptrdiff_t(face.corners);
        if (const std::int64_t* bad = findBadCorner(polygon, file.points.size(), false))
            throwBadCorner(*bad + 1, file.points.size(),
                           fmt::format("{}: line {}", source.name(), face.line));
        faces.append(polygon);
    }
    if (file.points.rawColors.size() != file.points.size()) file.points.rawColors.clear();
    // Without faces, as many normals as vertices are theirs, in order.
    if (faces.triangles.empty() && file.normals.size() == file.points.size())
        file.points.normals = std::move(file.normals);
    result.triangles = cutPolygons(std::move(faces), file.points.positions, progress);
    result.blocks.push_back(std::move(file.points));
    return result;
}

} // namespace mpuvdb
