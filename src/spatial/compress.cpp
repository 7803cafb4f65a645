#include "compress.h"

#include <algorithm>

#if defined(__x86_64__) && defined(__GNUC__)
#define MPUVDB_HAS_COMPRESS
#include <immintrin.h>
#endif

namespace mpuvdb
{
namespace
{

using Sources = std::array<const float*, kPointFloats>;
using Targets = std::array<float*, kPointFloats>;

#ifdef MPUVDB_HAS_COMPRESS

__attribute__((target("avx512f"))) std::size_t compressWide(const Sources& from,
                                                            const std::uint32_t* marks,
                                                            std::size_t n, std::uint32_t bits,
                                                            const Targets& to)
{
    constexpr std::size_t kLanes = kCompressSlack; ///< lanes of a vector [derived: 512 bits]
    const __m512i wanted = _mm512_set1_epi32(int(bits));
    std::size_t count = 0;
    for (std::size_t begin = 0; begin < n; begin += kLanes) {
        const std::size_t left = n - begin;
        const auto inside = __mmask16(left < kLanes ? (1u << left) - 1 : 0xffffu);
        const __m512i mark = _mm512_maskz_loadu_epi32(inside, marks + begin);
        const __mmask16 keep = _mm512_test_epi32_mask(mark, wanted);
        if (keep == 0) continue; // often many in a row: points are in Morton order
        for (std::size_t a = 0; a < kPointFloats; ++a) {
            const __m512 values = _mm512_maskz_loadu_ps(keep, from[a] + begin);
            // Compression to memory is slow on some processors.
            _mm512_storeu_ps(to[a] + count, _mm512_maskz_compress_ps(keep, values));
        }
        count += std::size_t(__builtin_popcount(keep));
    }
    return count;
}

#endif

} // namespace

std::size_t compressByIndex(const Sources& from, const std::uint32_t* marks, std::size_t n,
                            std::uint32_t bits, const Targets& to)
{
    // Chunk by chunk: first the indices, then array by array.
    constexpr std::size_t kChunk = 256; ///< elements at once [free: time]
    std::array<std::uint32_t, kChunk> picked;
    std::size_t count = 0;
    for (std::size_t begin = 0; begin < n; begin += kChunk) {
        const std::size_t size = std::min(kChunk, n - begin);
        std::size_t found = 0;
        for (std::size_t i = 0; i < size; ++i) {
            picked[found] = std::uint32_t(i);
            found += (marks[begin + i] & bits) != 0;
        }
        for (std::size_t a = 0; a < kPointFloats; ++a)
            for (std::size_t k = 0; k < found; ++k) to[a][count + k] = from[a][begin + picked[k]];
        count += found;
    }
    return count;
}

std::size_t compress(const Sources& from, const std::uint32_t* marks, std::size_t n,
                     std::uint32_t bits, const Targets& to)
{
#ifdef MPUVDB_HAS_COMPRESS
    static const bool isWide = __builtin_cpu_supports("avx512f");
    if (isWide) return compressWide(from, marks, n, bits, to);
#endif
    return compressByIndex(from, marks, n, bits, to);
}

} // namespace mpuvdb
