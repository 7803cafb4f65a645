// The meaning of the columns of a plain text file.
#pragma once
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// The meaning of each column.
struct ColumnLayout {
    std::vector<Attribute> columns;
    std::vector<std::string> names; ///< of the columns, or none
};

/// What a file's format says of columns without names.
enum class ColumnOrder : std::uint8_t {
    Free,           ///< nothing
    NormalsLast,    ///< behind all positions, in rows of their own, their normals may stand
    IntensityFirst, ///< of the four behind a position the first is the intensity of a color
};

/// The layout by the values of some rows, all of the same length of at least three: positions
/// first, behind columns of which @a leading tells the meaning; then triples of unit length are
/// normals, triples of whole numbers in [0,255] colors, and so are those in [0,65535] at the end or
/// before normals, and fractions where nothing else is left beside positions and normals.
ColumnLayout layoutFromValues(const std::vector<std::vector<double>>& rows, ColumnOrder order,
                              const std::vector<Attribute>& leading);

} // namespace mpuvdb
