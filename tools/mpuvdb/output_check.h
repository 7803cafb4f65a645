// Whether outputs can be written, asked before the long work and not after it.
#pragma once
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// One file that a verb is to write.
struct Output {
    std::string option;                  ///< that named it, for messages
    std::string path;                    ///< "-" for standard output; empty: not asked for
    std::vector<std::string> extensions; ///< known ones, lower case; empty: any
    bool printable = false;              ///< whether "-" is allowed
};

/// The extension of @a path in lower case, with its dot.
std::string extensionOf(const std::string& path);

/// @throws UsageError if an output is also an input or another output.
void checkDistinct(const std::vector<Output>& outputs, const std::vector<std::string>& inputs);

/// @throws UsageError for an unknown extension, or "-" where it is not allowed; IoError where the
/// folder is missing or not writable.
void checkOutput(const Output& output);

} // namespace mpuvdb::command
