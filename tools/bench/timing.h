// What the benchmarks share: time of a piece of work over several runs, and grids to work on.
#pragma once

#include <openvdb/openvdb.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <string>
#include <vector>

namespace bench
{

/// CPU seconds of this process, all threads.
inline double cpuSeconds()
{
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

/// Time of the runs of one piece of work, in seconds.
struct Times {
    std::vector<double> wall, cpu;

    template <typename Work>
    void add(const Work& work)
    {
        const auto start = std::chrono::steady_clock::now();
        const double cpuStart = cpuSeconds();
        work();
        cpu.push_back(cpuSeconds() - cpuStart);
        wall.push_back(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
};

inline double least(const std::vector<double>& values)
{
    return *std::min_element(values.begin(), values.end());
}

inline double median(std::vector<double> values)
{
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/// First float grid of a file.
inline openvdb::FloatGrid::Ptr readGrid(const std::string& path)
{
    openvdb::io::File file(path);
    file.open();
    const auto grids = file.getGrids();
    for (const auto& grid : *grids)
        if (auto floats = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) return floats;
    throw std::runtime_error(path + ": has no float grid");
}

} // namespace bench
