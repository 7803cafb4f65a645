// Memory given back.
#pragma once
#include <vector>

namespace mpuvdb
{

/// Empty @a v and give its memory back. v = {} does not: that assigns an initializer list of no
/// element, and keeps the capacity.
template <typename T>
void release(std::vector<T>& v)
{
    std::vector<T>().swap(v);
}

} // namespace mpuvdb
