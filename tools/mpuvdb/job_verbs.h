// What verbs of jobs share.
#pragma once
#include "exit_code.h"
#include "session.h"

#include <mpuvdb/farm.h>

#include <string>

namespace mpuvdb::command
{

/// The version and a hash of the running program: tasks of one job need the same one.
std::string buildId();

/// Says what a job came to, whose grid is in @a file. @return CheckFailed for a bad result.
ExitCode describeJob(Session& session, const JobResult& result, const std::string& file);

} // namespace mpuvdb::command
