// The header of a PLY file.
#pragma once
#include "records.h"

#include <string>

namespace mpuvdb
{

struct PlyProperty {
    std::string name;
    ScalarType type = ScalarType::Float32;
    bool isList = false;
    ScalarType countType = ScalarType::UInt8; ///< of a list
};

struct PlyElement {
    std::string name;
    std::uint64_t count = 0;
    std::vector<PlyProperty> properties;

    bool hasLists() const;
    /// Bytes per element in a binary file, without lists.
    std::uint64_t stride() const;
};

enum class PlyFormat { Ascii, LittleEndian, BigEndian };

struct PlyHeader {
    PlyFormat format = PlyFormat::Ascii;
    std::vector<PlyElement> elements;
    std::uint64_t gridColumns = 0, gridRows = 0; ///< of a range image; 0: none
    std::uint64_t dataOffset = 0;                ///< byte after the header
    std::uint64_t lines = 0;                     ///< of the header

    const PlyElement* find(std::string_view name) const;
};

/// @throws InputError saying which line is wrong.
PlyHeader readPlyHeader(const ByteSource& source);

} // namespace mpuvdb
