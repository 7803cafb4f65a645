// Sorting by whole numbers.
#pragma once
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace mpuvdb
{

/// Sort @a items by the bits of key(item) from the @a from-th up to before the @a to-th; items that
/// are equal in them keep their order. The least significant digit comes first, and each is taken
/// of equal chunks in parallel. @param other  memory, which becomes as large as @a items.
/// @throws Interrupted.
template <class Item, class Key>
void radixSort(std::vector<Item>& items, std::vector<Item>& other, int from, int to, Key key,
               Interrupter& progress)
{
    // A chunk's counts of 2^11 digits fit the first cache. Large arrays may lie in files, where
    // each digit fills a page of up to 2 MB at a time: half a gigabyte of them has to stay in
    // memory. [free: the order is the same]
    constexpr std::size_t kLargeBytes = std::size_t(1) << 28;
    const int digitBits = items.size() * sizeof(Item) < kLargeBytes ? 11 : 8;
    const std::size_t digits = std::size_t(1) << digitBits;
    constexpr std::size_t kChunk = std::size_t(1) << 16; // items; [free: the order is the same]
    const std::size_t chunks = (items.size() + kChunk - 1) / kChunk;
    other.resize(items.size());
    std::vector<std::uint32_t> starts(chunks * digits); // of runs of digits, by chunk
    const auto forEachChunk = [&](auto f) {
        tbb::parallel_for(std::size_t(0), chunks, [&](std::size_t chunk) {
            progress.check();
            f(chunk, chunk * kChunk, std::min((chunk + 1) * kChunk, items.size()));
        });
    };
    for (int shift = from; shift < to; shift += digitBits) {
        const std::uint64_t mask = (std::uint64_t(1) << std::min(digitBits, to - shift)) - 1;
        const auto digit = [&](const Item& item) { return key(item) >> shift & mask; };
        forEachChunk([&](std::size_t chunk, std::size_t begin, std::size_t end) {
            std::uint32_t* const counts = &starts[chunk * digits];
            std::fill_n(counts, digits, 0);
            for (std::size_t n = begin; n < end; ++n) ++counts[digit(items[n])];
        });
        std::uint32_t next = 0;
        for (std::size_t d = 0; d < digits; ++d)
            for (std::size_t chunk = 0; chunk < chunks; ++chunk)
                next += std::exchange(starts[chunk * digits + d], next);
        forEachChunk([&](std::size_t chunk, std::size_t begin, std::size_t end) {
            std::uint32_t* const places = &starts[chunk * digits];
            for (std::size_t n = begin; n < end; ++n) other[places[digit(items[n])]++] = items[n];
        });
        items.swap(other);
    }
}

/// The same with memory of its own.
template <class Item, class Key>
void radixSort(std::vector<Item>& items, int from, int to, Key key, Interrupter& progress)
{
    std::vector<Item> other;
    radixSort(items, other, from, to, key, progress);
}

} // namespace mpuvdb
