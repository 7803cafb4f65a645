// Rows that follow those which a file's header counts.
#pragma once
#include "files/line_reader.h"
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// The lines that are left and begin with a number, as rows do and remarks do not.
std::uint64_t rowsLeft(LineReader& lines, Interrupter& progress);

/// The records of @a stride bytes that the bytes from @a begin to @a end (or the end of the input)
/// would hold; none where they all are zero, as those are that fill up a file.
std::uint64_t recordsLeft(const ByteSource& source, std::uint64_t begin, std::uint64_t stride,
                          Interrupter& progress, std::uint64_t end = ~std::uint64_t(0));

/// Note that @a rows follow those of @a said ("160 vertices") and are left out, if there are any.
void noteSurplus(FilePoints& points, std::uint64_t rows, const std::string& said);

} // namespace mpuvdb
