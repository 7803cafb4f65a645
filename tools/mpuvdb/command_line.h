// Parses the command line.
#pragma once
#include "verb.h"

namespace mpuvdb::command
{

/// The verb with its options; none where help or the version was printed.
struct CommandLine {
    std::unique_ptr<Verb> verb;
    CommonOptions options;
};

/// @param words  from the program's name on.
/// @throws UsageError, with a suggestion for an unknown word; IoError.
CommandLine parseCommandLine(const std::vector<std::string>& words);

} // namespace mpuvdb::command
