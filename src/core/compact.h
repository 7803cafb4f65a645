// Vectors with some of their values.
#pragma once
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Keeps the values i with keep[i] != 0, in order; an empty vector stays empty.
template <class T>
void compactVector(std::vector<T>& values, const std::vector<std::uint8_t>& keep)
{
    if (values.empty()) return;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < keep.size(); ++i)
        if (keep[i]) values[kept++] = values[i];
    values.resize(kept);
}

} // namespace mpuvdb
