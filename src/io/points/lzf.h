// LZF decompression, as PCD files use it.
#pragma once
#include <cstddef>

namespace mpuvdb
{

/// The largest ratio of decompressed to compressed bytes. [derived: three bytes give at most 264]
constexpr std::size_t kMaxLzfRatio = 88;

/// Decompresses @a packedBytes at @a packed to exactly @a bytes at @a to; reads and writes nothing
/// beyond. @return false if the data are damaged.
bool lzfDecompress(const char* packed, std::size_t packedBytes, char* to, std::size_t bytes);

} // namespace mpuvdb
