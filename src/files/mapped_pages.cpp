#include "mapped_pages.h"

#include <map>
#include <mutex>
#include <sys/mman.h>

namespace mpuvdb
{
namespace
{

/// The mappings, by where they begin. It outlives whatever is destroyed at the end of the process.
struct Mappings {
    std::mutex mutex; ///< held while pages go, so that what is mapped there cannot end meanwhile
    std::map<const void*, std::size_t> bytes;
};

Mappings& mappings()
{
    static auto* const all = new Mappings;
    return *all;
}

} // namespace

void keepTrackOfPages(const void* data, std::size_t bytes)
{
    const std::lock_guard lock(mappings().mutex);
    mappings().bytes[data] = bytes;
}

void loseTrackOfPages(const void* data)
{
    const std::lock_guard lock(mappings().mutex);
    mappings().bytes.erase(data);
}

void forgetMappedPages()
{
    const std::lock_guard lock(mappings().mutex);
    for (const auto& [data, bytes] : mappings().bytes)
        ::madvise(const_cast<void*>(data), bytes, MADV_DONTNEED);
}

} // namespace mpuvdb
