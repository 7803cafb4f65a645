// PCD of the Point Cloud Library: ascii, binary, binary_compressed.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "lzf.h"
#include "readers.h"
#include "records.h"
#include "surplus.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace mpuvdb
{
namespace
{

struct PcdField {
    Attribute attribute = Attribute::None;
    ScalarType type = ScalarType::Float32;
    std::uint64_t count = 1;
};

struct PcdHeader {
    std::vector<PcdField> fields;
    std::uint64_t points = 0;
    std::string data; ///< "ascii", "binary", "binary_compressed"
    std::uint64_t dataOffset = 0, lines = 0;
    std::vector<std::string> scalarNames; ///< that can be requested
    std::optional<Vec3d> eye;             ///< of a range image

    std::uint64_t stride() const
    {
        std::uint64_t bytes = 0;
        for (const PcdField& field : fields) bytes += sizeOf(field.type) * field.count;
        return bytes;
    }
};

bool parseType(char letter, std::int64_t size, ScalarType& type)
{
    using S = ScalarType;
    const std::string key = letter + std::to_string(size);
    const std::pair<const char*, S> types[] = {
        {"I1", S::Int8},    {"U1", S::UInt8},  {"I2", S::Int16}, {"U2", S::UInt16},
        {"I4", S::Int32},   {"U4", S::UInt32}, {"I8", S::Int64}, {"U8", S::UInt64},
        {"F4", S::Float32}, {"F8", S::Float64}};
    for (const auto& [name, value] : types)
        if (key == name) {
            type = value;
            return true;
        }
    return false;
}

class PcdHeaderParser
{
public:
    PcdHeaderParser(const ByteSource& source, const ScalarNames& scalars)
        : mSource(source), mScalars(scalars), mLines(source)
    {
    }

    PcdHeader parse()
    {
        std::string_view line;
        while (mLines.next(line)) {
            LineScanner scan(line);
            const std::string_view keyword =
                scan.atEndOrComment() ? std::string_view() : scan.word();
            parseLine(keyword, scan);
            if (keyword == "DATA") return finish();
        }
        throwBad("the file ends before DATA");
    }

private:
    [[noreturn]] void throwBad(const std::string& what) const
    {
        throw InputError(fmt::format("{}: line {} of the PCD header: {}. Export the file again.",
                                     mSource.name(), mLines.line(), what));
    }

    void parseLine(std::string_view keyword, LineScanner& scan)
    {
        if (keyword == "FIELDS" || keyword == "COLUMNS")
            while (!scan.atEnd()) mNames.emplace_back(scan.word());
        else if (keyword == "SIZE")
            integers(scan, mSizes);
        else if (keyword == "TYPE")
            while (!scan.atEnd()) mTypes += scan.word().front();
        else if (keyword == "COUNT")
            integers(scan, mCounts);
        else if (keyword == "WIDTH")
            integers(scan, mWidth);
        else if (keyword == "HEIGHT")
            integers(scan, mHeight);
        else if (keyword == "POINTS")
            integers(scan, mPoints);
        else if (keyword == "DATA")
            mHeader.data = lowerCase(scan.word());
        else if (keyword == "VIEWPOINT")
            viewpoint(scan);
        else if (keyword != "VERSION" && !keyword.empty())
            throwBad("unknown keyword " + inQuotes(keyword));
    }

    void integers(LineScanner& scan, std::vector<std::int64_t>& values) const
    {
        while (!scan.atEnd()) {
            std::int64_t value = 0;
            if (!scan.integer(value) || value < 0 || value > (std::int64_t(1) << 40))
                throwBad("wants whole numbers");
            values.push_back(value);
        }
    }

    /// Reads the position; the rotation that follows is for viewers.
    void viewpoint(LineScanner& scan)
    {
        for (double& x : mEye)
            if (!scan.number(x)) throwBad("VIEWPOINT wants numbers");
    }

    PcdHeader finish()
    {
        const std::size_t fields = mNames.size();
        if (mCounts.empty()) mCounts.assign(fields, 1);
        if (mSizes.size() != fields || mTypes.size() != fields || mCounts.size() != fields)
            throwBad("FIELDS, SIZE, TYPE and COUNT do not have the same number of entries");
        std::vector<Attribute> attributes;
        for (std::size_t f = 0; f < fields; ++f) {
            PcdField field;
            if (!parseType(mTypes[f], mSizes[f], field.type) || mCounts[f] > (1 << 20))
                throwBad(fmt::format("{}: unknown type", inQuotes(mNames[f])));
            field.count = std::uint64_t(mCounts[f]);
            if (field.count == 1) field.attribute = attributeOf(mNames[f], mScalars);
            if (field.attribute == Attribute::PackedRgb && sizeOf(field.type) != 4)
                field.attribute = Attribute::None;
            if (field.count == 1 && isNamedScalar(field.attribute) && mNames[f] != "_")
                mHeader.scalarNames.push_back(mNames[f]);
            attributes.push_back(field.attribute);
            mHeader.fields.push_back(field);
        }
        if (!AttributeSet(attributes).position) throwBad("there are no fields x, y and z");
        if (mPoints.empty() && mWidth.size() == 1 && mHeight.size() == 1 &&
            (mHeight[0] == 0 || mWidth[0] <= (std::int64_t(1) << 40) / mHeight[0]))
            mPoints = {mWidth[0] * mHeight[0]};
        if (mPoints.size() != 1) throwBad("the number of points is missing");
        mHeader.points = std::uint64_t(mPoints[0]);
        // The rows of an image have one viewpoint; lists have this line, too, whatever they are of.
        if (mHeight.size() == 1 && mHeight[0] > 1 && mEye.allFinite()) mHeader.eye = mEye;
        mHeader.dataOffset = mLines.offset();
        mHeader.lines = mLines.line();
        return std::move(mHeader);
    }

    const ByteSource& mSource;
    const ScalarNames& mScalars;
    LineReader mLines;
    PcdHeader mHeader;
    std::vector<std::string> mNames;
    std::string mTypes;
    Vec3d mEye = Vec3d::Zero();
    std::vector<std::int64_t> mSizes, mCounts, mWidth, mHeight, mPoints;
};

// Records follow each other, or, in compressed files, each field's values.
RecordLayout layoutOf(const PcdHeader& header, bool byField)
{
    RecordLayout layout;
    layout.stride = header.stride();
    std::uint64_t offset = 0;
    for (const PcdField& field : header.fields) {
        const std::uint64_t bytes = sizeOf(field.type) * field.count;
        if (field.attribute != Attribute::None)
            layout.columns.push_back(
                {field.attribute, field.type, offset, byField ? bytes : layout.stride});
        offset += byField ? bytes * header.points : bytes;
    }
    return layout;
}

PointBlock readCompressed(const ByteSource& source, const PcdHeader& header)
{
    ByteCursor cursor(source, header.dataOffset);
    const auto packed = std::uint64_t(loadInteger(ScalarType::UInt32, cursor.take(4), false));
    const auto unpacked = std::uint64_t(loadInteger(ScalarType::UInt32, cursor.take(4), false));
    if (header.points > unpacked / header.stride() || unpacked != header.points * header.stride())
        throw InputError(
            fmt::format("{}: the header promises {} points of {} bytes, its compressed "
                        "data {} bytes: the file is damaged. Export it again.",
                        source.name(), header.points, header.stride(), unpacked));
    if (packed > cursor.remaining() || unpacked > packed * kMaxLzfRatio)
        throw InputError(fmt::format("{}: {} bytes of compressed data are too few: the file is "
                                     "truncated. Copy or export it again.",
                                     source.name(), cursor.remaining()));
    std::vector<char> data(unpacked);
    const std::size_t packedBytes = std::size_t(packed);
    if (!lzfDecompress(cursor.take(packedBytes), packedBytes, data.data(), data.size()))
        throw InputError(fmt::format(
            "{}: its compressed data are damaged. Copy or export it again.", source.name()));
    return decodeRecords(data.data(), std::size_t(header.points), layoutOf(header, true));
}

// The packed color, written as a whole number, or as the float with its bits.
double packedFromText(ScalarType type, double value)
{
    if (!isFloat(type)) return value;
    const auto asFloat = float(value);
    std::uint32_t bits = 0;
    std::memcpy(&bits, &asFloat, sizeof bits);
    return bits;
}

void parseRow(const ByteSource& source, const PcdHeader& header, const AttributeSet& has,
              std::string_view line, std::uint64_t number, PointBlock& block)
{
    LineScanner scan(line);
    RowValues row{};
    for (const PcdField& field : header.fields)
        for (std::uint64_t i = 0; i < field.count; ++i) {
            double value = 0;
            if (!scan.number(value))
                throw InputError(
                    fmt::format("{}: line {}: {} does not have the numbers that FIELDS "
                                "promises. Export the file again.",
                                source.name(), number, inQuotes(line)));
            if (field.attribute == Attribute::None) continue;
            if (field.attribute == Attribute::PackedRgb) value = packedFromText(field.type, value);
            row[std::size_t(field.attribute)] = value;
        }
    block.append(row, has);
}

std::string countsOf(const PcdHeader& header)
{
    return fmt::format("{} points", header.points);
}

void readText(const ByteSource& source, const PcdHeader& header, FilePoints& result,
              Interrupter& progress)
{
    const AttributeSet has = layoutOf(header, false).attributes();
    LineReader lines(source, header.dataOffset, header.lines);
    const std::uint64_t found = parseLines<PointBlock>(
        lines, header.points, progress,
        [&](const LineBatch& batch, PointBlock& block) {
            block.reserve(batch.lines, has);
            forEachLine(batch, [&](std::string_view line, std::uint64_t number) {
                parseRow(source, header, has, line, number, block);
            });
        },
        [&](PointBlock&& block) { result.blocks.push_back(std::move(block)); });
    if (found < header.points)
        throw InputError(
            fmt::format("{}: the header promises {} points, but {} follow: the file is "
                        "truncated. Copy or export it again.",
                        source.name(), header.points, found));
    noteSurplus(result, rowsLeft(lines, progress), countsOf(header));
}

void readBinary(const ByteSource& source, const PcdHeader& header, FilePoints& result,
                Interrupter& progress)
{
    result.blocks.push_back(readRecords(source, header.dataOffset, header.points,
                                        layoutOf(header, false), "point", progress));
    const std::uint64_t end = header.dataOffset + header.points * header.stride();
    noteSurplus(result, recordsLeft(source, end, header.stride(), progress), countsOf(header));
}

} // namespace

FilePoints readPcd(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    const PcdHeader header = PcdHeaderParser(source, scalars).parse();
    FilePoints result;
    result.scalarNames = header.scalarNames;
    if (header.data == "ascii")
        readText(source, header, result, progress);
    else if (header.data == "binary")
        readBinary(source, header, result, progress);
    else if (header.data == "binary_compressed")
        result.blocks.push_back(readCompressed(source, header));
    else
        throw InputError(fmt::format("{}: DATA {} is not known. Write it as ascii, binary or "
                                     "binary_compressed.",
                                     source.name(), inQuotes(header.data)));
    if (header.eye && !result.hasNormals()) {
        for (PointBlock& block : result.blocks) block.seenFrom = Viewpoint{*header.eye, false};
        result.notes.push_back(fmt::format("a range image, seen from ({:g}, {:g}, {:g})",
                                           (*header.eye)[0], (*header.eye)[1], (*header.eye)[2]));
    }
    return result;
}

} // namespace mpuvdb
