// How much memory there is.
#pragma once
#include <cstdint>

namespace mpuvdb
{

/// What work may take where nobody says: nine tenths of the smaller of physical memory and the
/// control group's limit, bytes.
std::uint64_t defaultMemoryLimit();

} // namespace mpuvdb
