// Files that appear whole or not at all.
#pragma once
#include <filesystem>
#include <functional>

namespace mpuvdb
{

/// Call @a write with a temporary file's path in the target's folder; flush to disk and rename it
/// to @a file, or what @a file links to. If anything throws, or the process stops in order, nothing
/// is left behind; if it is killed, at most ".NAME.PID-N.tmp" is, and the old file is whole.
/// @throws IoError (no such folder, not a regular file, write-protected, disk full).
void writeAtomically(const std::filesystem::path& file,
                     const std::function<void(const std::filesystem::path&)>& write);

/// Remove the temporary files of all writes under way (async-signal-safe): for a command that has
/// to end now.
void removeTemporaryFiles() noexcept;

} // namespace mpuvdb
