// Columns before the positions of a plain text file: numbers of the rows, and times.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// What the first column of a row may be.
enum class Leading : std::uint8_t {
    Coordinate, ///< nothing speaks against x
    Number,     ///< it numbers the rows
    Time,       ///< seconds or less since some day long ago
    Unclear     ///< it may be x, or number or time the rows
};

/// Rows in which a column rises that numbers or times them. [derived: rows of a raster, along which
/// x rises, have fewer than 65536 columns]
constexpr std::size_t kRisingRows = 1 << 16;

/// What column @a column of some @a rows is, all of the same length, if no column before it is a
/// coordinate. Three columns alone are always x, y and z.
Leading leadingColumn(const std::vector<std::vector<double>>& rows, std::size_t column);

/// Whether @a rows may be a part of a raster's line, along which @a column rises and the next one
/// lies straight, so that only the rows behind them tell numbers from coordinates.
bool mayBeRasterLine(const std::vector<std::vector<double>>& rows, std::size_t column);

/// What a column that seemed to be @a seemed is where it does not rise in the rows that follow.
Leading leadingIfItFalls(Leading seemed);

} // namespace mpuvdb
