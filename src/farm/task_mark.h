// Who works on a task.
#pragma once
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <unistd.h>

namespace mpuvdb
{

/// A file that says who works on a task, as long as this lives.
class TaskMark
{
public:
    explicit TaskMark(std::filesystem::path file) : mFile(std::move(file))
    {
        std::ofstream(mFile) << thisHost() << ' ' << ::getpid() << '\n';
    }
    /// The host of whom the mark in @a file is; empty without one, and if it was of a process of
    /// this host that is no more.
    static std::string hostOf(const std::filesystem::path& file)
    {
        std::string host;
        pid_t process = 0;
        std::ifstream mark(file);
        if (!(mark >> host >> process)) return {};
        const bool isGone = host == thisHost() && ::kill(process, 0) != 0 && errno == ESRCH;
        return isGone ? std::string() : host;
    }
    static std::string thisHost()
    {
        char name[256] = {};
        ::gethostname(name, sizeof name - 1);
        return name;
    }
    TaskMark(const TaskMark&) = delete;
    TaskMark& operator=(const TaskMark&) = delete;
    ~TaskMark()
    {
        std::error_code ignored;
        std::filesystem::remove(mFile, ignored);
    }

private:
    std::filesystem::path mFile;
};

} // namespace mpuvdb
