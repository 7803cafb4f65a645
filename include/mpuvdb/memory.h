// How much memory there is.
#pragma once
#include <cstdint>
#include <string>

namespace mpuvdb
{

/// What work may take where nobody says: nine tenths of the smaller of physical memory and the
/// control group's limit, bytes.
std::uint64_t defaultMemoryLimit();

/// A size for people, bytes: "1.5 GB".
std::string sizeText(std::uint64_t bytes);

} // namespace mpuvdb
