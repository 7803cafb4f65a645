// Columns before the positions of a plain text file: numbers of the rows, times, labels, normals.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace mpuvdb
{

/// What the first column of a row may be.
enum class Leading : std::uint8_t {
    Coordinate,     ///< nothing speaks against x
    Number,         ///< it numbers the rows
    Time,           ///< seconds or less since some day long ago
    Label,          ///< an intensity, or the number of a class, scan or row
    Normals,        ///< it and the next two are a vector of unit length
    Unclear,        ///< it may be x, or number or time the rows
    UnclearLabel,   ///< it may be x, or a label
    UnclearNormals, ///< it and the next two may be a position, or normals
    UnclearColors   ///< it and the next two may be a position, or a color
};

/// Rows in which a column rises that numbers or times them. [derived: rows of a raster, along which
/// x rises, have fewer than 65536 columns]
constexpr std::size_t kRisingRows = 1 << 16;

/// What column @a column of some @a rows is, all of the same length, if no column before it is a
/// coordinate. Three columns alone are always x, y and z.
Leading leadingColumn(const std::vector<std::vector<double>>& rows, std::size_t column);

/// Whether more rows may tell what a column is that seems to be @a seemed in the first @a rows: a
/// part of a raster's line, along which it rises and the next one lies straight; or a flat face.
bool mayChange(Leading seemed, const std::vector<std::vector<double>>& rows, std::size_t column);

/// Whether a column is what it seems only where it rises from row to row.
bool hasToRise(Leading seemed);

/// What a column that seemed to be @a seemed is where it does not rise in the rows that follow.
Leading leadingIfItFalls(Leading seemed);

/// What column @a column is, for a note; why that is not clear and what to do, for an error: empty
/// where it is clear.
std::string whatItIs(Leading meaning, std::size_t column);
std::string whyUnclear(Leading meaning, std::size_t column);

} // namespace mpuvdb
