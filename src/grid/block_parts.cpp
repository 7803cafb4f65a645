#include "block_parts.h"

namespace mpuvdb
{
namespace
{

/// The face-connected component of @a mask that holds its first voxel.
SignWords firstPart(const SignWords& mask)
{
    std::size_t first = 0;
    while (!mask[first]) ++first;
    SignWords part{};
    part[first] = mask[first] & (~mask[first] + 1);
    for (bool grew = true; grew;) {
        grew = false;
        for (std::size_t x = 0; x < kBlockDim; ++x) {
            std::uint64_t grown = part[x];
            if (x > 0) grown |= part[x - 1];
            if (x + 1 < kBlockDim) grown |= part[x + 1];
            grown &= mask[x];
            if (grown == part[x] && x != first) continue;
            for (std::uint64_t before = 0; before != grown;) { // to the end of the slab
                before = grown;
                grown |= (grown << 8 | grown >> 8) & mask[x];
                grown |= ((grown << 1 & ~kFirstZ) | (grown >> 1 & ~kLastZ)) & mask[x];
            }
            grew |= grown != part[x];
            part[x] = grown;
        }
    }
    return part;
}

} // namespace

void appendConnectedParts(const SignWords& voxels, std::vector<SignWords>& parts)
{
    SignWords rest = voxels;
    const auto isLeft = [&] {
        std::uint64_t any = 0;
        for (const std::uint64_t word : rest) any |= word;
        return any != 0;
    };
    while (isLeft()) {
        parts.push_back(firstPart(rest));
        for (std::size_t x = 0; x < kBlockDim; ++x) rest[x] &= ~parts.back()[x];
    }
}

std::vector<SignWords> connectedParts(const SignWords& voxels)
{
    std::vector<SignWords> parts;
    appendConnectedParts(voxels, parts);
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
