// Lines that name the columns of the rows below.
#pragma once
#include "column_layout.h"

#include <string>
#include <vector>

namespace mpuvdb
{

/// A line split into names of columns.
struct ColumnNames {
    std::vector<std::string> names;
    char separator = ' '; ///< between them: ';', a tab, ',' or blanks
    std::uint64_t line = 0;

    /// Whether all are words, as in a header; a row has numbers.
    bool areWords() const;
    /// Whether two of them are degrees of longitude and latitude.
    bool areDegrees() const;
};

/// The names in @a line, a comment or not, separated by the first of ';', tab, ',' that it has.
ColumnNames columnNames(std::string_view line, std::uint64_t number);

/// The layout by the names of a line, which may have some of the @a scalars. Without x, y and z,
/// "X (m)", "easting", "northing" and "elevation" are positions, in some languages, and so are the
/// components of vectors: "Points:0", "P[x]". Colors have names in these languages, too. @return no
/// columns if there is no position.
ColumnLayout layoutFromNames(std::string_view line, const ScalarNames& scalars);

/// Whether a comment directly before @a row, of @a columns numbers, names them: there are as many
/// names, none is a number or a word of sentences, and they are separated as the row is, or half of
/// them are usual names of columns.
bool commentNamesColumns(const ColumnNames& comment, std::string_view row, std::size_t columns);

/// Refuses columns without positions. @throws InputError that lists them, with the cure.
[[noreturn]] void throwNoPositions(const std::string& file, const ColumnNames& names);

/// The cure for coordinates in degrees, for messages.
extern const char* const kReproject;

} // namespace mpuvdb
