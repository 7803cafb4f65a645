// Parallel loops that can be stopped, with the same result for any number of threads.
#pragma once
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstddef>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <utility>
#include <vector>

namespace mpuvdb
{

/// Call f(i) for i below @a count. @param grain  calls between two checks for a stop.
/// @throws Interrupted.
template <class F>
void forEachParallel(std::size_t count, std::size_t grain, const Interrupter& progress, F&& f)
{
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, grain), [&](const auto& range) {
        progress.check();
        for (std::size_t i = range.begin(); i < range.end(); ++i) f(i);
    });
}

/// All that is in @a parts, in their order; each is freed once it is copied.
template <class T>
std::vector<T> joined(std::vector<std::vector<T>>&& parts)
{
    if (parts.size() == 1) return std::move(parts.front());
    std::size_t size = 0;
    for (const std::vector<T>& part : parts) size += part.size();
    std::vector<T> result;
    result.reserve(size);
    for (std::vector<T>& part : parts) {
        result.insert(result.end(), part.begin(), part.end());
        std::vector<T>().swap(part);
    }
    return result;
}

/// Call f(i, found), which appends to @a found, for i below @a count. @return all that was
/// appended, in the order of i.
template <class T, class F>
std::vector<T> gatherParallel(std::size_t count, std::size_t grain, const Interrupter& progress,
                              F&& f)
{
    // What some hundred chunks found becomes one array: large ones find room beyond the memory's
    // limit, many small ones do not. [free: 64 cores have eight chunks each]
    constexpr std::size_t kTogether = 512;
    std::vector<std::vector<T>> parts;
    for (std::size_t first = 0; first < count; first += kTogether * grain) {
        const std::size_t here = std::min(count - first, kTogether * grain);
        std::vector<std::vector<T>> chunks((here + grain - 1) / grain);
        forEachParallel(chunks.size(), 1, progress, [&](std::size_t chunk) {
            const std::size_t begin = first + chunk * grain;
            const std::size_t end = std::min(begin + grain, first + here);
            for (std::size_t i = begin; i < end; ++i) f(i, chunks[chunk]);
        });
        parts.push_back(joined(std::move(chunks)));
    }
    return joined(std::move(parts));
}

} // namespace mpuvdb
