#include "memory_limit.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <fstream>
#include <new>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <sstream>
#include <sys/resource.h>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

/// The process's status in the system under @a name, such as "VmRSS:", bytes; 0 without one.
std::uint64_t statusBytes(const std::string& name)
{
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (line.rfind(name, 0) != 0) continue;
        std::uint64_t kilobytes = 0;
        std::istringstream(line.substr(name.size())) >> kilobytes;
        return kilobytes * 1024;
    }
    return 0;
}

/// The handler of failed allocations: raises the limit by a reserve, as destructors may allocate
/// (those of OpenVDB's trees do), and throws.
void throwWithReserve()
{
    constexpr rlim_t kReserve = 64 << 20;
    rlimit limit{};
    getrlimit(RLIMIT_DATA, &limit);
    limit.rlim_cur =
        limit.rlim_max - limit.rlim_cur > kReserve ? limit.rlim_cur + kReserve : limit.rlim_max;
    setrlimit(RLIMIT_DATA, &limit);
    throw std::bad_alloc();
}

} // namespace

std::uint64_t parseSize(const std::string& text)
{
    double number = 0;
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, number);
    std::string unit(rest, end);
    for (char& c : unit) c = char(std::toupper(static_cast<unsigned char>(c)));
    if (unit.size() > 1 && unit.back() == 'B') unit.pop_back();
    const std::string units = "BKMGT";
    const std::size_t power = unit.empty() ? 0 : units.find(unit);
    const double bytes = power < units.size() ? std::ldexp(number, int(10 * power)) : 0;
    if (error != std::errc() || unit.size() > 1 || !(bytes >= 1 && bytes < 1e18)) {
        throw UsageError(
            fmt::format("'{}' is not a size: write a number and K, M, G or T, such as 4G", text));
    }
    return std::uint64_t(bytes);
}

void limitMemory(std::uint64_t bytes)
{
    rlimit limit{};
    getrlimit(RLIMIT_DATA, &limit);
    limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, dataBytes() + bytes);
    setrlimit(RLIMIT_DATA, &limit);
    std::set_new_handler(throwWithReserve);
}

std::uint64_t dataBytes()
{
    return statusBytes("VmData:");
}

std::uint64_t residentBytes()
{
    return statusBytes("VmRSS:");
}

void reuseFreedMemory()
{
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, 32 << 20); // its most
    mallopt(M_TRIM_THRESHOLD, 128 << 20);
#endif
}

} // namespace mpuvdb::command
