#include "standard_output.h"

#include <mpuvdb/error.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <fstream>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace mpuvdb::command
{
namespace
{

// Plain memory, because a signal handler may have to remove what is named here.
std::array<char, PATH_MAX> theFolder{};
std::array<char, PATH_MAX> theFile{};
std::atomic<bool> theFolderExists{false};

void printBytes(std::string_view bytes)
{
    while (!bytes.empty()) {
        const ssize_t n = ::write(STDOUT_FILENO, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            throw IoError(fmt::format("cannot write to standard output: {}. Is the reader still "
                                      "there, and is there room on the disk?",
                                      std::strerror(errno)));
        }
        bytes.remove_prefix(std::size_t(n));
    }
}

class ScratchFolder
{
public:
    explicit ScratchFolder(const std::string& extension)
    {
        const std::string name = std::filesystem::temp_directory_path() / "mpuvdb-XXXXXX";
        if (name.size() + extension.size() + 8 > theFolder.size())
            throw IoError(fmt::format("{}: the path of the temporary folder is too long", name));
        theFolder.fill(0);
        name.copy(theFolder.data(), theFolder.size() - 1);
        if (!mkdtemp(theFolder.data())) {
            throw IoError(fmt::format("{}: cannot make a temporary folder: {}. Set TMPDIR to a "
                                      "folder that is writable",
                                      name, std::strerror(errno)));
        }
        theFile.fill(0);
        fmt::format("{}/data{}", theFolder.data(), extension)
            .copy(theFile.data(), theFile.size() - 1);
        theFolderExists = true;
    }
    ~ScratchFolder() { removeScratchFolder(); }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;

    std::filesystem::path file() const { return theFile.data(); }
};

} // namespace

void removeScratchFolder() noexcept
{
    if (!theFolderExists.exchange(false)) return;
    unlink(theFile.data());
    rmdir(theFolder.data());
}

void printText(const std::string& text)
{
    printBytes(text);
}

void printFile(const std::string& extension,
               const std::function<void(const std::filesystem::path&)>& write)
{
    const ScratchFolder scratch(extension);
    write(scratch.file());
    std::ifstream in(scratch.file(), std::ios::binary);
    std::vector<char> chunk(1 << 20);
    while (in) {
        in.read(chunk.data(), std::streamsize(chunk.size()));
        printBytes({chunk.data(), std::size_t(in.gcount())});
    }
    if (in.bad() || !in.eof())
        throw IoError(fmt::format("{}: cannot be read back", scratch.file().string()));
}

void readFile(const std::string& file, const std::string& extension,
              const std::function<void(const std::filesystem::path&)>& read)
{
    if (file != "-") return read(file);
    const ScratchFolder scratch(extension);
    std::ofstream out(scratch.file(), std::ios::binary);
    std::vector<char> chunk(1 << 20);
    for (;;) {
        const ssize_t n = ::read(STDIN_FILENO, chunk.data(), chunk.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0)
            throw IoError(fmt::format("cannot read standard input: {}. Is something piped into it?",
                                      std::strerror(errno)));
        if (n == 0) break;
        out.write(chunk.data(), n);
    }
    out.close();
    if (!out)
        throw IoError(fmt::format("{}: cannot keep what came from standard input. Set TMPDIR to a "
                                  "folder with more room",
                                  scratch.file().string()));
    read(scratch.file());
}

} // namespace mpuvdb::command
