// Bundles of options for kinds of data.
#pragma once
#include <CLI/CLI.hpp>

#include <string>

namespace mpuvdb::command
{

/// Declares --preset.
CLI::Option* addPreset(CLI::App& app, std::string& preset);

/// Sets the options of @a preset that the verb has, but those given on the command line, which has
/// been parsed.
/// @return the options set, as typed; empty without a preset.
std::string applyPreset(CLI::App& app, const std::string& preset);

} // namespace mpuvdb::command
