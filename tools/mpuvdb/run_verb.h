// Runs a verb: from parsed options to exit status.
#pragma once
#include "verb.h"

#include <functional>
#include <optional>
#include <string>

namespace mpuvdb::command
{

/// Calls @a work; prints and reports its exceptions. @return the exit status.
int guarded(Session& session, const std::function<ExitCode()>& work);

/// Runs @a verb and writes its report. @param report  receives the report as JSON; may be null.
/// @return the exit status.
int runVerb(Verb& verb, const CommonOptions& options, std::string* report = nullptr);

/// The files that @a verb would name, without a word; none where it ends without any, such as
/// sample --list. @throws UsageError.
std::optional<NamedFiles> namedFiles(Verb& verb, CommonOptions options);

} // namespace mpuvdb::command
