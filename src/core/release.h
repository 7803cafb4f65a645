// Release of memory.
#pragma once
#include <vector>

namespace mpuvdb
{

/// Empty @a v and free its memory; v = {} keeps the capacity.
template <typename T>
void release(std::vector<T>& v)
{
    std::vector<T>().swap(v);
}

} // namespace mpuvdb
