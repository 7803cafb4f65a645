#include "scratch_memory.h"

#include "files/mapped_pages.h"
#include "memory_limit.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <fcntl.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <map>
#include <mutex>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

/// The least array that lies in a file, bytes. [free: a system has 65530 mappings of a process,
/// which such ones make 128 GB]
constexpr std::size_t kLeastBytes = std::size_t(2) << 20;
/// Addresses for scratch files, bytes; each is used once. [derived: an eighth of what a process of
/// x86-64 has]
constexpr std::size_t kArenaBytes = std::size_t(1) << 44;
/// Multiple of a mapping's address, bytes. [derived: a large page]
constexpr std::size_t kAlignment = std::size_t(2) << 20;
/// Share of the limit that arrays in memory take, and above which pages of mapped files go: the
/// rest is for what is small, and for pages until the next look. [derived: half and half]
constexpr double kInMemory = 0.5, kResident = 0.75;
/// Time between two looks. [derived: two cores touch some 50 MB of cached pages meanwhile]
constexpr std::chrono::milliseconds kLook{5};

/// What operator new has to know.
struct Scratch {
    std::atomic<bool> isOpen{false};
    std::uintptr_t arena = 0;
    std::atomic<std::size_t> arenaBytes{0}; ///< 0: nothing has been put there
    std::atomic<std::size_t> next{0};       ///< of the arena
    std::uint64_t mostInMemory = 0;
    std::string folder;
    std::mutex mutex;
    std::map<const void*, std::size_t> bytes; ///< of arrays
} gScratch;

/// A file without a name, of @a bytes that are set aside on the disk; below 0 where none can be
/// made. @throws ScratchFull.
int makeFile(std::size_t bytes)
{
    std::string name = gScratch.folder + "/scratchXXXXXX";
    const int file = ::mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) return file;
    ::unlink(name.c_str());
    int error = EINTR; // by a signal, which asks to stop
    while (error == EINTR) error = ::posix_fallocate(file, 0, off_t(bytes));
    // A file system that cannot set space aside still has it, mostly.
    if (error == EOPNOTSUPP || error == EINVAL) error = ::ftruncate(file, off_t(bytes)) ? errno : 0;
    if (error == 0) return file;
    ::close(file);
    throw ScratchFull();
}

} // namespace

std::filesystem::path existingFolder(const std::filesystem::path& path)
{
    std::filesystem::path folder = std::filesystem::absolute(path);
    while (!std::filesystem::is_directory(folder)) folder = folder.parent_path();
    return folder;
}

bool isInScratch(const void* data) noexcept
{
    return reinterpret_cast<std::uintptr_t>(data) - gScratch.arena < gScratch.arenaBytes;
}

void* allocateInScratch(std::size_t bytes)
{
    if (bytes < kLeastBytes || !gScratch.isOpen || dataBytes() + bytes <= gScratch.mostInMemory)
        return nullptr;
    const std::size_t from =
        gScratch.next.fetch_add((bytes + kAlignment - 1) / kAlignment * kAlignment);
    if (from + bytes > gScratch.arenaBytes) return nullptr;
    const int file = makeFile(bytes);
    if (file < 0) return nullptr;
    void* const data = ::mmap(reinterpret_cast<void*>(gScratch.arena + from), bytes,
                              PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED, file, 0);
    ::close(file);
    if (data == MAP_FAILED) return nullptr;
    const std::lock_guard lock(gScratch.mutex);
    gScratch.bytes[data] = bytes;
    keepTrackOfPages(data, bytes);
    return data;
}

void releaseInScratch(void* data) noexcept
{
    const std::lock_guard lock(gScratch.mutex);
    const auto array = gScratch.bytes.find(data);
    loseTrackOfPages(data);
    ::mmap(data, array->second, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | MAP_FIXED,
           -1, 0);
    gScratch.bytes.erase(array);
}

ScratchMemory::ScratchMemory(const std::filesystem::path& folder, std::uint64_t maxBytes)
{
    if (gScratch.arenaBytes == 0) {
        void* const arena = ::mmap(nullptr, kArenaBytes, PROT_NONE,
                                   MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (arena == MAP_FAILED) return; // addresses are limited: so is memory
        gScratch.arena = reinterpret_cast<std::uintptr_t>(arena);
        gScratch.arenaBytes = kArenaBytes;
        gScratch.next = kAlignment - gScratch.arena % kAlignment;
    }
    gScratch.folder = folder.string();
    gScratch.mostInMemory = std::uint64_t(kInMemory * double(maxBytes));
    gScratch.isOpen = true;
    mKeeper = std::thread([this, maxBytes] { keepLimit(maxBytes); });
}

ScratchMemory::~ScratchMemory()
{
    gScratch.isOpen = false;
    if (mKeeper.joinable()) mKeeper.join();
}

void ScratchMemory::keepLimit(std::uint64_t maxBytes)
{
    for (; gScratch.isOpen; std::this_thread::sleep_for(kLook)) {
        if (double(residentBytes()) <= kResident * double(maxBytes)) continue;
        forgetMappedPages();
#ifdef __GLIBC__
        // What was freed stays in the heap, or the working set has no room beside it.
        malloc_trim(0);
#endif
    }
}

} // namespace mpuvdb::command
