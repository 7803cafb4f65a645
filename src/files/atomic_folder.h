// Folders that appear whole or not at all.
#pragma once
#include <filesystem>
#include <functional>

namespace mpuvdb
{

/// Call @a write with a temporary folder beside @a folder, flush its files to disk and put it in
/// the place of @a folder, which @a mayReplace is asked about before that if it is there and not
/// empty. If anything throws, or the process stops in order, nothing is left behind, and the old
/// folder stays as it was; if it is killed, at most ".NAME.PID-N.tmp" is.
/// @throws IoError (not a folder, no folder to put it in, write-protected, disk full), and what
/// @a mayReplace throws.
void writeFolderAtomically(const std::filesystem::path& folder,
                           const std::function<void(const std::filesystem::path&)>& mayReplace,
                           const std::function<void(const std::filesystem::path&)>& write);

/// Remove the temporary folder that is written (async-signal-safe): for a command that has to end
/// now.
void removeTemporaryFolder() noexcept;

} // namespace mpuvdb
