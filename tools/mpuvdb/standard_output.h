// Data on standard output, and files from standard input.
#pragma once
#include <filesystem>
#include <functional>
#include <string>

namespace mpuvdb::command
{

/// Reserves the numbers of closed standard streams, which the next opened file would get: reading
/// and writing them fails.
void keepStandardFiles();

/// Writes @a text to standard output. @throws IoError if not all of it was written.
void printText(const std::string& text);

/// Calls @a write with a temporary file with @a extension, and copies it to standard output.
/// Nothing is copied unless the file is complete.
void printFile(const std::string& extension,
               const std::function<void(const std::filesystem::path&)>& write);

/// Calls @a read with @a file, or if that is "-", with a temporary file with @a extension that
/// holds standard input. @throws IoError.
void readFile(const std::string& file, const std::string& extension,
              const std::function<void(const std::filesystem::path&)>& read);

/// Removes the temporary files of these two (async-signal-safe), at an immediate end.
void removeScratchFolders() noexcept;

} // namespace mpuvdb::command
