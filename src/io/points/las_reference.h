// The reference system of a LAS file: whether its coordinates are lengths.
#pragma once
#include "files/byte_source.h"

namespace mpuvdb
{

/// The size of the header of LAS 1.4, bytes. [derived: LAS 1.4 R15]
constexpr std::size_t kLasHeaderBytes14 = 375;

/// Refuses a LAS file with a geographic reference system, by GeoTIFF keys or well-known text (WKT 1
/// or 2): its x and y are degrees. A file without a system is accepted. @throws InputError with the
/// cure.
void refuseDegrees(const ByteSource& source);

} // namespace mpuvdb
