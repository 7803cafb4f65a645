#include "command_process.h"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <sys/wait.h>
#include <unistd.h>

namespace mpuvdb::test
{
namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder()
{
    std::string name = fs::temp_directory_path() / "mpuvdb-test-XXXXXX";
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder " + name);
    mPath = name;
}

TemporaryFolder::~TemporaryFolder()
{
    std::error_code ignored;
    fs::remove_all(mPath, ignored);
}

std::vector<std::string> TemporaryFolder::names() const
{
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(mPath))
        names.push_back(fs::relative(entry.path(), mPath).string());
    std::sort(names.begin(), names.end());
    return names;
}

Process::Process(const TemporaryFolder& folder, const std::vector<std::string>& words,
                 const std::string& input)
{
    writeFile(mLogs / "in", input);
    std::vector<std::string> arguments = words;
    if (arguments.front() == "mpuvdb") arguments.front() = MPUVDB_COMMAND;
    std::vector<char*> pointers;
    for (std::string& argument : arguments) pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    const std::string in = mLogs / "in", out = mLogs / "out", err = mLogs / "err";
    mPid = fork();
    if (mPid < 0) throw std::runtime_error("cannot fork");
    if (mPid > 0) return;
    const bool ready = dup2(open(in.c_str(), O_RDONLY), 0) == 0 &&
                       dup2(open(out.c_str(), O_WRONLY | O_CREAT, 0600), 1) == 1 &&
                       dup2(open(err.c_str(), O_WRONLY | O_CREAT, 0600), 2) == 2 &&
                       chdir(folder.path().c_str()) == 0;
    // What the command makes of Ctrl-C must not depend on how the tests were started.
    std::signal(SIGINT, SIG_DFL);
    std::signal(SIGHUP, SIG_DFL);
    if (ready) execvp(pointers[0], pointers.data());
    _exit(127);
}

Process::~Process()
{
    if (mPid < 0) return;
    kill(mPid, SIGKILL);
    waitpid(mPid, nullptr, 0);
}

void Process::signal(int number) const
{
    if (mPid > 0) kill(mPid, number);
}

bool Process::running()
{
    int status = 0;
    if (mPid > 0 && waitpid(mPid, &status, WNOHANG) == mPid) reap(status);
    return mPid > 0;
}

std::string Process::said() const
{
    return readFile(mLogs / "err");
}

Ended Process::wait()
{
    int status = 0;
    if (mPid > 0 && waitpid(mPid, &status, 0) == mPid) reap(status);
    return mEnded;
}

void Process::reap(int status)
{
    mPid = -1;
    mEnded.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    mEnded.out = readFile(mLogs / "out");
    mEnded.err = readFile(mLogs / "err");
}

Ended run(const TemporaryFolder& folder, const std::vector<std::string>& words,
          const std::string& input)
{
    return Process(folder, words, input).wait();
}

std::string readFile(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

void writeFile(const fs::path& file, const std::string& bytes)
{
    std::ofstream(file, std::ios::binary) << bytes;
}

} // namespace mpuvdb::test
