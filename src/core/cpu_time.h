// Processor time.
#pragma once
#include <ctime>

namespace mpuvdb
{

/// Processor time of all threads of the process so far, seconds.
inline double processCpuSeconds()
{
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

} // namespace mpuvdb
