// Bundles of options for kinds of data.
#pragma once
#include <CLI/CLI.hpp>

#include <string>

namespace mpuvdb::command
{

/// Add --preset to a verb that has all options that presets set.
CLI::Option* addPreset(CLI::App& app, std::string& preset);

/// Set what @a preset says, except for what was given on the command line, which has been parsed.
/// Returns the options set, as one would type them; empty without a preset.
std::string applyPreset(CLI::App& app, const std::string& preset);

} // namespace mpuvdb::command
