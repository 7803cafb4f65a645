// The command's allocation: of large arrays where memory has no room for them in scratch files.
#include "scratch_memory.h"

#include <cstdlib>
#include <new>

void* operator new(std::size_t bytes)
{
    if (void* const data = mpuvdb::command::allocateInScratch(bytes)) return data;
    for (;;) {
        if (void* const data = std::malloc(bytes > 0 ? bytes : 1)) return data;
        const std::new_handler handler = std::get_new_handler();
        if (!handler) throw std::bad_alloc();
        handler();
    }
}

void operator delete(void* data) noexcept
{
    if (mpuvdb::command::isInScratch(data))
        mpuvdb::command::releaseInScratch(data);
    else
        std::free(data);
}

void operator delete(void* data, std::size_t /*bytes*/) noexcept
{
    operator delete(data);
}
