// The order of items by keys, such as Morton's.
#pragma once
#include "radix_sort.h"

#include "core/parallel_each.h"

#include <atomic>

namespace mpuvdb
{

/// Sorts the numbers of items by key, then by an order of items, then by number.
/// @tparam Key  the key of item i. @tparam Before  whether item i comes before item j, where their
/// keys are equal.
template <class Key, class Before>
class KeySorter
{
public:
    /// @param bits  of keys that may be set, the lowest ones.
    KeySorter(std::size_t count, int bits, const Key& keyOf, const Before& isBefore,
              Interrupter& progress)
        : mCount(count), mBits(bits), mKeyOf(keyOf), mIsBefore(isBefore), mProgress(progress)
    {
    }

    std::vector<std::uint32_t> sorted() const
    {
        std::vector<std::uint32_t> order(mCount);
        // Mostly a few are equal in the upper bits. Where items crowd it is worse.
        if (!sortByUpperBits(order)) sortByAllBits(order);
        return order;
    }

private:
    /// A key and the number of the item that it belongs to.
    struct KeyedIndex {
        std::uint64_t key;
        std::uint32_t index;
    };
    static constexpr std::size_t kGrain = 1 << 14; // items; [free: the same order]

    /// @return false where too many items are equal in them.
    bool sortByUpperBits(std::vector<std::uint32_t>& order) const
    {
        // [derived: half of a key and a number make one word of 64 bits]
        const int lowBits = std::max(mBits - 32, 0);
        constexpr std::size_t kMost = 1024; // items; [free: the same order]
        std::vector<std::uint64_t> items(mCount);
        forEachParallel(mCount, kGrain, mProgress, [&](std::size_t i) {
            items[i] = mKeyOf(std::uint32_t(i)) >> lowBits << 32 | i;
        });
        const auto all = [](std::uint64_t item) { return item; };
        if (!std::is_sorted(items.begin(), items.end()))
            radixSort(items, 32, 32 + std::min(mBits, 32), all, mProgress);
        return settle(
            items, [](std::uint64_t item) { return item >> 32; },
            [](std::uint64_t item) { return std::uint32_t(item); }, lowBits > 0 ? kMost : mCount,
            order);
    }

    void sortByAllBits(std::vector<std::uint32_t>& order) const
    {
        std::vector<KeyedIndex> items(mCount);
        forEachParallel(mCount, kGrain, mProgress, [&](std::size_t i) {
            items[i] = {mKeyOf(std::uint32_t(i)), std::uint32_t(i)};
        });
        radixSort(
            items, 0, mBits, [](const KeyedIndex& item) { return item.key; }, mProgress);
        settle(
            items, [](const KeyedIndex& item) { return item.key; },
            [](const KeyedIndex& item) { return item.index; }, mCount, order);
    }

    /// Fill @a order with the numbers of @a items that are sorted by @a key, and sort those that
    /// are equal in it. @return false where more than @a most are equal.
    template <class Item, class ItemKey, class Number>
    bool settle(const std::vector<Item>& items, ItemKey key, Number number, std::size_t most,
                std::vector<std::uint32_t>& order) const
    {
        std::atomic<bool> isSettled{true};
        const std::size_t chunks = (mCount + kGrain - 1) / kGrain;
        forEachParallel(chunks, 1, mProgress, [&](std::size_t chunk) {
            std::vector<KeyedIndex> equal;
            const std::size_t chunkEnd = std::min((chunk + 1) * kGrain, mCount);
            std::size_t begin = chunk * kGrain, end = begin;
            // A run belongs to the chunk in which it begins.
            if (begin > 0)
                while (begin < chunkEnd && key(items[begin]) == key(items[begin - 1])) ++begin;
            for (; begin < chunkEnd && isSettled; begin = end) {
                for (end = begin; end < mCount && key(items[end]) == key(items[begin]); ++end)
                    order[end] = number(items[end]);
                if (end - begin > most) isSettled = false;
                if (end - begin > 1 && isSettled) sortRun(order, begin, end, equal);
            }
        });
        return isSettled;
    }

    void sortRun(std::vector<std::uint32_t>& order, std::size_t begin, std::size_t end,
                 std::vector<KeyedIndex>& run) const
    {
        run.clear();
        for (std::size_t n = begin; n < end; ++n) run.push_back({mKeyOf(order[n]), order[n]});
        const auto isBefore = [this](const KeyedIndex& a, const KeyedIndex& b) {
            if (a.key != b.key) return a.key < b.key;
            if (mIsBefore(a.index, b.index)) return true;
            return !mIsBefore(b.index, a.index) && a.index < b.index;
        };
        if (std::is_sorted(run.begin(), run.end(), isBefore)) return;
        std::sort(run.begin(), run.end(), isBefore);
        for (const KeyedIndex& item : run) order[begin++] = item.index;
    }

    const std::size_t mCount;
    const int mBits;
    const Key& mKeyOf;
    const Before& mIsBefore;
    Interrupter& mProgress;
};

/// The numbers of @a count items, below 2^32, in the order that KeySorter says. @throws
/// Interrupted.
template <class Key, class Before>
std::vector<std::uint32_t> orderByKeys(std::size_t count, int bits, const Key& keyOf,
                                       const Before& isBefore, Interrupter& progress)
{
    return KeySorter<Key, Before>(count, bits, keyOf, isBefore, progress).sorted();
}

/// The same of items that stay in their order where keys are equal.
template <class Key>
std::vector<std::uint32_t> orderByKeys(std::size_t count, int bits, const Key& keyOf,
                                       Interrupter& progress)
{
    return orderByKeys(
        count, bits, keyOf, [](std::uint32_t, std::uint32_t) { return false; }, progress);
}

} // namespace mpuvdb
