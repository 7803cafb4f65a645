// LAS 1.0 to 1.4, uncompressed.
#include "las_reference.h"
#include "readers.h"
#include "records.h"
#include "surplus.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// The sizes of the header of LAS 1.0 and 1.3, the number of point formats, and of each the size of
/// a point and the offsets of intensity and color (0: none), bytes. [derived: LAS 1.4 R15]
constexpr std::size_t kHeaderBytes = 227, kHeaderBytes13 = 235;
constexpr int kPointFormats = 11;
constexpr std::uint64_t kPointBytes[kPointFormats] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::uint64_t kIntensityOffset = 12;
constexpr std::uint64_t kColorOffset[kPointFormats] = {0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30};

struct LasHeader {
    std::uint64_t offset = 0, stride = 0, points = 0;
    std::uint64_t end = ~std::uint64_t(0); ///< offset of records that may follow the points
    int format = 0;
    Vec3d scale, shift;
};

LasHeader parseHeader(const ByteSource& source)
{
    const std::string head = source.head(kLasHeaderBytes14);
    const auto integer = [&](ScalarType type, std::size_t at) {
        return std::uint64_t(loadInteger(type, head.data() + at, false));
    };
    if (head.size() < kHeaderBytes || head.compare(0, 4, "LASF") != 0)
        throw InputError(
            fmt::format("{}: its LAS header is incomplete: the file is truncated. Copy "
                        "it again.",
                        source.name()));
    LasHeader header;
    const unsigned minor = static_cast<unsigned char>(head[25]);
    header.offset = integer(ScalarType::UInt32, 96);
    header.format = static_cast<unsigned char>(head[104]);
    header.stride = integer(ScalarType::UInt16, 105);
    header.points = integer(ScalarType::UInt32, 107);
    if (header.format >= 64)
        throw InputError(
            fmt::format("{}: is compressed (LAZ). Decompress it first, for example with "
                        "'pdal translate in.laz out.las'.",
                        source.name()));
    if (minor >= 4 && head.size() >= kLasHeaderBytes14 && integer(ScalarType::UInt64, 247) > 0)
        header.points = integer(ScalarType::UInt64, 247);
    // Waveforms from 1.3 on, and extended records of 1.4; 0 where there are none.
    const auto endAt = [&](std::size_t at) {
        const std::uint64_t begin = integer(ScalarType::UInt64, at);
        if (begin > header.offset) header.end = std::min(header.end, begin);
    };
    const std::uint64_t size = std::min<std::uint64_t>(head.size(), header.offset);
    if (minor >= 3 && size >= kHeaderBytes13) endAt(227);
    if (minor >= 4 && size >= kLasHeaderBytes14) endAt(235);
    if (header.format >= kPointFormats || header.stride < kPointBytes[header.format] ||
        header.offset < kHeaderBytes)
        throw InputError(fmt::format("{}: point format {} with {} bytes per point at byte {} is no "
                                     "LAS 1.0 to 1.4. Export it again.",
                                     source.name(), header.format, header.stride, header.offset));
    for (int a = 0; a < 3; ++a) {
        header.scale[a] = loadScalar(ScalarType::Float64, head.data() + 131 + 8 * a, false);
        header.shift[a] = loadScalar(ScalarType::Float64, head.data() + 155 + 8 * a, false);
    }
    return header;
}

RecordLayout layoutOf(const LasHeader& header, const ScalarNames& scalars)
{
    RecordLayout layout;
    layout.stride = header.stride;
    for (int a = 0; a < 3; ++a)
        layout.columns.push_back(
            {Attribute(a), ScalarType::Int32, std::uint64_t(4 * a), header.stride});
    const std::uint64_t colors = kColorOffset[header.format];
    if (colors > 0)
        for (int c = 0; c < 3; ++c)
            layout.columns.push_back({Attribute(int(Attribute::Red) + c), ScalarType::UInt16,
                                      colors + std::uint64_t(2 * c), header.stride});
    layout.columns.push_back(
        {attributeOf("intensity", scalars), ScalarType::UInt16, kIntensityOffset, header.stride});
    if (layout.columns.back().attribute == Attribute::None) layout.columns.pop_back();
    return layout;
}

} // namespace

FilePoints readLas(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    const LasHeader header = parseHeader(source);
    refuseDegrees(source);
    requireRecords(source, header.offset, header.points, header.stride, "point");
    const RecordLayout layout = layoutOf(header, scalars);
    FilePoints result;
    result.scalarNames = {"intensity"};
    result.blocks.push_back(
        readRecords(source, header.offset, header.points, layout, "point", progress));
    noteSurplus(result,
                recordsLeft(source, header.offset + header.points * header.stride, header.stride,
                            progress, header.end),
                fmt::format("{} points", header.points));
    std::vector<Vec3d>& positions = result.blocks.front().positions;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, positions.size(), 1 << 14),
                      [&](const auto& range) {
                          for (std::size_t i = range.begin(); i < range.end(); ++i)
                              positions[i] = positions[i].cwiseProduct(header.scale) + header.shift;
                      });
    return result;
}

} // namespace mpuvdb
