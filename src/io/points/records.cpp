#include "records.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

namespace mpuvdb
{
namespace
{

constexpr std::uint64_t kRecordsAtOnce = 1 << 13; ///< in a task [free: grain size]

template <class T>
T load(const char* at, bool swap)
{
    char bytes[sizeof(T)];
    std::memcpy(bytes, at, sizeof(T));
    if (swap) std::reverse(bytes, bytes + sizeof(T));
    T value;
    std::memcpy(&value, bytes, sizeof(T));
    return value;
}

// Calls f with a value of the type.
template <class F>
auto withType(ScalarType type, F&& f)
{
    switch (type) {
    case ScalarType::Int8:
        return f(std::int8_t());
    case ScalarType::UInt8:
        return f(std::uint8_t());
    case ScalarType::Int16:
        return f(std::int16_t());
    case ScalarType::UInt16:
        return f(std::uint16_t());
    case ScalarType::Int32:
        return f(std::int32_t());
    case ScalarType::UInt32:
        return f(std::uint32_t());
    case ScalarType::Int64:
        return f(std::int64_t());
    case ScalarType::UInt64:
        return f(std::uint64_t());
    case ScalarType::Float32:
        return f(float());
    case ScalarType::Float64:
        break;
    }
    return f(double());
}

// The loop over a column, with type and byte order known outside of it. store(i, value).
template <class Store>
void forEachValue(const char* data, std::size_t count, const Column& column, bool swap,
                  const Store& store)
{
    withType(column.type, [&](auto example) {
        using T = decltype(example);
        const char* at = data + column.offset;
        if (swap)
            for (std::size_t i = 0; i < count; ++i, at += column.stride)
                store(i, load<T>(at, true));
        else
            for (std::size_t i = 0; i < count; ++i, at += column.stride)
                store(i, load<T>(at, false));
    });
}

// Decodes a column into the points from @a first on.
void decodeColumn(const char* data, std::size_t first, std::size_t count, const Column& column,
                  bool swap, const AttributeSet& has, PointBlock& block)
{
    const int a = int(column.attribute);
    if (column.attribute <= Attribute::Z) {
        Vec3d* to = block.positions.data() + first;
        forEachValue(data, count, column, swap,
                     [=](std::size_t i, auto v) { to[i][a] = double(v); });
    } else if (column.attribute <= Attribute::NormalZ && has.normals) {
        Vec3f* to = block.normals.data() + first;
        const int axis = a - int(Attribute::NormalX);
        forEachValue(data, count, column, swap,
                     [=](std::size_t i, auto v) { to[i][axis] = float(v); });
    } else if (column.attribute == Attribute::Confidence) {
        float* to = block.confidence.data() + first;
        forEachValue(data, count, column, swap, [=](std::size_t i, auto v) { to[i] = float(v); });
    } else if (isColor(column.attribute) && has.colors && !has.packedRgb) {
        const int channel = a - int(Attribute::Red);
        if (has.byteColors) {
            PointCloud::Rgb* to = block.colors.data() + first;
            forEachValue(data, count, column, swap, [=](std::size_t i, auto v) {
                to[i][std::size_t(channel)] = std::uint8_t(v);
            });
        } else {
            Vec3f* to = block.rawColors.data() + first;
            forEachValue(data, count, column, swap,
                         [=](std::size_t i, auto v) { to[i][channel] = float(v); });
        }
    } else if (column.attribute == Attribute::PackedRgb && sizeOf(column.type) == 4) {
        PointCloud::Rgb* to = block.colors.data() + first;
        Column bits = column; // also where the file calls it a float
        bits.type = ScalarType::UInt32;
        forEachValue(data, count, bits, swap, [=](std::size_t i, auto v) {
            const auto rgb = std::uint32_t(v);
            to[i] = {std::uint8_t(rgb >> 16), std::uint8_t(rgb >> 8), std::uint8_t(rgb)};
        });
    } else if (column.attribute >= Attribute::FirstScalar) {
        float* to = block.scalars[std::size_t(a - int(Attribute::FirstScalar))].data() + first;
        forEachValue(data, count, column, swap, [=](std::size_t i, auto v) { to[i] = float(v); });
    }
}

PointBlock makeBlock(std::size_t count, const AttributeSet& has)
{
    PointBlock block;
    resizeLarge(block.positions, count);
    if (has.normals) resizeLarge(block.normals, count);
    if (has.confidence) resizeLarge(block.confidence, count);
    if (has.colors && has.byteColors) resizeLarge(block.colors, count);
    if (has.colors && !has.byteColors) resizeLarge(block.rawColors, count);
    for (std::size_t n = 0; n < kMaxScalars; ++n)
        if (has.scalars[n]) resizeLarge(block.scalars[n], count);
    return block;
}

} // namespace

std::size_t sizeOf(ScalarType type)
{
    return withType(type, [](auto example) { return sizeof(example); });
}

double loadScalar(ScalarType type, const char* at, bool swap)
{
    return withType(type, [&](auto example) { return double(load<decltype(example)>(at, swap)); });
}

std::int64_t loadInteger(ScalarType type, const char* at, bool swap)
{
    if (type == ScalarType::UInt64) {
        const auto value = load<std::uint64_t>(at, swap);
        return value > std::uint64_t(std::numeric_limits<std::int64_t>::max())
                   ? -1
                   : std::int64_t(value);
    }
    if (type == ScalarType::Int64) return load<std::int64_t>(at, swap);
    const double value = loadScalar(type, at, swap);
    return value > -9e15 && value < 9e15 ? std::int64_t(value) : -1;
}

AttributeSet RecordLayout::attributes() const
{
    std::vector<Attribute> present;
    for (const Column& column : columns) present.push_back(column.attribute);
    AttributeSet has(present);
    has.byteColors =
        has.packedRgb || std::all_of(columns.begin(), columns.end(), [](const Column& column) {
            return !isColor(column.attribute) || column.type == ScalarType::UInt8;
        });
    return has;
}

PointBlock decodeRecords(const char* data, std::size_t count, const RecordLayout& layout)
{
    const AttributeSet has = layout.attributes();
    PointBlock block = makeBlock(count, has);
    for (const Column& column : layout.columns)
        decodeColumn(data, 0, count, column, layout.swap, has, block);
    return block;
}

void requireRecords(const ByteSource& source, std::uint64_t offset, std::uint64_t count,
                    std::uint64_t stride, const char* unit)
{
    const std::uint64_t present = source.size() - std::min(source.size(), offset);
    if (stride == 0 || count <= present / stride) return;
    throw InputError(fmt::format("{}: the header promises {} records ({}) of {} bytes, but only {} "
                                 "bytes follow it: the file is truncated or its header is wrong. "
                                 "Copy or export it again.",
                                 source.name(), count, unit, stride, present));
}

PointBlock readRecords(const ByteSource& source, std::uint64_t offset, std::uint64_t count,
                       const RecordLayout& layout, const char* unit, Interrupter& progress)
{
    requireRecords(source, offset, count, layout.stride, unit);
    const AttributeSet has = layout.attributes();
    PointBlock block = makeBlock(std::size_t(count), has);
    tbb::enumerable_thread_specific<std::vector<char>> buffers;
    const std::uint64_t pieces = (count + kRecordsAtOnce - 1) / kRecordsAtOnce;
    tbb::parallel_for(std::uint64_t(0), pieces, [&](std::uint64_t piece) {
        const std::uint64_t first = piece * kRecordsAtOnce;
        const auto records = std::size_t(std::min(kRecordsAtOnce, count - first));
        std::vector<char>& buffer = buffers.local();
        buffer.resize(records * layout.stride);
        source.read(offset + first * layout.stride, buffer.data(), buffer.size());
        for (const Column& column : layout.columns)
            decodeColumn(buffer.data(), std::size_t(first), records, column, layout.swap, has,
                         block);
        progress.advance(double(buffer.size()));
    });
    return block;
}

} // namespace mpuvdb
