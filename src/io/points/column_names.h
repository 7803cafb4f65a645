// Lines that name the columns of the rows below them.
#pragma once
#include "column_layout.h"

#include <string>
#include <vector>

namespace mpuvdb
{

/// A line as names of columns, whether or not it was meant so.
struct ColumnNames {
    std::vector<std::string> names;
    char separator = ' '; ///< what parts them: ';', a tab, ',' or blanks
    std::uint64_t line = 0;

    /// Whether all are words, as in a header; a row has numbers.
    bool areWords() const;
    /// Whether two of them are degrees of longitude and latitude.
    bool areDegrees() const;
};

/// What @a line, a comment or not, names, parted by the first of ';', tab, ',' that it has.
ColumnNames columnNames(std::string_view line, std::uint64_t number);

/// The layout that the names of a line tell, which may have some of the @a scalars: if x, y and z
/// are not all among them, "X (m)", "easting", "northing" and "elevation" do. @return no columns if
/// there is no position.
ColumnLayout layoutFromNames(std::string_view line, const ScalarNames& scalars);

/// Whether a comment directly before @a row, of @a columns numbers, names them: there are as many,
/// none is a number or a word of sentences, and they are parted as the row is, or half of them are
/// what columns are called.
bool commentNamesColumns(const ColumnNames& comment, std::string_view row, std::size_t columns);

/// Refuse columns without positions. @throws InputError that lists them, with the cure.
[[noreturn]] void throwNoPositions(const std::string& file, const ColumnNames& names);

/// How degrees become a solid's lengths, for messages.
extern const char* const kReproject;

} // namespace mpuvdb
