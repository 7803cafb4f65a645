// The default memory limit.
#pragma once
#include <cstdint>

namespace mpuvdb
{

/// Memory that work may use by default, bytes: nine tenths of the smaller of physical memory and
/// the control group's limit.
std::uint64_t defaultMemoryLimit();

} // namespace mpuvdb
