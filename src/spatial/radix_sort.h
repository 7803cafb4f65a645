// Sorting by whole numbers.
#pragma once
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace mpuvdb
{

/// Sort @a items by the bits of key(item) from the @a from-th up to before the @a to-th; items that
/// are equal in them keep their order. The least significant digit comes first, and each is taken
/// of equal chunks in parallel. @throws Interrupted.
template <class Item, class Key>
void radixSort(std::vector<Item>& items, int from, int to, Key key, Interrupter& progress)
{
    constexpr int kDigitBits = 11; // [free: a chunk's counts of digits fit the first cache]
    constexpr std::size_t kDigits = std::size_t(1) << kDigitBits; // [derived: of the bits]
    constexpr std::size_t kChunk = std::size_t(1) << 16; // items; [free: the order is the same]
    const std::size_t chunks = (items.size() + kChunk - 1) / kChunk;
    std::vector<Item> other(items.size());
    std::vector<std::array<std::uint32_t, kDigits>> starts(chunks);
    const auto forEachChunk = [&](auto f) {
        tbb::parallel_for(std::size_t(0), chunks, [&](std::size_t chunk) {
            progress.check();
            f(chunk, chunk * kChunk, std::min((chunk + 1) * kChunk, items.size()));
        });
    };
    for (int shift = from; shift < to; shift += kDigitBits) {
        const std::uint64_t mask = (std::uint64_t(1) << std::min(kDigitBits, to - shift)) - 1;
        const auto digit = [&](const Item& item) { return key(item) >> shift & mask; };
        forEachChunk([&](std::size_t chunk, std::size_t begin, std::size_t end) {
            starts[chunk].fill(0);
            for (std::size_t n = begin; n < end; ++n) ++starts[chunk][digit(items[n])];
        });
        std::uint32_t next = 0;
        for (std::size_t d = 0; d < kDigits; ++d)
            for (std::size_t chunk = 0; chunk < chunks; ++chunk)
                next += std::exchange(starts[chunk][d], next);
        forEachChunk([&](std::size_t chunk, std::size_t begin, std::size_t end) {
            for (std::size_t n = begin; n < end; ++n)
                other[starts[chunk][digit(items[n])]++] = items[n];
        });
        items.swap(other);
    }
}

} // namespace mpuvdb
