// Rows beyond those that a file's header counts.
#pragma once
#include "files/line_reader.h"
#include "points/import/raw_points.h"

namespace mpuvdb
{

/// The number of further lines that begin with a number, as rows do and comments do not.
std::uint64_t rowsLeft(LineReader& lines, Interrupter& progress);

/// The number of records of @a stride bytes from @a begin to @a end (or the end of the input); 0
/// where all bytes are zero, as padding is.
std::uint64_t recordsLeft(const ByteSource& source, std::uint64_t begin, std::uint64_t stride,
                          Interrupter& progress, std::uint64_t end = ~std::uint64_t(0));

/// Notes that @a rows, if any, follow those of @a said ("160 vertices") and are left out.
void noteSurplus(FilePoints& points, std::uint64_t rows, const std::string& said);

} // namespace mpuvdb
