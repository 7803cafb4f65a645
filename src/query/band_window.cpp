#include "band_window.h"

#include "core/lanes.h"

#include <algorithm>
#include <cstring>
#include <limits>

namespace mpuvdb
{
namespace
{

using Four = float __attribute__((vector_size(16)));
using Eight = float __attribute__((vector_size(32)));

/// Third difference of neighboring values, voxels, from which on a ridge of the distance may pass:
/// where slopes jump by s, cubic interpolation errs by at most 0.19 s, and a third difference along
/// an axis is at least s / 2 / sqrt(3). [derived: 1.15 / r^2, the largest of a ball of r = 3.4
/// voxels, whose center lies just beyond the default band]
constexpr float kRough = 0.1f;
/// Passes of extrapolation: as many voxels beyond the band are filled. [derived: the cube of 64
/// voxels about a place in the band reaches two voxels farther]
constexpr int kPasses = 6;

/// The weights of four values about a place at @a t between the inner two [Catmull74].
Four weightsAt(float t)
{
    return Four{t * (-0.5f + t * (1 - 0.5f * t)), 1 + t * t * (-2.5f + 1.5f * t),
                t * (0.5f + t * (2 - 1.5f * t)), t * t * (-0.5f + 0.5f * t)};
}

/// The derivatives of weightsAt().
Four slopesAt(float t)
{
    return Four{-0.5f + t * (2 - 1.5f * t), t * (-5 + 4.5f * t), 0.5f + t * (4 - 4.5f * t),
                t * (-1 + 1.5f * t)};
}

/// 1 in the lanes whose bits are set in @a bits, else 0.
[[gnu::always_inline]] inline Eight onesWhere(unsigned bits)
{
    using Words = std::int32_t __attribute__((vector_size(32)));
    const Words lanes = Words{1, 2, 4, 8, 16, 32, 64, 128} & std::int32_t(bits);
    return lanes != 0 ? Eight{1, 1, 1, 1, 1, 1, 1, 1} : Eight{};
}

float sum(const Four& v)
{
    return (v[0] + v[1]) + (v[2] + v[3]);
}

/// Bits b such that @a bits has b and the three after it.
std::uint16_t fourFrom(std::uint16_t bits)
{
    return std::uint16_t(bits & bits >> 1 & bits >> 2 & bits >> 3);
}

} // namespace

BandWindow::BandWindow(const openvdb::FloatTree& tree, double voxelSize)
    : mAccessor(tree), mVoxelSize(float(voxelSize))
{
}

void BandWindow::load(const openvdb::Coord& origin)
{
    mOrigin = origin;
    mKnown = {};
    mTorn = {};
    for (int n = 0; n < 27; ++n) loadLeaf({n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1});
    const Bits known = mKnown;
    extrapolate();
    keepWhole(known);
    dropRough(known);
}

void BandWindow::loadLeaf(const openvdb::Coord& side)
{
    const Leaf* const leaf = mAccessor.probeConstLeaf(
        mOrigin.offsetBy(side[0] * kBlockDim, side[1] * kBlockDim, side[2] * kBlockDim));
    if (!leaf) return;
    const auto first = [](int s) { return s < 0 ? kBlockDim - kBelow : 0; };
    const auto count = [](int s) { return s < 0 ? kBelow : s > 0 ? kAbove : kBlockDim; };
    const auto to = [](int s) { return s < 0 ? 0 : s > 0 ? kBelow + kBlockDim : kBelow; };
    const float* const data = leaf->buffer().data();
    const int z = first(side[2]), length = count(side[2]), atZ = to(side[2]);
    for (int i = 0; i < count(side[0]); ++i) {
        const int x = first(side[0]) + i, atX = to(side[0]) + i;
        const std::uint64_t active = leaf->getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
        for (int j = 0; j < count(side[1]); ++j) {
            const int y = first(side[1]) + j, atY = to(side[1]) + j;
            const float* const from = data + (x * kBlockDim + y) * kBlockDim + z;
            float* const row = &mValues[index(atX, atY, atZ)];
            if (length == kBlockDim)
                std::copy_n(from, kBlockDim, row);
            else
                for (int k = 0; k < length; ++k) row[k] = from[k];
            const auto bits = unsigned(active >> (y * kBlockDim + z) & ((1u << length) - 1));
            mKnown[std::size_t(atX)][std::size_t(atY)] |= std::uint16_t(bits << atZ);
        }
    }
}

void BandWindow::extrapolate()
{
    for (int pass = 0; pass < kPasses; ++pass) {
        const Bits known = mKnown;
        if (!extrapolateRows(known)) return;
    }
}

/// Fills the voxels about the block's cells that have three known ones next to each other on some
/// side: by the mean of the parabolas through those. @return whether there were some.
bool BandWindow::extrapolateRows(const Bits& known)
{
    /// Of the cells' 64 voxels. [derived: a cell's own and those beside it]
    constexpr int kFirst = kBelow - 1, kLast = kBelow + kBlockDim + 1;
    /// Their bits in a row. [derived: from kFirst to kLast]
    constexpr unsigned kNeeded = (2u << kLast) - (1u << kFirst);
    constexpr float kMost = std::numeric_limits<float>::max(); ///< [derived: the type's largest]
    const float limit = kRough * mVoxelSize;
    bool filled = false;
    for (int x = kFirst; x <= kLast; ++x)
        for (int y = kFirst; y <= kLast; ++y) {
            /// A row beside this one, or none.
            const auto row = [&](int i, int j) -> unsigned {
                const bool within = i >= 0 && j >= 0 && i < kEdge && j < kEdge;
                return within ? known[std::size_t(i)][std::size_t(j)] : 0u;
            };
            const unsigned own = row(x, y), missing = ~own & kNeeded;
            if (missing == 0) continue;
            const std::array<unsigned, 6> from = {
                row(x - 1, y) & row(x - 2, y) & row(x - 3, y) & missing,
                row(x + 1, y) & row(x + 2, y) & row(x + 3, y) & missing,
                row(x, y - 1) & row(x, y - 2) & row(x, y - 3) & missing,
                row(x, y + 1) & row(x, y + 2) & row(x, y + 3) & missing,
                own << 1 & own << 2 & own << 3 & missing,
                own >> 1 & own >> 2 & own >> 3 & missing};
            unsigned fillable = 0;
            for (const unsigned bits : from) fillable |= bits;
            if (fillable == 0) continue;
            filled = true;
            mKnown[std::size_t(x)][std::size_t(y)] |= std::uint16_t(fillable);
            for (int half = 0; half < 2; ++half) {
                float* const at = &mValues[index(x, y, 8 * half)];
                Eight total{}, count{}, low = kMost - Eight{}, high = Eight{} - kMost;
                for (std::size_t side = 0; side < from.size(); ++side) {
                    if ((from[side] >> 8 * half & 0xff) == 0) continue;
                    const int step = kSteps[side / 2] * (side % 2 ? 1 : -1);
                    const Eight chosen = onesWhere(from[side] >> 8 * half);
                    total +=
                        chosen * (3 * (lanesAt<Eight>(at + step) - lanesAt<Eight>(at + 2 * step)) +
                                  lanesAt<Eight>(at + 3 * step));
                    count += chosen;
                }
                const Eight kept = lanesAt<Eight>(at);
                const Eight mean = count > 0 ? total / count : kept;
                std::memcpy(at, &mean, sizeof mean);
                mTorn[std::size_t(x)][std::size_t(y)] |=
                    std::uint16_t(bitsOf(high - low > limit) << 8 * half);
            }
        }
    return filled;
}

/// Marks cells with a corner in the band whose 64 voxels are known, or filled.
void BandWindow::keepWhole(const Bits& known)
{
    Bits along{}; // bit z: voxels y .. y + 3 and z .. z + 3 are there
    for (std::size_t x = kBelow - 1; x <= kBelow + kBlockDim + 1; ++x)
        for (std::size_t y = kBelow - 1; y < kBelow - 1 + kBlockDim; ++y) {
            const auto& rows = mKnown[x];
            along[x][y] = fourFrom(rows[y] & rows[y + 1] & rows[y + 2] & rows[y + 3]);
        }
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y) {
            unsigned whole = 0xffff, corner = 0;
            for (std::size_t i = 0; i < 4; ++i) whole &= along[x + kBelow - 1 + i][y + kBelow - 1];
            for (std::size_t i = kBelow; i < kBelow + 2; ++i)
                for (std::size_t j = kBelow; j < kBelow + 2; ++j) corner |= known[x + i][y + j];
            corner |= corner >> 1;
            mSmooth[x][y] = std::uint8_t(whole >> (kBelow - 1) & corner >> kBelow);
        }
}

