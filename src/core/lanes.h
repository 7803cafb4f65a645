// SIMD vectors: loads, magnitudes, and the results of eight comparisons as bits.
#pragma once
#include <cstdint>
#include <cstring>

namespace mpuvdb
{

/// Load a vector from the consecutive numbers at @a from.
template <typename Vector, typename Number>
[[gnu::always_inline]] inline Vector lanesAt(const Number* from)
{
    Vector v;
    std::memcpy(&v, from, sizeof v);
    return v;
}

template <typename Vector>
[[gnu::always_inline]] inline Vector magnitude(const Vector& v)
{
    return v < 0 ? -v : v;
}

/// Bit n is set where lane n of @a flags, eight numbers that are 0 or -1 each, is -1. The same by
/// every instruction set.
template <typename Flags>
[[gnu::always_inline]] inline std::uint64_t bitsOf(const Flags& flags)
{
    using Words = std::uint32_t __attribute__((vector_size(32)));
    using Pairs = std::uint64_t __attribute__((vector_size(16)));
    static_assert(sizeof(Flags) == sizeof(Words));
    Words bits;
    std::memcpy(&bits, &flags, sizeof bits);
    bits &= Words{1, 2, 4, 8, 16, 32, 64, 128};
    Pairs halves[2];
    std::memcpy(halves, &bits, sizeof halves);
    const Pairs pairs = halves[0] | halves[1];
    const std::uint64_t all = pairs[0] | pairs[1];
    return (all | all >> 32) & 0xff;
}

} // namespace mpuvdb
