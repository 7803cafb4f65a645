// PLY: vertices, and faces, strips and range images for their normals.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "mesh_points.h"
#include "ply_header.h"
#include "polygons.h"
#include "range_grid.h"
#include "readers.h"
#include "surplus.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <limits>

namespace mpuvdb
{
namespace
{

enum class Kind { Vertex, Faces, Strips, Grid, Other };

// An element with the meaning of its properties.
struct Plan {
    Kind kind = Kind::Other;
    const PlyElement* element = nullptr;
    std::vector<Attribute> attributes; // by property; None for lists
    int list = -1;                     // the property that holds corners
    AttributeSet has;
    std::uint64_t vertices = 0; // of the file
    std::string where;          // "scan.ply: face", for messages
};

Kind kindOf(const PlyElement& element)
{
    return element.name == "vertex"       ? Kind::Vertex
           : element.name == "face"       ? Kind::Faces
           : element.name == "tristrips"  ? Kind::Strips
           : element.name == "range_grid" ? Kind::Grid
                                          : Kind::Other;
}

Plan planFor(const ByteSource& source, const PlyHeader& header, const PlyElement& element,
             const ScalarNames& scalars)
{
    Plan plan;
    plan.kind = kindOf(element);
    plan.element = &element;
    plan.vertices = header.find("vertex")->count;
    plan.where = source.name() + ": " + element.name;
    for (std::size_t p = 0; p < element.properties.size(); ++p) {
        const PlyProperty& property = element.properties[p];
        const bool corners = property.name == "vertex_indices" || property.name == "vertex_index";
        if (property.isList && corners) plan.list = int(p);
        plan.attributes.push_back(property.isList || plan.kind != Kind::Vertex
                                      ? Attribute::None
                                      : attributeOf(property.name, scalars));
    }
    plan.has = AttributeSet(plan.attributes);
    plan.has.byteColors = true;
    for (std::size_t p = 0; p < element.properties.size(); ++p)
        if (isColor(plan.attributes[p]) && element.properties[p].type != ScalarType::UInt8)
            plan.has.byteColors = plan.has.packedRgb;
    if (plan.kind == Kind::Vertex && !plan.has.position)
        throw InputError(fmt::format("{}: its vertices have no x, y and z. Export them with "
                                     "positions.",
                                     source.name()));
    if (plan.kind != Kind::Vertex && plan.list < 0) plan.kind = Kind::Other;
    return plan;
}

// The contents of rows of one element.
struct Rows {
    PointBlock points;
    Faces faces;
    std::vector<std::uint32_t> grid;
    RowValues values{};
    std::vector<std::int64_t> corners;
};

void appendRow(const Plan& plan, std::uint64_t index, Rows& rows)
{
    if (plan.kind == Kind::Vertex) {
        rows.points.append(rows.values, plan.has);
        return;
    }
    const bool strips = plan.kind == Kind::Strips;
    if (const std::int64_t* bad = findBadCorner(rows.corners, plan.vertices, strips))
        throwBadCorner(*bad, plan.vertices, fmt::format("{} {}", plan.where, index));
    if (plan.kind == Kind::Faces)
        rows.faces.append(rows.corners);
    else if (plan.kind == Kind::Strips)
        appendStrips(rows.corners, rows.faces.triangles);
    else
        rows.grid.push_back(rows.corners.empty() ? RangeGrid::kMissed
                                                 : std::uint32_t(rows.corners.front()));
}

// ---- ascii

[[noreturn]] void throwBadValue(const Plan& plan, std::uint64_t index, std::uint64_t line,
                                const PlyProperty& property, LineScanner& scan)
{
    const std::string_view word = scan.word();
    throw InputError(fmt::format("{} {} (line {}): {} is {}, not a number. Export the file again.",
                                 plan.where, index, line, property.name,
                                 word.empty() ? "missing" : inQuotes(word)));
}

void parseList(const Plan& plan, std::size_t p, std::uint64_t index, std::uint64_t line,
               LineScanner& scan, Rows& rows)
{
    const PlyProperty& property = plan.element->properties[p];
    std::int64_t count = 0, item = 0;
    double ignored = 0;
    if (!scan.integer(count) || count < 0) throwBadValue(plan, index, line, property, scan);
    for (std::int64_t i = 0; i < count; ++i) {
        const bool corner = int(p) == plan.list;
        if (!(corner ? scan.integer(item) : scan.number(ignored)))
            throwBadValue(plan, index, line, property, scan);
        if (corner) rows.corners.push_back(item);
    }
}

void parseRow(const Plan& plan, std::uint64_t index, std::uint64_t lineNumber,
              std::string_view line, Rows& rows)
{
    LineScanner scan(line);
    rows.corners.clear();
    for (std::size_t p = 0; p < plan.attributes.size(); ++p) {
        const PlyProperty& property = plan.element->properties[p];
        if (property.isList) {
            parseList(plan, p, index, lineNumber, scan, rows);
            continue;
        }
        double value = 0;
        LineScanner before = scan;
        if (!scan.number(value)) throwBadValue(plan, index, lineNumber, property, before);
        const Attribute attribute = plan.attributes[p];
        if (attribute == Attribute::None) continue;
        rows.values[std::size_t(attribute)] = value;
    }
    if (!scan.atEnd())
        throw InputError(fmt::format("{} {} (line {}): has more values than the header lists. "
                                     "Export the file again.",
                                     plan.where, index, lineNumber));
    if (plan.kind != Kind::Other) appendRow(plan, index, rows);
}

// ---- binary

// Reads one row that may have lists; scalars of interest go to rows.values.
void takeRow(const Plan& plan, std::uint64_t index, bool swap, ByteCursor& cursor, Rows& rows)
{
    rows.corners.clear();
    for (std::size_t p = 0; p < plan.attributes.size(); ++p) {
        const PlyProperty& property = plan.element->properties[p];
        const std::size_t size = sizeOf(property.type);
        if (!property.isList) {
            double value = loadScalar(property.type, cursor.take(size), swap);
            const Attribute attribute = plan.attributes[p];
            if (attribute == Attribute::None) continue;
            rows.values[std::size_t(attribute)] = value;
            continue;
        }
        const std::int64_t count =
            loadInteger(property.countType, cursor.take(sizeOf(property.countType)), swap);
        if (count < 0 || std::uint64_t(count) > cursor.remaining() / size)
            throw InputError(
                fmt::format("{} {}: its list {} has {} items, more than the rest of the "
                            "file ({} bytes): the file is truncated or damaged. Copy or "
                            "export it again.",
                            plan.where, index, property.name, count, cursor.remaining()));
        for (std::int64_t i = 0; i < count; ++i) {
            const char* item = cursor.take(size);
            if (int(p) == plan.list) rows.corners.push_back(loadInteger(property.type, item, swap));
        }
    }
    if (plan.kind != Kind::Other) appendRow(plan, index, rows);
}

// ---- the file

class PlyReader
{
public:
    PlyReader(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
        : mSource(source), mScalars(scalars), mProgress(progress), mHeader(readPlyHeader(source))
    {
        mResult.unit = "vertex";
        if (!mHeader.find("vertex")) throwNoVertices();
    }

    FilePoints read()
    {
        if (mHeader.format == PlyFormat::Ascii)
            readAscii();
        else
            readBinary();
        if (mHeader.find("vertex")->count == 0) throwNoVertices();
        for (const PlyProperty& property : mHeader.find("vertex")->properties)
            if (!property.isList && isNamedScalar(attributeOf(property.name, {})))
                mResult.scalarNames.push_back(property.name);
        if (!mFaces.triangles.empty())
            mResult.triangles =
                cutPolygons(std::move(mFaces), mResult.joined().positions, mProgress);
        addGridNormals();
        return std::move(mResult);
    }

private:
    void readAscii()
    {
        LineReader lines(mSource, mHeader.dataOffset, mHeader.lines);
        for (const PlyElement& element : mHeader.elements) {
            if (element.properties.empty() || element.count == 0) continue;
            // A line has at least two bytes: an absurd count is found before reading.
            const std::uint64_t present = mSource.size() - lines.offset();
            if (element.count > present / 2 + 1) throwMissing(element, present / 2);
            const Plan plan = planFor(mSource, mHeader, element, mScalars);
            const std::uint64_t found = readAsciiElement(lines, plan);
            if (found < element.count) throwMissing(element, found);
        }
        noteSurplus(mResult, rowsLeft(lines, mProgress), counts());
    }

    std::uint64_t readAsciiElement(LineReader& lines, const Plan& plan)
    {
        const std::uint64_t firstLine = lines.line() + 1;
        return parseLines<Rows>(
            lines, plan.element->count, mProgress,
            [&](const LineBatch& batch, Rows& rows) {
                if (plan.kind == Kind::Vertex) rows.points.reserve(batch.lines, plan.has);
                forEachLine(batch, [&](std::string_view line, std::uint64_t number) {
                    parseRow(plan, number - firstLine, number, line, rows);
                });
            },
            [&](Rows&& rows) { merge(std::move(rows)); });
    }

    void readBinary()
    {
        std::uint64_t offset = mHeader.dataOffset;
        const bool swap = mHeader.format == PlyFormat::BigEndian;
        for (const PlyElement& element : mHeader.elements) {
            if (element.properties.empty() || element.count == 0) continue;
            const Plan plan = planFor(mSource, mHeader, element, mScalars);
            if (element.hasLists()) {
                offset = readBinaryRows(plan, offset, swap);
                continue;
            }
            requireRecords(mSource, offset, element.count, element.stride(), element.name.c_str());
            if (plan.kind == Kind::Vertex)
                mResult.blocks.push_back(readRecords(mSource, offset, element.count,
                                                     layoutOf(plan, swap), "vertex", mProgress));
            offset += element.count * element.stride();
        }
        std::uint64_t row = 0; // least size of a vertex, bytes
        for (const PlyProperty& property : mHeader.find("vertex")->properties)
            row += sizeOf(property.isList ? property.countType : property.type);
        noteSurplus(mResult, recordsLeft(mSource, offset, row, mProgress), counts());
    }

    /// The header's counts, in its words.
    std::string counts() const
    {
        std::vector<std::string> elements;
        for (const PlyElement& element : mHeader.elements)
            elements.push_back(fmt::format("'element {} {}'", element.name, element.count));
        return fmt::format("{}", fmt::join(elements, ", "));
    }

    static RecordLayout layoutOf(const Plan& plan, bool swap)
    {
        RecordLayout layout;
        layout.swap = swap;
        layout.stride = plan.element->stride();
        std::uint64_t offset = 0;
        for (std::size_t p = 0; p < plan.attributes.size(); ++p) {
            const ScalarType type = plan.element->properties[p].type;
            if (plan.attributes[p] != Attribute::None)
                layout.columns.push_back({plan.attributes[p], type, offset, layout.stride});
            offset += sizeOf(type);
        }
        return layout;
    }

    std::uint64_t readBinaryRows(const Plan& plan, std::uint64_t offset, bool swap)
    {
        constexpr std::uint64_t kRowsAtOnce = 1 << 14; // between two reports [free: latency]
        requireRecords(mSource, offset, plan.element->count, 1, plan.element->name.c_str());
        ByteCursor cursor(mSource, offset);
        for (std::uint64_t row = 0; row < plan.element->count;) {
            const std::uint64_t before = cursor.offset();
            const std::uint64_t end = std::min(row + kRowsAtOnce, plan.element->count);
            Rows rows;
            for (; row < end; ++row) takeRow(plan, row, swap, cursor, rows);
            merge(std::move(rows));
            mProgress.advance(double(cursor.offset() - before));
        }
        return cursor.offset();
    }

    void merge(Rows&& rows)
    {
        if (rows.points.size() > 0) mResult.blocks.push_back(std::move(rows.points));
        mFaces.append(std::move(rows.faces));
        mGrid.insert(mGrid.end(), rows.grid.begin(), rows.grid.end());
    }

    void addGridNormals()
    {
        if (mResult.hasNormals() || !mResult.triangles.empty() || mGrid.empty()) return;
        RangeGrid grid;
        grid.columns = mHeader.gridColumns;
        grid.rows = mHeader.gridRows;
        if (grid.columns == 0 || mGrid.size() % grid.columns != 0 ||
            mGrid.size() / grid.columns != grid.rows) {
            mResult.notes.push_back(
                "its range_grid does not have num_cols x num_rows cells, and is "
                "ignored");
            return;
        }
        grid.points = std::move(mGrid);
        addRangeNormals(mResult, grid);
    }

    [[noreturn]] void throwNoVertices() const
    {
        throw InputError(fmt::format("{}: has no vertices{}. Check what was exported.",
                                     mSource.name(), butNotes(mResult)));
    }

    [[noreturn]] void throwMissing(const PlyElement& element, std::uint64_t found) const
    {
        throw InputError(fmt::format("{}: the header promises {} lines ({}), but there are at most "
                                     "{}: the file is truncated or its header is wrong. Copy or "
                                     "export it again.",
                                     mSource.name(), element.count, element.name, found));
    }

    const ByteSource& mSource;
    const ScalarNames& mScalars;
    Interrupter& mProgress;
    PlyHeader mHeader;
    FilePoints mResult;
    Faces mFaces;
    std::vector<std::uint32_t> mGrid;
};

} // namespace

FilePoints readPly(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    return PlyReader(source, scalars, progress).read();
}

} // namespace mpuvdb
