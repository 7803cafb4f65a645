#include <mpuvdb/memory.h>

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <unistd.h>

namespace mpuvdb
{
namespace
{

/// Bytes that stand for no limit. [derived: the type's largest]
constexpr std::uint64_t kNoLimit = std::numeric_limits<std::uint64_t>::max();

/// The number in @a file; "max", or no such file, is no limit.
std::uint64_t limitIn(const std::filesystem::path& file)
{
    std::uint64_t limit = 0;
    return std::ifstream(file) >> limit ? limit : kNoLimit;
}

/// The tightest limit of the control groups around this process (version 2, then version 1).
std::uint64_t controlGroupLimit()
{
    namespace fs = std::filesystem;
    const fs::path root = "/sys/fs/cgroup";
    std::uint64_t limit = limitIn(root / "memory/memory.limit_in_bytes");
    std::ifstream groups("/proc/self/cgroup");
    for (std::string line; std::getline(groups, line);) {
        if (line.rfind("0::/", 0) != 0) continue;
        for (fs::path group = line.substr(4);; group = group.parent_path()) {
            limit = std::min(limit, limitIn(root / group / "memory.max"));
            if (group.empty()) break;
        }
    }
    return limit;
}

} // namespace

std::uint64_t defaultMemoryLimit()
{
    const std::uint64_t physical =
        std::uint64_t(sysconf(_SC_PHYS_PAGES)) * std::uint64_t(sysconf(_SC_PAGE_SIZE));
    return std::min(physical, controlGroupLimit()) / 10 * 9;
}

std::string sizeText(std::uint64_t bytes)
{
    const char* const units[] = {"B", "KB", "MB", "GB", "TB"};
    double number = double(bytes);
    int unit = 0;
    for (; number >= 1024 && unit < 4; ++unit) number /= 1024;
    return fmt::format(unit == 0 || number >= 100 ? "{:.0f} {}" : "{:.1f} {}", number, units[unit]);
}

} // namespace mpuvdb
