#include "ply_header.h"

#include "files/text_scan.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// The longest header, bytes. [tuned: io_broken_test]
constexpr std::size_t kMaxHeaderBytes = std::size_t(1) << 20;

[[noreturn]] void throwBadHeader(const ByteSource& source, std::uint64_t line,
                                 const std::string& what)
{
    throw InputError(fmt::format("{}: line {} of the PLY header: {}. Export the file again.",
                                 source.name(), line, what));
}

bool parseType(std::string_view word, ScalarType& type)
{
    static const std::unordered_map<std::string_view, ScalarType> types = {
        {"char", ScalarType::Int8},      {"int8", ScalarType::Int8},
        {"uchar", ScalarType::UInt8},    {"uint8", ScalarType::UInt8},
        {"short", ScalarType::Int16},    {"int16", ScalarType::Int16},
        {"ushort", ScalarType::UInt16},  {"uint16", ScalarType::UInt16},
        {"int", ScalarType::Int32},      {"int32", ScalarType::Int32},
        {"uint", ScalarType::UInt32},    {"uint32", ScalarType::UInt32},
        {"long", ScalarType::Int64},     {"int64", ScalarType::Int64},
        {"longlong", ScalarType::Int64}, {"ulonglong", ScalarType::UInt64},
        {"ulong", ScalarType::UInt64},   {"uint64", ScalarType::UInt64},
        {"float", ScalarType::Float32},  {"float32", ScalarType::Float32},
        {"double", ScalarType::Float64}, {"float64", ScalarType::Float64},
    };
    const auto found = types.find(word);
    if (found != types.end()) type = found->second;
    return found != types.end();
}

class HeaderParser
{
public:
    explicit HeaderParser(const ByteSource& source)
        : mSource(source), mText(source.head(kMaxHeaderBytes))
    {
    }

    PlyHeader parse()
    {
        std::string_view line;
        if (!nextLine(line) || line != "ply") throwBadHeader(mSource, 1, "is not 'ply'");
        while (nextLine(line)) {
            LineScanner scan(line);
            const std::string_view keyword = scan.word();
            if (keyword == "end_header") return finish();
            parseLine(keyword, scan);
        }
        throwBadHeader(mSource, mHeader.lines, "the file ends before 'end_header'");
    }

private:
    // Lines end in LF, CRLF or CR.
    bool nextLine(std::string_view& line)
    {
        if (mAt >= mText.size()) return false;
        const std::size_t end = mText.find_first_of("\r\n", mAt);
        if (end == std::string::npos) return false;
        line = std::string_view(mText).substr(mAt, end - mAt);
        while (!line.empty() && isSeparator(line.back())) line.remove_suffix(1);
        mAt = end + (mText.compare(end, 2, "\r\n") == 0 ? 2 : 1);
        ++mHeader.lines;
        return true;
    }

    void parseLine(std::string_view keyword, LineScanner& scan)
    {
        if (keyword == "format")
            parseFormat(scan);
        else if (keyword == "element")
            parseElement(scan);
        else if (keyword == "property")
            parseProperty(scan);
        else if (keyword == "obj_info" || keyword == "comment")
            parseInfo(scan);
        else if (!keyword.empty())
            throwBadHeader(mSource, mHeader.lines, "unknown keyword " + inQuotes(keyword));
    }

    void parseFormat(LineScanner& scan)
    {
        const std::string_view format = scan.word();
        if (format == "ascii")
            mHeader.format = PlyFormat::Ascii;
        else if (format == "binary_little_endian")
            mHeader.format = PlyFormat::LittleEndian;
        else if (format == "binary_big_endian")
            mHeader.format = PlyFormat::BigEndian;
        else
            throwBadHeader(mSource, mHeader.lines, "unknown format " + inQuotes(format));
        mHasFormat = true;
    }

    void parseElement(LineScanner& scan)
    {
        PlyElement element;
        element.name = scan.word();
        std::int64_t count = 0;
        if (element.name.empty() || !scan.integer(count) || count < 0)
            throwBadHeader(mSource, mHeader.lines, "wants 'element NAME COUNT'");
        element.count = std::uint64_t(count);
        mHeader.elements.push_back(std::move(element));
    }

    void parseProperty(LineScanner& scan)
    {
        if (mHeader.elements.empty())
            throwBadHeader(mSource, mHeader.lines, "a property stands before the first element");
        PlyProperty property;
        std::string_view type = scan.word();
        property.isList = type == "list";
        if (property.isList) {
            if (!parseType(scan.word(), property.countType) || isFloat(property.countType))
                throwBadHeader(mSource, mHeader.lines, "a list's length has an unknown type");
            type = scan.word();
        }
        if (!parseType(type, property.type))
            throwBadHeader(mSource, mHeader.lines, "unknown type " + inQuotes(type));
        property.name = scan.word();
        mHeader.elements.back().properties.push_back(std::move(property));
    }

    void parseInfo(LineScanner& scan)
    {
        const std::string_view what = scan.word();
        std::int64_t value = 0;
        if ((what != "num_cols" && what != "num_rows") || !scan.integer(value) || value < 0) return;
        (what == "num_cols" ? mHeader.gridColumns : mHeader.gridRows) = std::uint64_t(value);
    }

    PlyHeader finish()
    {
        if (!mHasFormat) throwBadHeader(mSource, mHeader.lines, "there was no 'format' line");
        mHeader.dataOffset = mAt;
        return std::move(mHeader);
    }

    const ByteSource& mSource;
    std::string mText;
    std::size_t mAt = 0;
    PlyHeader mHeader;
    bool mHasFormat = false;
};

} // namespace

bool PlyElement::hasLists() const
{
    for (const PlyProperty& property : properties)
        if (property.isList) return true;
    return false;
}

std::uint64_t PlyElement::stride() const
{
    std::uint64_t bytes = 0;
    for (const PlyProperty& property : properties) bytes += sizeOf(property.type);
    return bytes;
}

const PlyElement* PlyHeader::find(std::string_view name) const
{
    for (const PlyElement& element : elements)
        if (element.name == name) return &element;
    return nullptr;
}

PlyHeader readPlyHeader(const ByteSource& source)
{
    return HeaderParser(source).parse();
}

} // namespace mpuvdb
