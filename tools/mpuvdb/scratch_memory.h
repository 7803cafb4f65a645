// Out of core: arrays that memory has no room for lie in files.
#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <new>
#include <thread>

namespace mpuvdb::command
{

/// @a path, or the nearest folder above it that is there.
std::filesystem::path existingFolder(const std::filesystem::path& path);

/// Thrown where there is no room on the disk, either.
struct ScratchFull : std::bad_alloc {
    const char* what() const noexcept override { return "the disk of the scratch files is full"; }
};

/// While it lives, the process keeps @a maxBytes of memory by the disk: once half of them are
/// taken, large arrays lie in files of a folder, mapped, and the system writes and reads their
/// pages; those of all mapped files are let go of where they fill the rest. The command's own
/// operator new puts them there, as all large arrays are vectors. Files have no name, and go with
/// the array. One object at a time.
class ScratchMemory
{
public:
    /// @param folder  an existing one.
    ScratchMemory(const std::filesystem::path& folder, std::uint64_t maxBytes);
    ScratchMemory(const ScratchMemory&) = delete;
    ScratchMemory& operator=(const ScratchMemory&) = delete;
    ~ScratchMemory();

private:
    void keepLimit(std::uint64_t maxBytes);

    std::thread mKeeper; ///< lets go of pages
};

/// @{ What operator new asks: memory of @a bytes in a file, or null where memory has room for them
/// (@throws ScratchFull); whether memory is such; its release.
void* allocateInScratch(std::size_t bytes);
bool isInScratch(const void* data) noexcept;
void releaseInScratch(void* data) noexcept;
/// @}

} // namespace mpuvdb::command
