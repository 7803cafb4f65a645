// The status that the command ends with.
#pragma once
#include <mpuvdb/error.h>

namespace mpuvdb::command
{

/// What a script sees.
enum class ExitCode : int {
    Ok = 0,
    Internal = 1,
    Usage = 2,
    BadInput = 3,
    CheckFailed = 4,
    Limit = 5,
    TryAgain = 6,
    Interrupted = 130
};

/// The status of a command that ends with @a error.
inline ExitCode exitCodeOf(const Error& error)
{
    if (dynamic_cast<const UsageError*>(&error)) return ExitCode::Usage;
    if (dynamic_cast<const LimitError*>(&error)) return ExitCode::Limit;
    if (dynamic_cast<const Interrupted*>(&error)) return ExitCode::Interrupted;
    if (const auto* const io = dynamic_cast<const IoError*>(&error); io && io->mayPass())
        return ExitCode::TryAgain;
    return ExitCode::BadInput;
}

} // namespace mpuvdb::command
