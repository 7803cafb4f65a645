// A look at a .vdb file's skeleton before OpenVDB, which trusts every number in it, sees the file.
#pragma once
#include <filesystem>

namespace mpuvdb
{

/// Check magic number, version, metadata, grid descriptors and each grid's head against the file's
/// size, so that truncated and most damaged files are refused here.
/// Formats up to 225, of OpenVDB 13, are let through: what it adds to 224 is a type of grids
/// (half), and nothing of how others are stored. [derived: its readers, which never ask for 225]
/// @throws IoError (cannot read), InputError (not a .vdb, truncated, damaged).
void checkVdbLayout(const std::filesystem::path& file);

/// Where the file's version begins, a number of 32 bits.
constexpr long kVdbVersionOffset = 8;
/// Where the file's 36 characters of unique identifier begin; its metadata follow them.
constexpr long kVdbUuidOffset = 21;
constexpr std::size_t kVdbUuidSize = 36;

} // namespace mpuvdb
