// Checks before the work whether outputs can be written.
#pragma once
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// A file that a verb writes.
struct Output {
    std::string option;                  ///< its option, for messages
    std::string path;                    ///< "-": standard output; empty: no output
    std::vector<std::string> extensions; ///< known ones, lower case; empty: any
    bool printable = false;              ///< whether "-" is allowed
    bool joinsFrames = false;            ///< whether one file can hold all frames of a sequence
    bool isFolder = false;               ///< a folder of files
};

/// The extension of @a path in lower case, with its dot.
std::string extensionOf(const std::string& path);

/// @throws UsageError if an output is also an input or another output.
void checkDistinct(const std::vector<Output>& outputs, const std::vector<std::string>& inputs);

/// @throws UsageError for an unknown extension, or "-" where it is not allowed.
void checkForm(const Output& output);

/// @throws as checkForm(); IoError where the
/// folder is missing or not writable.
void checkOutput(const Output& output);

} // namespace mpuvdb::command
