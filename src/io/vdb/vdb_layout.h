// A check of a .vdb file's structure before OpenVDB reads it, which trusts every number in it.
#pragma once
#include <filesystem>

namespace mpuvdb
{

/// Checks magic number, version, metadata, grid descriptors and each grid's head against the file's
/// size, so that truncated and most damaged files are refused here. Formats up to 225, of OpenVDB
/// 13, are accepted: 225 adds a type of grids (half) to 224, and stores others alike.
/// @throws IoError (cannot read), InputError (not a .vdb, truncated, damaged).
void checkVdbLayout(const std::filesystem::path& file);

/// The offset of the file's version, a number of 32 bits, and of its unique identifier, and the
/// size of that, bytes; metadata follow it. [derived: OpenVDB's format]
constexpr long kVdbVersionOffset = 8;
constexpr long kVdbUuidOffset = 21;
constexpr std::size_t kVdbUuidSize = 36;

} // namespace mpuvdb