/// Of the voxels @a from of row (x,y), those with a large third difference of the four values from
/// there along @a axis.
[[gnu::always_inline]] inline unsigned BandWindow::roughBits(int x, int y, int axis,
                                                             unsigned from) const
{
    const int step = kSteps[std::size_t(axis)];
    const float limit = kRough * mVoxelSize;
    unsigned bits = 0;
    for (int half = 0; half < 2; ++half) {
        if ((from >> 8 * half & 0xff) == 0) continue;
        const float* const at = &mValues[index(x, y, 8 * half)];
        const Eight third = lanesAt<Eight>(at + 3 * step) - lanesAt<Eight>(at) +
                            3 * (lanesAt<Eight>(at + step) - lanesAt<Eight>(at + 2 * step));
        bits |= unsigned(bitsOf(magnitude(third) > limit)) << 8 * half;
    }
    return bits & from;
}

/// Unmarks cells with a torn corner, or a large third difference beside or across them along the
/// lines through their corners.
void BandWindow::dropRough(const Bits& known)
{
    /// Corners of the block's cells. [derived: the block's own voxels, and the next]
    constexpr int kFirst = kBelow, kLast = kBelow + kBlockDim;
    Bits rough{}; // bit z of row (x,y): of the cell with this lower corner
    const auto row = [&](int x, int y) -> unsigned {
        return known[std::size_t(x)][std::size_t(y)];
    };
    /// Marks the cells at bits of the rows from (x,y) back to (x - alongX, y - alongY).
    const auto mark = [&](int x, int alongX, int y, int alongY, unsigned bits) {
        for (int i = x; i >= x - alongX; --i)
            for (int j = y; j >= y - alongY; --j)
                rough[std::size_t(i)][std::size_t(j)] |= std::uint16_t(bits);
    };
    for (int x = 0; x <= kLast; ++x)
        for (int y = 0; y <= kLast; ++y) {
            const bool isX = x >= kFirst, isY = y >= kFirst;
            const unsigned torn = mTorn[std::size_t(x)][std::size_t(y)];
            if (torn && isX && isY) mark(x, 1, y, 1, torn | torn >> 1);
            if (row(x, y) == 0) continue;
            if (isX && isY) {
                const unsigned z = roughBits(x, y, 2, fourFrom(std::uint16_t(row(x, y))));
                if (z) mark(x, 1, y, 1, z | z << 1 | z << 2);
            }
            if (isY && x < kLast) {
                const unsigned whole = row(x, y) & row(x + 1, y) & row(x + 2, y) & row(x + 3, y);
                const unsigned across = roughBits(x, y, 0, whole);
                if (across) mark(x + 2, 2, y, 1, across | across >> 1);
            }
            if (isX && y < kLast) {
                const unsigned whole = row(x, y) & row(x, y + 1) & row(x, y + 2) & row(x, y + 3);
                const unsigned across = roughBits(x, y, 1, whole);
                if (across) mark(x, 1, y + 2, 2, across | across >> 1);
            }
        }
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y)
            mSmooth[x][y] &= std::uint8_t(~(rough[x + kBelow][y + kBelow] >> kBelow));
}

