// Binary records: values of known type at known offsets.
#pragma once
#include "files/byte_source.h"
#include "points/import/raw_points.h"

#include <cstring>

namespace mpuvdb
{

enum class ScalarType : std::uint8_t {
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Int64,
    UInt64,
    Float32,
    Float64
};

std::size_t sizeOf(ScalarType type);
inline bool isFloat(ScalarType type)
{
    return type >= ScalarType::Float32;
}
/// The value at @a at, which need not be aligned; @a swap where its byte order is not the
/// machine's.
double loadScalar(ScalarType type, const char* at, bool swap);
/// The value as an integer; floats are truncated, values out of range become -1.
std::int64_t loadInteger(ScalarType type, const char* at, bool swap);

/// One attribute's values in a block of records: value i is at offset + i * stride.
struct Column {
    Attribute attribute = Attribute::None;
    ScalarType type = ScalarType::Float32;
    std::uint64_t offset = 0, stride = 0;
};

/// The layout of a run of records.
struct RecordLayout {
    std::vector<Column> columns;
    std::uint64_t stride = 0; ///< bytes per record
    bool swap = false;        ///< byte order is not this machine's

    AttributeSet attributes() const;
};

/// Decodes @a count records at @a data.
PointBlock decodeRecords(const char* data, std::size_t count, const RecordLayout& layout);

/// Reads and decodes @a count records of layout.stride bytes at @a offset, in parallel.
/// @throws InputError if the input is too short for them, before any memory is taken.
PointBlock readRecords(const ByteSource& source, std::uint64_t offset, std::uint64_t count,
                       const RecordLayout& layout, const char* unit, Interrupter& progress);

/// @throws InputError unless @a count records of @a stride bytes follow @a offset.
void requireRecords(const ByteSource& source, std::uint64_t offset, std::uint64_t count,
                    std::uint64_t stride, const char* unit);

} // namespace mpuvdb
