// Connected parts of a block's voxels.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

namespace mpuvdb
{

/// Signs (1: inside) of a block's voxels: word x, bit 8 y + z, as in an OpenVDB leaf's mask.
using SignWords = std::array<std::uint64_t, kBlockDim>;

/// Masks of a word's voxels in the first and the last layer across z and across y.
/// [derived: the bits of SignWords]
constexpr std::uint64_t kFirstZ = 0x0101010101010101u, kLastZ = kFirstZ << 7;
constexpr std::uint64_t kFirstY = 0xffu, kLastY = kFirstY << 56;

/// The voxels whose value satisfies @a holds; values in the order of an OpenVDB leaf.
template <class Holds>
SignWords wordsWhere(const float* values, const Holds& holds)
{
    std::uint8_t bytes[kBlockVoxels]; // so that compilers vectorize the loop
    for (int n = 0; n < kBlockVoxels; ++n) bytes[n] = std::uint8_t(holds(values[n]));
    SignWords words{};
    for (std::size_t row = 0; row < std::size_t(kBlockVoxels / 8); ++row) {
        std::uint64_t eight;
        std::memcpy(&eight, bytes + 8 * row, sizeof eight);
        // Byte z, which is 0 or 1, to bit z of the uppermost byte.
        words[row / 8] |= (eight * 0x0102040810204080u >> 56) << 8 * (row % 8);
    }
    return words;
}

/// Bring a block's values closer: all of its rows are then on their way together, not one after the
/// other.
inline void prefetch(const float* values)
{
    constexpr int kTogether = 16; ///< floats of a cache line [free: time]
    for (int n = 0; n < kBlockVoxels; n += kTogether) __builtin_prefetch(values + n);
}

/// The face-connected components of @a voxels, ordered by their first voxels.
std::vector<SignWords> connectedParts(const SignWords& voxels);
void appendConnectedParts(const SignWords& voxels, std::vector<SignWords>& parts);

/// Whether two parts touch across the face between block a and its upper neighbor b on @a axis.
bool meet(const SignWords& a, const SignWords& b, int axis);

/// Whether @a a has voxels at the block's upper (else lower) face across @a axis.
bool reachesFace(const SignWords& a, int axis, bool upper);

std::uint64_t countVoxels(const SignWords& words);

} // namespace mpuvdb
