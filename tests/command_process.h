// Runs the command as its users do, in a folder of its own.
#pragma once
#include <chrono>
#include <filesystem>
#include <string>
#include <sys/types.h>
#include <vector>

namespace mpuvdb::test
{

/// How a process ended, and what it said.
struct Ended {
    int status = -1; ///< exit status; 128 + signal if a signal ended it
    std::string out, err;
};

/// An empty folder that goes away with this object.
class TemporaryFolder
{
public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    const std::filesystem::path& path() const { return mPath; }
    std::filesystem::path operator/(const std::string& name) const { return mPath / name; }
    /// Names of all that is in it, sorted.
    std::vector<std::string> names() const;

private:
    std::filesystem::path mPath;
};

/// A process under way.
class Process
{
public:
    /// Start @a words in @a folder; "mpuvdb" is the command under test. Standard input is @a input.
    Process(const TemporaryFolder& folder, const std::vector<std::string>& words,
            const std::string& input = {});
    ~Process();
    Process(const Process&) = delete;
    Process& operator=(const Process&) = delete;

    void signal(int number) const;
    bool running();
    /// What it has said on standard error so far.
    std::string said() const;
    Ended wait();

private:
    void reap(int status);

    pid_t mPid = -1;
    TemporaryFolder mLogs; ///< its three standard streams
    Ended mEnded;
};

/// Start and wait.
Ended run(const TemporaryFolder& folder, const std::vector<std::string>& words,
          const std::string& input = {});

std::string readFile(const std::filesystem::path& file);
void writeFile(const std::filesystem::path& file, const std::string& bytes);

} // namespace mpuvdb::test
