// Parallel loops that can be stopped, with the same result for any number of threads.
#pragma once
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstddef>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
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

/// Call f(i, found), which appends to @a found, for i below @a count. @return all that was
/// appended, in the order of i.
template <class T, class F>
std::vector<T> gatherParallel(std::size_t count, std::size_t grain, const Interrupter& progress,
                              F&& f)
{
    std::vector<std::vector<T>> chunks((count + grain - 1) / grain);
    forEachParallel(chunks.size(), 1, progress, [&](std::size_t chunk) {
        const std::size_t end = std::min((chunk + 1) * grain, count);
        for (std::size_t i = chunk * grain; i < end; ++i) f(i, chunks[chunk]);
    });
    std::size_t size = 0;
    for (const std::vector<T>& found : chunks) size += found.size();
    std::vector<T> result;
    result.reserve(size);
    for (const std::vector<T>& found : chunks)
        result.insert(result.end(), found.begin(), found.end());
    return result;
}

} // namespace mpuvdb
