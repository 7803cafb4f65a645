// Disjoint sets of indices.
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace mpuvdb
{

/// The lowest member of a set is its root.
class UnionFind
{
public:
    explicit UnionFind(std::size_t count) : mParents(count)
    {
        std::iota(mParents.begin(), mParents.end(), 0u);
    }

    std::uint32_t find(std::uint32_t i)
    {
        while (mParents[i] != i) {
            mParents[i] = mParents[mParents[i]];
            i = mParents[i];
        }
        return i;
    }

    void join(std::uint32_t a, std::uint32_t b)
    {
        a = find(a);
        b = find(b);
        if (a != b) mParents[std::max(a, b)] = std::min(a, b);
    }

private:
    std::vector<std::uint32_t> mParents;
};

} // namespace mpuvdb
