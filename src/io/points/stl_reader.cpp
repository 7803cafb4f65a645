// STL: triangles whose equal corners become one vertex.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "readers.h"
#include "records.h"
#include "surplus.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// The sizes of the header and of a triangle, bytes. [derived: binary STL]
constexpr std::uint64_t kHeaderBytes = 84, kTriangleBytes = 50;

struct SameBits {
    std::size_t operator()(const std::array<double, 3>& p) const
    {
        std::uint64_t h = 0;
        for (const double c : p) {
            std::uint64_t bits = 0;
            std::memcpy(&bits, &c, sizeof bits);
            h = (h ^ bits) * 0x9e3779b97f4a7c15ull;
            h ^= h >> 29;
        }
        return std::size_t(h);
    }
};

// Welds corners that are exactly equal.
class Welder
{
public:
    void add(double x, double y, double z)
    {
        const std::array<double, 3> key = {x + 0.0, y + 0.0, z + 0.0}; // -0 is 0
        const auto [at, isNew] = mIndices.try_emplace(key, std::uint32_t(mBlock.size()));
        if (isNew) mBlock.positions.emplace_back(x, y, z);
        mCorners.push_back(at->second);
    }
    std::size_t corners() const { return mCorners.size(); }

    FilePoints finish()
    {
        FilePoints result;
        result.unit = "vertex";
        for (std::size_t i = 2; i < mCorners.size(); i += 3)
            result.triangles.push_back({mCorners[i - 2], mCorners[i - 1], mCorners[i]});
        result.blocks.push_back(std::move(mBlock));
        return result;
    }

private:
    std::unordered_map<std::array<double, 3>, std::uint32_t, SameBits> mIndices;
    PointBlock mBlock;
    std::vector<std::uint32_t> mCorners;
};

FilePoints readBinary(const ByteSource& source, std::uint32_t triangles, Interrupter& progress)
{
    requireRecords(source, kHeaderBytes, triangles, kTriangleBytes, "triangle");
    ByteCursor cursor(source, kHeaderBytes);
    Welder welder;
    for (std::uint32_t t = 0; t < triangles; ++t) {
        const char* at = cursor.take(kTriangleBytes) + 12;
        for (int corner = 0; corner < 3; ++corner, at += 12)
            welder.add(loadScalar(ScalarType::Float32, at, false),
                       loadScalar(ScalarType::Float32, at + 4, false),
                       loadScalar(ScalarType::Float32, at + 8, false));
        if ((t & 0xfff) == 0xfff) progress.advance(double(0x1000 * kTriangleBytes));
    }
    FilePoints result = welder.finish();
    noteSurplus(result, recordsLeft(source, cursor.offset(), kTriangleBytes, progress),
                fmt::format("{} triangles", triangles));
    return result;
}

FilePoints readText(const ByteSource& source, Interrupter& progress)
{
    LineReader lines(source);
    Welder welder;
    std::string_view line;
    bool ended = false;
    while (lines.next(line)) {
        if ((lines.line() & 0xfff) == 0) progress.check();
        LineScanner scan(line);
        if (scan.atEndOrComment()) continue;
        const std::string keyword = lowerCase(scan.word());
        ended = keyword == "endsolid";
        if (keyword != "vertex") continue;
        double x = 0, y = 0, z = 0;
        if (!scan.number(x) || !scan.number(y) || !scan.number(z))
            throw InputError(
                fmt::format("{}: line {}: {} wants three numbers. Export the file again.",
                            source.name(), lines.line(), inQuotes(line)));
        welder.add(x, y, z);
    }
    if (!ended || welder.corners() % 3 != 0)
        throw InputError(
            fmt::format("{}: line {}: ends before 'endsolid': the file is truncated, or "
                        "no STL. Copy or export it again.",
                        source.name(), lines.line()));
    return welder.finish();
}

// Whether @a head has only characters of texts: the count in a binary one has a byte below 9,
// unless there are 151 million triangles.
bool isText(const std::string& head)
{
    return std::none_of(head.begin(), head.end(), [](char c) {
        return (c >= 0 && c < '\t') || (c > '\r' && c < ' ') || c == 0x7f;
    });
}

} // namespace

FilePoints readStl(const ByteSource& source, const ScalarNames&, Interrupter& progress)
{
    // Binary files may begin with "solid" too, and texts with something else: the size decides,
    // and where it is that of neither, the characters.
    const std::string head = source.head(kHeaderBytes);
    if (head.size() == kHeaderBytes) {
        const auto triangles =
            std::uint32_t(loadInteger(ScalarType::UInt32, head.data() + 80, false));
        const bool fits = source.size() >= kHeaderBytes + kTriangleBytes * std::uint64_t(triangles);
        const bool mayBeText = lowerCase(head.substr(0, 5)) == "solid" || isText(head);
        if (!mayBeText || (fits && triangles > 0)) return readBinary(source, triangles, progress);
    }
    return readText(source, progress);
}

} // namespace mpuvdb
