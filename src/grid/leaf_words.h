// Voxels of a leaf as bits: which are inside, active or within limits, and their neighbors.
#pragma once
#include "block_parts.h"
#include "core/lanes.h"

#include <openvdb/openvdb.h>

namespace mpuvdb
{

using FloatLeaf = openvdb::FloatTree::LeafNodeType;
constexpr int kLastInLeaf =
    int(FloatLeaf::DIM) - 1; ///< last voxel along an axis [derived: the leaf]

/// A direction along an axis.
struct Toward {
    int axis, step; ///< step is 1 or -1

    /// The bits of @a words at the neighbors of the voxels with x-coordinate @a x in this leaf.
    std::uint64_t of(const SignWords& words, int x) const
    {
        const auto n = std::size_t(x);
        if (axis == 0) return hasNeighbor(x) ? words[n + std::size_t(step)] : 0;
        const int shift = axis == 1 ? 8 : 1;
        return step > 0 ? words[n] >> shift : words[n] << shift;
    }
    /// The voxels whose neighbor in that direction lies in this leaf.
    std::uint64_t within(int x) const
    {
        if (axis == 0) return hasNeighbor(x) ? ~std::uint64_t(0) : 0;
        if (axis == 1) return ~(step > 0 ? kLastY : kFirstY);
        return ~(step > 0 ? kLastZ : kFirstZ);
    }

private:
    bool hasNeighbor(int x) const { return x + step >= 0 && x + step <= kLastInLeaf; }
};

/// The directions to the neighbors by a face.
const Toward kTowardFaces[6] = {{0, -1}, {0, 1}, {1, -1}, {1, 1}, {2, -1}, {2, 1}};

/// Values of eight voxels in a row.
using LeafLanes = float __attribute__((vector_size(sizeof(float) * FloatLeaf::DIM)));

/// The voxels whose values satisfy @a f, which takes eight at once.
template <typename F>
SignWords wordsOf(const FloatLeaf& leaf, const F& f)
{
    SignWords words{};
    const float* const values = leaf.buffer().data();
    for (unsigned row = 0; row < FloatLeaf::SIZE / FloatLeaf::DIM; ++row)
        words[row / FloatLeaf::DIM] |=
            std::uint64_t(bitsOf(f(lanesAt<LeafLanes>(values + row * FloatLeaf::DIM))))
            << (row % FloatLeaf::DIM * FloatLeaf::DIM);
    return words;
}

/// The voxels inside.
inline SignWords insideOf(const FloatLeaf& leaf)
{
    return wordsOf(leaf, [](const LeafLanes& v) { return v < 0; });
}

inline SignWords activeOf(const FloatLeaf& leaf)
{
    SignWords words;
    for (std::size_t x = 0; x < words.size(); ++x)
        words[x] = leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
    return words;
}

template <typename F>
void forEachBit(std::uint64_t word, const F& f)
{
    for (; word; word &= word - 1) f(__builtin_ctzll(word));
}

inline int bitsIn(std::uint64_t word)
{
    return __builtin_popcountll(word);
}

} // namespace mpuvdb
