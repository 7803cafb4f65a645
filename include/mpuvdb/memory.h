// The default memory limit.
#pragma once
#include <cstdint>
#include <string>

namespace mpuvdb
{

/// Memory that work may use by default, bytes: nine tenths of the smaller of physical memory and
/// the control group's limit.
std::uint64_t defaultMemoryLimit();

/// A size for people, bytes: "1.5 GB".
std::string sizeText(std::uint64_t bytes);

} // namespace mpuvdb
