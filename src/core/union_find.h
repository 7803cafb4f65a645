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
    /// @param count  sets of one member each; below 2^32.
    explicit UnionFind(std::size_t count) : mParents(count)
    {
        std::iota(mParents.begin(), mParents.end(), 0u);
    }

    std::uint32_t find(std::uint32_t i)
    {
        while (mParents[i] != i) i = mParents[i] = mParents[mParents[i]];
        return i;
    }

    /// Join the sets of a and b. @return whether they were two.
    bool join(std::uint32_t a, std::uint32_t b)
    {
        a = find(a);
        b = find(b);
        mParents[std::max(a, b)] = std::min(a, b);
        return a != b;
    }

    /// The root of each index, valid until the next join().
    const std::vector<std::uint32_t>& roots()
    {
        // Parents come before their children.
        for (std::uint32_t& parent : mParents) parent = mParents[parent];
        return mParents;
    }

private:
    std::vector<std::uint32_t> mParents;
};

} // namespace mpuvdb
