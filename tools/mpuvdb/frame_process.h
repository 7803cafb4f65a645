// A frame of a sequence, made by a process of its own.
#pragma once
#include <nlohmann/json.hpp>

#include <csignal>
#include <functional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace mpuvdb::command
{

/// How the run of a frame ended.
struct FrameEnd {
    int status = 0;                ///< exit status
    std::string message;           ///< why, where it is not 0
    std::string out;               ///< what it printed on standard output
    nlohmann::ordered_json report; ///< null where the process crashed
};

/// A run of this same program for one frame.
class FrameProcess
{
public:
    /// The words of its command line. @param report  a descriptor that takes its report as JSON.
    using Words = std::function<std::vector<std::string>(int report)>;

    /// @param signals  the signals to let through in the child, which are blocked here.
    /// @throws std::system_error.
    FrameProcess(const Words& words, const sigset_t& signals);
    FrameProcess(const FrameProcess&) = delete;
    FrameProcess& operator=(const FrameProcess&) = delete;
    ~FrameProcess();

    /// A descriptor that can be read when the child has said something, or has ended.
    int said() const { return mSaid; }
    /// The whole lines that it said since the last call. @param ended  whether it said its last.
    std::vector<std::string> lines(bool& ended);
    void signal(int number) const;
    /// Waits for the end of the child, and tells of it.
    FrameEnd end();

private:
    pid_t mChild = -1;
    int mSaid = -1, mOut = -1, mReport = -1;
    std::string mUnfinished; ///< line
};

} // namespace mpuvdb::command
