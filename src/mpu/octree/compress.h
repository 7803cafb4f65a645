// Picks some of the points of a batch.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

namespace mpuvdb
{

/// Elements past those that are picked which compress() may write.
constexpr std::size_t kCompressSlack = 16;

constexpr std::size_t kPointFloats = 7; ///< arrays of a PointBatch

/// Of @a n elements of each of @a from, copy those whose mark has one of @a bits, in their order,
/// to
/// @a to, which has room for @a n and the slack. Returns how many there are. No branch depends on a
/// mark; the same copies by every instruction set.
std::size_t compress(const std::array<const float*, kPointFloats>& from, const std::uint32_t* marks,
                     std::size_t n, std::uint32_t bits, const std::array<float*, kPointFloats>& to);

/// The same where the processor has no instruction for it.
std::size_t compressByIndex(const std::array<const float*, kPointFloats>& from,
                            const std::uint32_t* marks, std::size_t n, std::uint32_t bits,
                            const std::array<float*, kPointFloats>& to);

} // namespace mpuvdb
