// Data on standard output, and files that come through standard input.
#pragma once
#include <filesystem>
#include <functional>
#include <string>

namespace mpuvdb::command
{

/// Where standard input, output or errors are closed, take their numbers, which the next file to be
/// opened would get: reading and writing them fails from then on.
void keepStandardFiles();

/// Write @a text to standard output. @throws IoError if not all of it got there.
void printText(const std::string& text);

/// Let @a write make a file with @a extension in a folder of its own, and copy its bytes to
/// standard output. Nothing reaches standard output unless the file was made whole.
void printFile(const std::string& extension,
               const std::function<void(const std::filesystem::path&)>& write);

/// Let @a read read @a file, or if that is "-", standard input, kept meanwhile as a file with
/// @a extension in a folder of its own. @throws IoError.
void readFile(const std::string& file, const std::string& extension,
              const std::function<void(const std::filesystem::path&)>& read);

/// Remove the folders of these two (async-signal-safe): for a command that has to end now.
void removeScratchFolders() noexcept;

} // namespace mpuvdb::command
