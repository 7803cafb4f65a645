// Typed exceptions. Every message says what is wrong, where, and the cure.
#pragma once
#include <cerrno>
#include <stdexcept>
#include <string>

namespace mpuvdb
{

/// Base of all exceptions that this library throws.
class Error : public std::runtime_error
{
public:
    Error(const char* type, const std::string& message) : std::runtime_error(message), mType(type)
    {
    }
    /// Name of the type, as it stands in reports ("InputError").
    const char* type() const noexcept { return mType; }

private:
    const char* mType;
};

/// The caller asked for something that makes no sense: an option, a range, a unit.
class UsageError : public Error
{
public:
    explicit UsageError(const std::string& m) : Error("UsageError", m) {}
};

/// The data are unusable: a malformed file, no points, a grid that is not a level set.
class InputError : public Error
{
public:
    explicit InputError(const std::string& m) : Error("InputError", m) {}
};

/// The operating system refused: a file that cannot be opened, read, written or renamed.
class IoError : public Error
{
public:
    /// @param number  the system's error number (errno); 0: unknown.
    explicit IoError(const std::string& m, int number = 0)
        : Error("IoError", m), mMayPass(mayPass(number))
    {
    }
    /// Whether the same work may succeed later: a full disk, a file system that fails for a moment.
    bool mayPass() const noexcept { return mMayPass; }

private:
    static bool mayPass(int number)
    {
        for (const int passing :
             {EAGAIN, EBUSY, EDQUOT, EIO, EMFILE, ENFILE, ENOSPC, ESTALE, ETIMEDOUT})
            if (number == passing) return true;
        return false;
    }

    bool mMayPass;
};

/// The work would exceed a limit: memory, voxels, index range.
class LimitError : public Error
{
public:
    explicit LimitError(const std::string& m) : Error("LimitError", m) {}
};

/// Interrupter::stop() was called; nothing partial is left behind.
class Interrupted : public Error
{
public:
    Interrupted() : Error("Interrupted", "interrupted") {}
};

} // namespace mpuvdb
