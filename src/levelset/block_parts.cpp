#include "block_parts.h"

namespace mpuvdb
{
namespace
{

constexpr std::uint64_t kFirstZ = 0x0101010101010101ull, kLastZ = kFirstZ << 7;

/// Grow @a seed through face neighbours inside @a mask until it fills its component.
SignWords fill(SignWords seed, const SignWords& mask)
{
    for (bool grew = true; grew;) {
        grew = false;
        for (std::size_t x = 0; x < kBlockDim; ++x) {
            const std::uint64_t s = seed[x];
            std::uint64_t g = s | s << 8 | s >> 8 | (s << 1 & ~kFirstZ) | (s >> 1 & ~kLastZ);
            if (x > 0) g |= seed[x - 1];
            if (x + 1 < kBlockDim) g |= seed[x + 1];
            g &= mask[x];
            grew |= g != s;
            seed[x] = g;
        }
    }
    return seed;
}

} // namespace

std::vector<SignWords> connectedParts(const SignWords& voxels)
{
    std::vector<SignWords> parts;
    SignWords rest = voxels;
    for (std::size_t first = 0; first < kBlockDim;) {
        if (!rest[first]) {
            ++first;
            continue;
        }
        SignWords seed{};
        seed[first] = rest[first] & (~rest[first] + 1);
        parts.push_back(fill(seed, rest));
        for (std::size_t x = 0; x < kBlockDim; ++x) rest[x] &= ~parts.back()[x];
    }
    return parts;
}

bool meet(const SignWords& a, const SignWords& b, int axis)
{
    if (axis == 0) return (a[kBlockDim - 1] & b[0]) != 0;
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        if (axis == 1 ? ((a[x] >> 56) & (b[x] & 0xff)) != 0 : ((a[x] >> 7) & b[x] & kFirstZ) != 0)
            return true;
    }
    return false;
}

bool reachesFace(const SignWords& a, int axis, bool upper)
{
    if (axis == 0) return a[upper ? kBlockDim - 1 : 0] != 0;
    const std::uint64_t mask =
        axis == 1 ? (upper ? 0xffull << 56 : 0xffull) : (upper ? kLastZ : kFirstZ);
    for (const std::uint64_t w : a)
        if (w & mask) return true;
    return false;
}

std::uint64_t countVoxels(const SignWords& words)
{
    std::uint64_t count = 0;
    for (const std::uint64_t w : words) count += std::uint64_t(__builtin_popcountll(w));
    return count;
}

} // namespace mpuvdb
