// The most memory that the process has had.
#pragma once
#include <cstdint>
#include <fstream>
#include <string>
#include <sys/resource.h>

namespace mpuvdb
{

/// The most resident memory of the process so far, bytes. Of /proc where there is one: what
/// getrusage() gives begins with the memory of the process that started this one.
inline std::uint64_t peakResidentBytes()
{
    std::ifstream status("/proc/self/status");
    for (std::string name; status >> name;) {
        std::uint64_t kilobytes = 0;
        if (name == "VmHWM:" && status >> kilobytes) return 1024 * kilobytes;
    }
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return std::uint64_t(usage.ru_maxrss) * 1024;
}

} // namespace mpuvdb
