// The reference system of a LAS file: whether its coordinates are lengths.
#pragma once
#include "files/byte_source.h"

namespace mpuvdb
{

/// Refuse a LAS file that says, by GeoTIFF keys or well-known text (WKT 1 or 2), that its x and y
/// are degrees. A file that says nothing is believed. @throws InputError with the cure.
void refuseDegrees(const ByteSource& source);

} // namespace mpuvdb
