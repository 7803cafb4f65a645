// Crossed edges are found by the signs of a leaf's voxels as bits, eight rows to a word.
#include "leaf_crossings.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "grid/block_parts.h"

#include <array>
#include <cstdint>
#include <cstring>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;
using CachedAccess = openvdb::tree::ValueAccessor<const openvdb::FloatTree>;
using openvdb::Coord;

using Lanes = float __attribute__((vector_size(4 * kBlockDim)));
using Words = SignWords;

/// Values of a leaf and of its upper neighbors across x, y and z: null, and one value, for tiles.
struct UpperRim {
    const float* own;
    std::array<const float*, 3> beyond{};
    std::array<float, 3> tile{};
};

/// Inside voxels, zero voxels, and those whose upper neighbor along each axis has the other sign.
struct LeafSigns {
    Words inside{}, zero{};
    std::array<Words, 3> change;
};

MPUVDB_CLONES
LeafSigns signsOf(const UpperRim& values)
{
    LeafSigns signs;
    decltype(Lanes{} < 0) anyZero{};
    for (std::size_t row = 0; row < kBlockDim * kBlockDim; ++row) {
        const Lanes v = lanesAt<Lanes>(values.own + row * kBlockDim);
        signs.inside[row / kBlockDim] |= bitsOf(v < 0) << (row % kBlockDim * kBlockDim);
        anyZero |= v == 0;
    }
    if (bitsOf(anyZero))
        for (std::size_t row = 0; row < kBlockDim * kBlockDim; ++row)
            signs.zero[row / kBlockDim] |= bitsOf(lanesAt<Lanes>(values.own + row * kBlockDim) == 0)
                                           << (row % kBlockDim * kBlockDim);
    // The neighbors' layers that touch this leaf.
    std::array<std::uint64_t, 3> tile;
    for (std::size_t axis = 0; axis < 3; ++axis)
        tile[axis] = values.tile[axis] < 0 ? ~std::uint64_t(0) : 0;
    std::uint64_t layerX = tile[0];
    Words firstY, firstZ;
    firstY.fill(tile[1]);
    firstZ.fill(tile[2] & kFirstZ);
    if (values.beyond[0]) {
        layerX = 0;
        for (std::size_t y = 0; y < kBlockDim; ++y)
            layerX |= bitsOf(lanesAt<Lanes>(values.beyond[0] + y * kBlockDim) < 0)
                      << (y * kBlockDim);
    }
    for (std::size_t x = 0; values.beyond[1] && x < kBlockDim; ++x)
        firstY[x] = bitsOf(lanesAt<Lanes>(values.beyond[1] + x * kBlockDim * kBlockDim) < 0);
    for (std::size_t x = 0; values.beyond[2] && x < kBlockDim; ++x) {
        firstZ[x] = 0;
        for (std::size_t y = 0; y < kBlockDim; ++y)
            firstZ[x] |= std::uint64_t(values.beyond[2][(x * kBlockDim + y) * kBlockDim] < 0)
                         << (y * kBlockDim);
    }
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        const std::uint64_t m = signs.inside[x];
        signs.change[0][x] = m ^ (x + 1 < kBlockDim ? signs.inside[x + 1] : layerX);
        signs.change[1][x] = m ^ (m >> kBlockDim | firstY[x] << (kBlockDim * (kBlockDim - 1)));
        signs.change[2][x] =
            m ^ ((m >> 1 & ~(kFirstZ << (kBlockDim - 1))) | firstZ[x] << (kBlockDim - 1));
    }
    return signs;
}

/// Whether a voxel of value 0 has inside and outside among its 26 neighbors.
bool isOnSurface(const Coord& at, CachedAccess& access)
{
    bool inside = false, outside = false;
    for (int n = 0; n < 27; ++n) {
        const float v = access.getValue(at.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
        inside |= v < 0;
        outside |= v > 0;
    }
    return inside && outside;
}

} // namespace

Crossings crossingsOf(const openvdb::FloatTree& tree, const Leaf& leaf)
{
    CachedAccess access(tree);
    UpperRim values{leaf.buffer().data()};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        Coord at = leaf.origin();
        at[int(axis)] += kBlockDim;
        const Leaf* const next = access.probeConstLeaf(at);
        if (next)
            values.beyond[axis] = next->buffer().data();
        else
            values.tile[axis] = access.getValue(at);
    }
    const LeafSigns signs = signsOf(values);
    Crossings found;
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        std::uint64_t left =
            signs.change[0][x] | signs.change[1][x] | signs.change[2][x] | signs.zero[x];
        left &= leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
        for (; left; left &= left - 1) {
            const int bit = __builtin_ctzll(left), at = int(x) * kBlockDim * kBlockDim + bit;
            const Coord local(int(x), bit / kBlockDim, bit % kBlockDim);
            const float v = values.own[at];
            if (v == 0 && isOnSurface(leaf.origin() + local, access)) found.push_back(toVec(local));
            for (std::size_t axis = 0; axis < 3; ++axis) {
                if (!(signs.change[axis][x] >> bit & 1u)) continue;
                const int stride = kBlockDim * kBlockDim >> (3 * axis);
                const float* const next = values.beyond[axis];
                const float u = local[int(axis)] + 1 < kBlockDim ? values.own[at + stride]
                                : next ? next[at - (kBlockDim - 1) * stride]
                                       : values.tile[axis];
                Vec3f p = toVec(local);
                p[int(axis)] += v / (v - u);
                found.push_back(p);
            }
        }
    }
    found.shrink_to_fit();
    return found;
}

} // namespace mpuvdb
