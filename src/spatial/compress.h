// Selection of points of a batch by marks.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>

namespace mpuvdb
{

/// Elements past the selected ones that compress() may write. [derived: floats of 512 bits]
constexpr std::size_t kCompressSlack = 16;

constexpr std::size_t kPointFloats = 7; ///< arrays of a PointBatch [derived: its members]

/// Copy those of @a n elements of each of @a from whose mark has one of @a bits, in order, to @a
/// to, which has room for @a n and the slack. @return their number. No branch depends on a mark;
/// the same result by every instruction set.
std::size_t compress(const std::array<const float*, kPointFloats>& from, const std::uint32_t* marks,
                     std::size_t n, std::uint32_t bits, const std::array<float*, kPointFloats>& to);

/// compress() for processors that have no instruction for it.
std::size_t compressByIndex(const std::array<const float*, kPointFloats>& from,
                            const std::uint32_t* marks, std::size_t n, std::uint32_t bits,
                            const std::array<float*, kPointFloats>& to);

} // namespace mpuvdb
