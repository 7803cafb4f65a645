// A folder beside the target that is put in its place once all its files are there.
#include "atomic_folder.h"
#include "system_message.h"

#include <mpuvdb/error.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <cstring>
#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// The path of the temporary folder, for signal handlers to read. One folder is written at a time.
char gPath[PATH_MAX];
std::atomic<bool> gIsLive{false};
std::atomic<unsigned> gFolders{0};

/// Entries of folders as the kernel gives them (getdents64(2)).
struct Entry {
    std::uint64_t inode;
    std::int64_t offset;
    std::uint16_t bytes;
    std::uint8_t type;
    char name[1]; ///< and more, up to a null
};

/// Remove the content of the folder that is open as @a folder, by system calls alone: a signal
/// handler may neither allocate nor use opendir().
void removeContent(int folder, int depth) noexcept
{
    constexpr int kDepth = 2; ///< of folders in the folder [derived: what is written has one]
    alignas(Entry) char entries[4096];
    for (;;) {
        const long bytes = ::syscall(SYS_getdents64, folder, entries, sizeof entries);
        if (bytes <= 0) return;
        for (long at = 0; at < bytes;) {
            const auto* const entry = reinterpret_cast<const Entry*>(entries + at);
            at += entry->bytes;
            const char* const name = entry->name;
            if (std::strcmp(name, ".") == 0 || std::strcmp(name, "..") == 0) continue;
            if (::unlinkat(folder, name, 0) == 0 || depth == kDepth) continue;
            const int inner = ::openat(folder, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
            if (inner < 0) continue;
            removeContent(inner, depth + 1);
            ::close(inner);
            ::unlinkat(folder, name, AT_REMOVEDIR);
        }
    }
}

void flush(const fs::path& path)
{
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const bool flushed = descriptor >= 0 && ::fsync(descriptor) == 0;
    const int error = errno;
    if (descriptor >= 0) ::close(descriptor);
    // Some file systems cannot flush a folder.
    if (!flushed && !fs::is_directory(path))
        throw IoError(fmt::format("{}: cannot flush to disk: {}. Free some space, or write to "
                                  "another disk",
                                  path.string(), systemMessage(error)),
                      error);
}

/// A folder that is removed unless it was put in place.
class TemporaryFolder
{
public:
    explicit TemporaryFolder(const fs::path& target)
    {
        const std::string stem = target.filename().string().substr(0, 200);
        do {
            mPath = target.parent_path() /
                    fmt::format(".{}.{}-{}.tmp", stem, ::getpid(), gFolders.fetch_add(1));
            if (mPath.native().size() >= sizeof gPath)
                throw IoError(
                    fmt::format("{}: the name is too long. Choose a shorter one", target.string()));
            errno = ::mkdir(mPath.c_str(), 0777) == 0 ? 0 : errno;
        } while (errno == EEXIST);
        if (errno != 0)
            throw IoError(fmt::format("{}: cannot make a folder in {}: {}. Write elsewhere",
                                      target.string(), target.parent_path().string(),
                                      systemMessage(errno)),
                          errno);
        std::memcpy(gPath, mPath.c_str(), mPath.native().size() + 1);
        gIsLive = true;
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder()
    {
        std::error_code ignored;
        fs::remove_all(mPath, ignored); // or the old folder, which it has changed places with
        gIsLive = false;
    }

    const fs::path& path() const { return mPath; }

    void putAt(const fs::path& target)
    {
        for (const fs::directory_entry& entry : fs::recursive_directory_iterator(mPath))
            flush(entry.path());
        flush(mPath);
        // In one step where the file system can exchange two folders.
        if (std::rename(mPath.c_str(), target.c_str()) != 0 &&
            ::renameat2(AT_FDCWD, mPath.c_str(), AT_FDCWD, target.c_str(), RENAME_EXCHANGE) != 0 &&
            !putAside(target))
            throw IoError(fmt::format("{}: cannot put the new folder in place: {}. Choose another "
                                      "name",
                                      target.string(), systemMessage(errno)),
                          errno);
        flush(target.parent_path());
    }

private:
    /// Move the old folder out of the way first.
    bool putAside(const fs::path& target)
    {
        const fs::path old = mPath.string() + ".old";
        if (std::rename(target.c_str(), old.c_str()) != 0) return false;
        if (std::rename(mPath.c_str(), target.c_str()) != 0) {
            const int error = errno;
            std::rename(old.c_str(), target.c_str());
            errno = error;
            return false;
        }
        mPath = old;
        return true;
    }

    fs::path mPath;
};

} // namespace

void writeFolderAtomically(const fs::path& folder,
                           const std::function<void(const fs::path&)>& mayReplace,
                           const std::function<void(const fs::path&)>& write)
{
    fs::path target = fs::absolute(folder).lexically_normal();
    if (target.filename().empty()) target = target.parent_path(); // of a name that ends in /
    std::error_code ignored;
    if (fs::is_symlink(target, ignored)) target = fs::canonical(target);
    if (fs::exists(target, ignored)) {
        if (!fs::is_directory(target, ignored))
            throw IoError(
                fmt::format("{}: is a file. Choose another name for the folder", target.string()));
        if (!fs::is_empty(target)) mayReplace(target);
    }
    TemporaryFolder temporary(target);
    write(temporary.path());
    temporary.putAt(target);
}

void removeTemporaryFolder() noexcept
{
    const int error = errno;
    if (gIsLive.exchange(false)) {
        const int folder = ::open(gPath, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (folder >= 0) {
            removeContent(folder, 0);
            ::close(folder);
            ::rmdir(gPath);
        }
    }
    errno = error;
}

} // namespace mpuvdb
