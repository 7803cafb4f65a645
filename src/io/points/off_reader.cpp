// OFF and its prefixes: [ST][C][N]OFF, ascii.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "mesh_points.h"
#include "polygons.h"
#include "readers.h"
#include "surplus.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

class OffReader
{
public:
    OffReader(const ByteSource& source, Interrupter& progress)
        : mSource(source), mProgress(progress), mLines(source)
    {
    }

    FilePoints read()
    {
        readHeader();
        FilePoints result;
        result.unit = "vertex";
        result.blocks.push_back(readVertices());
        result.triangles = cutPolygons(readFaces(), result.blocks.front().positions, mProgress);
        noteSurplus(result, rowsLeft(mLines, mProgress),
                    fmt::format("{} vertices and {} faces", mVertices, mFaces));
        return result;
    }

private:
    [[noreturn]] void throwBad(const std::string& what) const
    {
        throw InputError(fmt::format("{}: line {}: {}. Export the file again.", mSource.name(),
                                     mLines.line(), what));
    }

    // The next line that is not a comment.
    std::string_view line(const char* expected)
    {
        std::string_view text;
        while (mLines.next(text)) {
            if ((mLines.line() & 0xfff) == 0) mProgress.check();
            LineScanner scan(text);
            if (!scan.atEndOrComment()) return text;
        }
        throw InputError(fmt::format("{}: ends before {}: the file is truncated. Copy or export it "
                                     "again.",
                                     mSource.name(), expected));
    }

    void readHeader()
    {
        const std::string_view first = line("its first line");
        std::string_view magic = LineScanner(first).word();
        const auto takePrefix = [&](std::string_view prefix) {
            const bool has = magic.substr(0, prefix.size()) == prefix;
            if (has) magic.remove_prefix(prefix.size());
            return has;
        };
        takePrefix("ST");
        mHasColors = takePrefix("C");
        mHasNormals = takePrefix("N");
        if (!takePrefix("OFF")) throwBad("wants OFF, COFF, NOFF or CNOFF");
        // The counts may follow on the same line, even without a space.
        std::string_view rest = first.substr(std::size_t(magic.data() - first.data()));
        if (LineScanner(rest).word() == "BINARY")
            throwBad("binary OFF is not read; write it as text");
        if (LineScanner(rest).atEndOrComment()) rest = line("its counts");
        LineScanner counts(rest);
        std::int64_t vertices = 0, faces = 0;
        if (!counts.integer(vertices) || !counts.integer(faces) || vertices < 0 || faces < 0)
            throwBad("wants the numbers of vertices, faces and edges");
        mVertices = std::uint64_t(vertices);
        mFaces = std::uint64_t(faces);
        const std::uint64_t present = mSource.size() - mLines.offset();
        if (mVertices > present / 2 || mFaces > present / 2)
            throwBad(fmt::format("promises {} vertices and {} faces, but only {} bytes follow",
                                 mVertices, mFaces, present));
    }

    PointBlock readVertices()
    {
        AttributeSet has;
        has.position = true;
        has.normals = mHasNormals;
        has.colors = mHasColors;
        std::vector<Attribute> order = {Attribute::X, Attribute::Y, Attribute::Z};
        if (mHasNormals)
            order.insert(order.end(), {Attribute::NormalX, Attribute::NormalY, Attribute::NormalZ});
        if (mHasColors)
            order.insert(order.end(), {Attribute::Red, Attribute::Green, Attribute::Blue});
        PointBlock block;
        RowValues row{};
        for (std::uint64_t v = 0; v < mVertices; ++v) {
            LineScanner scan(line("its last vertex"));
            for (const Attribute attribute : order) {
                double& value = row[std::size_t(attribute)];
                if (!scan.number(value)) throwBad(fmt::format("vertex {} wants numbers", v));
            }
            block.append(row, has);
        }
        return block;
    }

    Faces readFaces()
    {
        Faces faces;
        std::vector<std::int64_t> corners;
        for (std::uint64_t f = 0; f < mFaces; ++f) {
            LineScanner scan(line("its last face"));
            std::int64_t count = 0, corner = 0;
            if (!scan.integer(count) || count < 0)
                throwBad(fmt::format("face {} wants a count", f));
            corners.clear();
            for (std::int64_t i = 0; i < count; ++i) {
                if (!scan.integer(corner)) throwBad(fmt::format("face {} wants indices", f));
                corners.push_back(corner);
            }
            if (const std::int64_t* bad = findBadCorner(corners, mVertices, false))
                throwBadCorner(*bad, mVertices,
                               fmt::format("{}: line {}", mSource.name(), mLines.line()));
            faces.append(corners);
        }
        return faces;
    }

    const ByteSource& mSource;
    Interrupter& mProgress;
    LineReader mLines;
    std::uint64_t mVertices = 0, mFaces = 0;
    bool mHasNormals = false, mHasColors = false;
};

} // namespace

FilePoints readOff(const ByteSource& source, const ScalarNames&, Interrupter& progress)
{
    return OffReader(source, progress).read();
}

} // namespace mpuvdb
