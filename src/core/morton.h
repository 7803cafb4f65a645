// Morton order of cells: near in space, near in order.
#pragma once
#include <cstdint>

namespace mpuvdb
{

/// Spread the low 21 bits: bit b goes to bit 3b.
inline std::uint64_t spreadBits(std::uint64_t v)
{
    v &= 0x1fffff;
    v = (v | v << 32) & 0x1f00000000ffff;
    v = (v | v << 16) & 0x1f0000ff0000ff;
    v = (v | v << 8) & 0x100f00f00f00f00f;
    v = (v | v << 4) & 0x10c30c30c30c30c3;
    return (v | v << 2) & 0x1249249249249249;
}

/// Morton key of the cell (i, j, k), from the low 21 bits of each.
inline std::uint64_t mortonKey(std::uint64_t i, std::uint64_t j, std::uint64_t k)
{
    return spreadBits(i) | spreadBits(j) << 1 | spreadBits(k) << 2;
}

} // namespace mpuvdb
