#include "standard_output.h"

#include <mpuvdb/error.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace mpuvdb::command
{
namespace
{

/// A folder with one file, in plain memory, as signal handlers remove it.
struct Scratch {
    std::array<char, PATH_MAX> folder{}, file{};
    std::atomic<bool> exists{false};

    void remove() noexcept
    {
        if (!exists.exchange(false)) return;
        unlink(file.data());
        rmdir(folder.data());
    }
};

/// One for reading and one for writing.
std::array<Scratch, 2> theScratches;

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
        : mScratch(theScratches[theScratches[0].exists])
    {
        const std::string name = std::filesystem::temp_directory_path() / "mpuvdb-XXXXXX";
        if (name.size() + extension.size() + 8 > mScratch.folder.size())
            throw IoError(fmt::format("{}: the path of the temporary folder is too long", name));
        mScratch.folder.fill(0);
        name.copy(mScratch.folder.data(), mScratch.folder.size() - 1);
        if (!mkdtemp(mScratch.folder.data())) {
            throw IoError(fmt::format("{}: cannot make a temporary folder: {}. Set TMPDIR to a "
                                      "folder that is writable",
                                      name, std::strerror(errno)));
        }
        mScratch.file.fill(0);
        fmt::format("{}/data{}", mScratch.folder.data(), extension)
            .copy(mScratch.file.data(), mScratch.file.size() - 1);
        mScratch.exists = true;
    }
    ~ScratchFolder() { mScratch.remove(); }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;

    std::filesystem::path file() const { return mScratch.file.data(); }

private:
    Scratch& mScratch;
};

/// @a message with "standard input" for the name of the temporary file.
std::string aboutStandardInput(std::string message, const std::string& file)
{
    for (std::size_t at; (at = message.find(file)) != std::string::npos;)
        message.replace(at, file.size(), "standard input");
    return message;
}

void keepStandardInput(const std::filesystem::path& file)
{
    std::ofstream out(file, std::ios::binary);
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
                                  file.string()));
}

} // namespace

void removeScratchFolders() noexcept
{
    for (Scratch& scratch : theScratches) scratch.remove();
}

void keepStandardFiles()
{
    for (const int file : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
        if (fcntl(file, F_GETFD) < 0) {
            // In the wrong direction, so that its use fails.
            const int way = file == STDIN_FILENO ? O_WRONLY : O_RDONLY;
            [[maybe_unused]] const int taken = open("/dev/null", way);
        }
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
    keepStandardInput(scratch.file());
    const auto named = [&](const Error& e) {
        return aboutStandardInput(e.what(), scratch.file().string());
    };
    try {
        read(scratch.file());
    } catch (const InputError& e) {
        throw InputError(named(e));
    } catch (const LimitError& e) {
        throw LimitError(named(e));
    }
}

} // namespace mpuvdb::command
