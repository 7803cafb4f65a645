// A look at a .vdb file's skeleton before OpenVDB, which trusts every number in it, sees the file.
#pragma once
#include <filesystem>

namespace mpuvdb
{

/// Check magic number, version, metadata, grid descriptors and each grid's head against the file's
/// size, so that truncated and most damaged files are refused here.
/// @throws IoError (cannot read), InputError (not a .vdb, truncated, damaged).
void checkVdbLayout(const std::filesystem::path& file);

/// Where the file's 36 characters of unique identifier begin.
constexpr long kVdbUuidOffset = 21;
constexpr std::size_t kVdbUuidSize = 36;

} // namespace mpuvdb
