// What verbs of jobs share.
#pragma once
#include "exit_code.h"
#include "session.h"

#include <mpuvdb/farm.h>

#include <map>
#include <string>

namespace mpuvdb::command
{

/// The version and a hash of the running program: tasks of one job need the same one.
std::string buildId();

/// Reconstructs @a points by the tasks of a job in a folder beside @a file, one after the other,
/// and removes it. @param metadata  of the grid.
ExitCode reconstructInTasks(Session& session, PreparedPoints&& points,
                            const ReconstructionEstimate& estimate,
                            const std::map<std::string, std::string>& metadata,
                            const std::string& file);

/// Says what a job came to, whose grid is in @a file. @return CheckFailed for a bad result.
ExitCode describeJob(Session& session, const JobResult& result, const std::string& file);

} // namespace mpuvdb::command
