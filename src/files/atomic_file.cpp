// Output that appears whole or not at all: a temporary file beside the target, flushed and renamed.
#include "atomic_file.h"
#include "system_message.h"
#include <mpuvdb/error.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// A path of fixed size behind a lock-free state, for signal handlers to read.
struct Slot {
    enum State : int { Free, Filling, Live, Removing, Removed };
    std::atomic<int> state{Free};
    char path[PATH_MAX];
};
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler reads it");

/// Most files written at once. [free: a table's size]
constexpr int kMaxFiles = 64;
Slot gSlots[kMaxFiles];
std::atomic<unsigned> gFiles{0};

Slot& claimSlot(const fs::path& file)
{
    for (Slot& slot : gSlots) {
        int expected = Slot::Free;
        if (slot.state.compare_exchange_strong(expected, Slot::Filling)) return slot;
    }
    throw IoError(
        fmt::format("{}: {} files are being written at once already. Write fewer at a time",
                    file.string(), kMaxFiles));
}

/// A temporary file: listed for removeTemporaryFiles() before it exists, removed unless renamed.
class TemporaryFile
{
public:
    explicit TemporaryFile(const fs::path& target) : mSlot(claimSlot(target))
    {
        try {
            create(target);
        } catch (...) {
            release();
            throw;
        }
    }
    TemporaryFile(const TemporaryFile&) = delete;
    TemporaryFile& operator=(const TemporaryFile&) = delete;
    ~TemporaryFile()
    {
        if (!mRenamed) ::unlink(mPath.c_str());
        release();
    }

    const fs::path& path() const { return mPath; }

    void flush() const
    {
        const int fd = ::open(mPath.c_str(), O_RDONLY | O_CLOEXEC);
        const bool flushed = fd >= 0 && ::fsync(fd) == 0;
        const int error = errno;
        if (fd >= 0) ::close(fd);
        if (!flushed)
            throw IoError(fmt::format("{}: cannot flush to disk: {}. Free some space, or write to "
                                      "another disk",
                                      mPath.string(), systemMessage(error)),
                          error);
    }

    void renameTo(const fs::path& target)
    {
        if (std::rename(mPath.c_str(), target.c_str()) != 0)
            throw IoError(
                fmt::format("{}: cannot put the new file in place: {}. Choose another name",
                            target.string(), systemMessage(errno)),
                errno);
        mRenamed = true;
    }

private:
    void create(const fs::path& target)
    {
        // Cut so that the additions fit within the limit of 255 bytes.
        const std::string stem = target.filename().string().substr(0, 200);
        for (;;) {
            mPath = target.parent_path() /
                    fmt::format(".{}.{}-{}.tmp", stem, ::getpid(), gFiles.fetch_add(1));
            if (mPath.native().size() >= sizeof mSlot.path) fail(target, ENAMETOOLONG);
            std::memcpy(mSlot.path, mPath.c_str(), mPath.native().size() + 1);
            mSlot.state.store(Slot::Live);
            const int fd = ::open(mPath.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
            const int error = errno;
            if (fd >= 0) {
                ::close(fd);
                return;
            }
            mSlot.state.store(Slot::Filling);
            if (error != EEXIST) fail(target, error);
        }
    }

    [[noreturn]] static void fail(const fs::path& target, int error)
    {
        const fs::path folder = target.parent_path().empty() ? "." : target.parent_path();
        std::error_code ignored;
        if (!fs::is_directory(folder, ignored))
            throw IoError(fmt::format("{}: there is no folder {}. Create it, or write elsewhere",
                                      target.string(), folder.string()));
        throw IoError(fmt::format("{}: cannot create a file in {}: {}. Write elsewhere",
                                  target.string(), folder.string(), systemMessage(error)),
                      error);
    }

    /// Free the slot, after a removal that may be under way in a signal handler.
    void release()
    {
        for (;;) {
            int state = mSlot.state.load();
            if (state != Slot::Removing && mSlot.state.compare_exchange_strong(state, Slot::Free))
                return;
            std::this_thread::yield();
        }
    }

    Slot& mSlot;
    fs::path mPath;
    bool mRenamed = false;
};

/// The system's error number for writing more to @a file; 0 if that can be done.
int errorOfMore(const fs::path& file)
{
    /// Bytes to write: more than streams hold back, so that a disk that was full for them is for
    /// these. [free: the same answer]
    static const std::array<char, 1 << 16> more{};
    const int fd = ::open(file.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
    if (fd < 0) return 0; // it is not there any more
    errno = ENOSPC;       // a write of a part sets none
    const bool written = ::write(fd, more.data(), more.size()) == ::ssize_t(more.size());
    int error = written ? 0 : errno;
    if (written && ::fsync(fd) != 0) error = errno;
    ::close(fd);
    return error;
}

/// The file that a name stands for: symbolic links are followed.
fs::path resolveLinks(fs::path file)
{
    constexpr int kMaxLinks = 40; ///< links in a row [derived: as Linux]
    const fs::path given = file;
    std::error_code error;
    for (int i = 0; i < kMaxLinks; ++i) {
        if (!fs::is_symlink(fs::symlink_status(file, error))) return file;
        const fs::path next = fs::read_symlink(file, error);
        if (error) break;
        file = next.is_absolute() ? next : file.parent_path() / next;
    }
    throw IoError(
        fmt::format("{}: cannot follow this symbolic link. Name the file itself", given.string()));
}

void refuseUnwritable(const fs::path& target)
{
    if (target.filename().empty())
        throw IoError(fmt::format("'{}': names no file. Add a file name", target.string()));
    std::error_code error;
    const fs::file_status status = fs::status(target, error);
    if (fs::is_directory(status))
        throw IoError(fmt::format("{}: is a folder. Name a file in it", target.string()));
    if (!fs::exists(status)) return;
    // Renaming onto a device would replace the device.
    if (!fs::is_regular_file(status))
        throw IoError(fmt::format("{}: is not a regular file, and cannot be replaced. Name a file",
                                  target.string()));
    if (::access(target.c_str(), W_OK) != 0)
        throw IoError(fmt::format("{}: is write-protected: {}. Change its permissions or choose "
                                  "another name",
                                  target.string(), systemMessage(errno)));
}

/// Make a rename outlast a power cut. Errors are ignored: the file is in place, and some file
/// systems cannot flush a folder.
void flushFolder(const fs::path& target)
{
    const fs::path folder = target.parent_path().empty() ? "." : target.parent_path();
    const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return;
    ::fsync(fd);
    ::close(fd);
}

} // namespace

void writeAtomically(const fs::path& file, const std::function<void(const fs::path&)>& write)
{
    const fs::path target = resolveLinks(file);
    refuseUnwritable(target);
    TemporaryFile temporary(target);
    try {
        write(temporary.path());
    } catch (const Interrupted&) {
        throw;
    } catch (const std::exception&) {
        // Streams and libraries do not say why they failed. A full disk can be told by writing
        // more.
        const int error = errorOfMore(temporary.path());
        if (error == 0) throw;
        throw IoError(fmt::format("{}: cannot be written: {}. Free some space, or write to another "
                                  "disk",
                                  target.string(), systemMessage(error)),
                      error);
    }
    temporary.flush();
    temporary.renameTo(target);
    flushFolder(target);
}

void removeTemporaryFiles() noexcept
{
    const int error = errno;
    for (Slot& slot : gSlots) {
        int expected = Slot::Live;
        if (!slot.state.compare_exchange_strong(expected, Slot::Removing)) continue;
        ::unlink(slot.path);
        slot.state.store(Slot::Removed);
    }
    errno = error;
}

} // namespace mpuvdb
