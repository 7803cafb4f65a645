// From the words typed to a verb ready to run.
#pragma once
#include "verb.h"

namespace mpuvdb::command
{

/// The verb asked for with its options filled in; or none, where help or the version was printed.
struct CommandLine {
    std::unique_ptr<Verb> verb;
    CommonOptions options;
};

/// @throws UsageError saying what was meant, where a word is unknown; IoError.
CommandLine parseCommandLine(int argc, char** argv);

} // namespace mpuvdb::command
