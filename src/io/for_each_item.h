// Loops over the items of a file that is written.
#pragma once
#include "files/output_stream.h"
#include <mpuvdb/interrupter.h>

#include <cstddef>

namespace mpuvdb
{

/// Calls f(i) for i < count, and reports progress.
template <class F>
void forEachItem(std::size_t count, OutputBuffer& out, Interrupter& progress, const F& f)
{
    constexpr std::size_t kItemsAtOnce = 1 << 12; // between two reports [free: latency]
    for (std::size_t i = 0; i < count; ++i) {
        f(i);
        if (i % kItemsAtOnce == kItemsAtOnce - 1) {
            out.flushIfFull();
            progress.advance(kItemsAtOnce);
        }
    }
}

} // namespace mpuvdb
