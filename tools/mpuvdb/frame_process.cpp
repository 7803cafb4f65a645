#include "frame_process.h"

#include "exit_code.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

using Json = nlohmann::ordered_json;

/// @a result of a system call. @throws std::system_error where it failed.
int checked(int result)
{
    if (result < 0) throw std::system_error(errno, std::generic_category());
    return result;
}

/// The bytes of a file in memory.
std::string contents(int file)
{
    std::string bytes(std::size_t(std::max<off_t>(lseek(file, 0, SEEK_END), 0)), '\0');
    const ssize_t n = pread(file, bytes.data(), bytes.size(), 0);
    bytes.resize(std::size_t(std::max<ssize_t>(n, 0)));
    return bytes;
}

/// Why a frame failed, by its own report.
std::string reasonOf(const Json& report)
{
    if (report.contains("error")) return report["error"].value("message", "");
    std::vector<std::string> warnings;
    if (report.contains("warnings")) warnings = report["warnings"].get<std::vector<std::string>>();
    return fmt::format("{}", fmt::join(warnings, "; "));
}

/// The end of a child that a signal ended.
FrameEnd endBy(int signal)
{
    if (signal == SIGKILL)
        return {int(ExitCode::Limit),
                "the process was killed: the machine may be out of memory. Use fewer --jobs, or "
                "larger voxels",
                {},
                {}};
    if (signal == SIGINT || signal == SIGTERM || signal == SIGHUP)
        return {128 + signal, "interrupted", {}, {}};
    return {int(ExitCode::Internal),
            fmt::format("internal error: the process crashed ({})", strsignal(signal)),
            {},
            {}};
}

/// Runs this program anew in the child. As libraries have threads of their own, the child may do
/// nothing that takes a lock. @param files  what it says, its standard output and its report.
[[noreturn]] void becomeFrame(pid_t parent, const std::array<int, 3>& files, char* const* arguments,
                              const sigset_t& signals) noexcept
{
    prctl(PR_SET_PDEATHSIG, SIGTERM); // a sequence that is killed leaves no frames running
    if (getppid() == parent && dup2(files[0], STDERR_FILENO) >= 0 &&
        dup2(files[1], STDOUT_FILENO) >= 0 && fcntl(files[2], F_SETFD, 0) >= 0) {
        for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_DFL);
        sigprocmask(SIG_UNBLOCK, &signals, nullptr);
        execv("/proc/self/exe", arguments);
    }
    _exit(int(ExitCode::Internal));
}

} // namespace

FrameProcess::FrameProcess(const Words& words, const sigset_t& signals)
{
    std::array<int, 2> pipe{};
    checked(pipe2(pipe.data(), O_CLOEXEC));
    mSaid = pipe[0];
    mOut = checked(memfd_create("mpuvdb-out", MFD_CLOEXEC));
    mReport = checked(memfd_create("mpuvdb-report", MFD_CLOEXEC));
    std::vector<std::string> texts = words(mReport);
    std::vector<char*> arguments(texts.size() + 1, nullptr);
    std::transform(texts.begin(), texts.end(), arguments.begin(),
                   [](std::string& text) { return text.data(); });
    const pid_t parent = getpid();
    mChild = fork();
    if (mChild == 0) becomeFrame(parent, {pipe[1], mOut, mReport}, arguments.data(), signals);
    close(pipe[1]);
    checked(mChild);
}

FrameProcess::~FrameProcess()
{
    for (const int file : {mSaid, mOut, mReport})
        if (file >= 0) close(file);
}

std::vector<std::string> FrameProcess::lines(bool& ended)
{
    std::array<char, 65536> chunk{};
    const ssize_t n = read(mSaid, chunk.data(), chunk.size());
    ended = n == 0 || (n < 0 && errno != EINTR);
    if (n > 0) mUnfinished.append(chunk.data(), std::size_t(n));
    if (ended && !mUnfinished.empty()) mUnfinished += '\n';
    std::vector<std::string> whole;
    std::size_t start = 0;
    for (std::size_t at; (at = mUnfinished.find('\n', start)) != std::string::npos; start = at + 1)
        whole.push_back(mUnfinished.substr(start, at - start));
    mUnfinished.erase(0, start);
    return whole;
}

void FrameProcess::signal(int number) const
{
    kill(mChild, number);
}

FrameEnd FrameProcess::end()
{
    int status = 0;
    while (waitpid(mChild, &status, 0) < 0 && errno == EINTR) {
    }
    FrameEnd end;
    if (WIFSIGNALED(status)) end = endBy(WTERMSIG(status));
    if (WIFEXITED(status)) end.status = WEXITSTATUS(status);
    end.out = contents(mOut);
    end.report = Json::parse(contents(mReport), nullptr, false);
    if (end.report.is_discarded()) end.report = nullptr;
    if (end.message.empty() && end.status != 0) end.message = reasonOf(end.report);
    return end;
}

} // namespace mpuvdb::command
