// Typed exceptions. Every message says what is wrong, where, and the cure.
#pragma once
#include <stdexcept>
#include <string>

namespace mpuvdb
{

/// Exit status of a command, by the kind of its error.
enum class ExitCode : int {
    Ok = 0,
    Internal = 1,
    Usage = 2,
    BadInput = 3,
    CheckFailed = 4,
    Limit = 5,
    Interrupted = 130
};

/// Base of all exceptions that this library throws.
class Error : public std::runtime_error
{
public:
    Error(ExitCode code, const char* type, const std::string& message)
        : std::runtime_error(message), mCode(code), mType(type)
    {
    }
    /// Exit status of a command that ends with this error.
    ExitCode code() const noexcept { return mCode; }
    /// Name of the type, as it stands in reports ("InputError").
    const char* type() const noexcept { return mType; }

private:
    ExitCode mCode;
    const char* mType;
};

/// The caller asked for something that makes no sense: an option, a range, a unit.
class UsageError : public Error
{
public:
    explicit UsageError(const std::string& m) : Error(ExitCode::Usage, "UsageError", m) {}
};

/// The data are unusable: a malformed file, no points, a grid that is not a level set.
class InputError : public Error
{
public:
    explicit InputError(const std::string& m) : Error(ExitCode::BadInput, "InputError", m) {}
};

/// The operating system refused: a file that cannot be opened, read, written or renamed.
class IoError : public Error
{
public:
    explicit IoError(const std::string& m) : Error(ExitCode::BadInput, "IoError", m) {}
};

/// The work would exceed a limit: memory, voxels, index range.
class LimitError : public Error
{
public:
    explicit LimitError(const std::string& m) : Error(ExitCode::Limit, "LimitError", m) {}
};

/// Interrupter::stop() was called; nothing partial is left behind.
class Interrupted : public Error
{
public:
    Interrupted() : Error(ExitCode::Interrupted, "Interrupted", "interrupted") {}
};

} // namespace mpuvdb
