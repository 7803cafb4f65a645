// What verbs of jobs share.
#pragma once
#include <string>

namespace mpuvdb::command
{

/// The version and a hash of the running program: tasks of one job need the same one.
std::string buildId();

} // namespace mpuvdb::command