float BandWindow::value(const Vec3f& place) const
{
    const int x = int(place[0]), y = int(place[1]), z = int(place[2]);
    const Four alongX = weightsAt(place[0] - float(x)), alongY = weightsAt(place[1] - float(y));
    const float* const first = &mValues[index(x + kBelow - 1, y + kBelow - 1, z + kBelow - 1)];
    Four rows{};
    for (int i = 0; i < 4; ++i) {
        const float* const at = first + i * kEdge * kRow;
        const Four plane =
            (alongY[0] * lanesAt<Four>(at) + alongY[1] * lanesAt<Four>(at + kRow)) +
            (alongY[2] * lanesAt<Four>(at + 2 * kRow) + alongY[3] * lanesAt<Four>(at + 3 * kRow));
        rows += alongX[i] * plane;
    }
    return sum(rows * weightsAt(place[2] - float(z)));
}

float BandWindow::value(const Vec3f& place, Vec3f& gradient) const
{
    const int x = int(place[0]), y = int(place[1]), z = int(place[2]);
    const float s = place[0] - float(x), t = place[1] - float(y), u = place[2] - float(z);
    const Four alongX = weightsAt(s), alongY = weightsAt(t), alongZ = weightsAt(u);
    const Four slopeX = slopesAt(s), slopeY = slopesAt(t);
    const float* const first = &mValues[index(x + kBelow - 1, y + kBelow - 1, z + kBelow - 1)];
    Four rows{}, byX{}, byY{};
    for (int i = 0; i < 4; ++i) {
        Four plane{}, sloped{};
        for (int j = 0; j < 4; ++j) {
            const Four row = lanesAt<Four>(first + (i * kEdge + j) * kRow);
            plane += alongY[j] * row;
            sloped += slopeY[j] * row;
        }
        rows += alongX[i] * plane;
        byX += slopeX[i] * plane;
        byY += alongX[i] * sloped;
    }
    gradient = Vec3f(sum(byX * alongZ), sum(byY * alongZ), sum(rows * slopesAt(u))) / mVoxelSize;
    return sum(rows * alongZ);
}

} // namespace mpuvdb
