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
/// an axis is at least s / 2 / sqrt(3). A parabola errs by no more than its own third difference
/// where one passes after all. [derived: 1.15 / r^2, the largest of a ball of r = 3.4
/// voxels, whose center lies just beyond the default band]
constexpr float kRough = 0.1f;
/// Passes of extrapolation: as many voxels beyond the band are filled. [derived: the cube of 64
/// voxels about a place in the band reaches two voxels farther]
constexpr int kPasses = 6;

/// The weights of four values about a place at @a t between the inner two: cubic [Catmull74], or,
/// where a crease passes on the lower or the upper @a side, of the parabola of the other three.
[[gnu::always_inline]] inline Four weightsAt(float t, int side)
{
    if (side < 0) return Four{0, 0.5f * (1 - t) * (2 - t), t * (2 - t), -0.5f * t * (1 - t)};
    if (side > 0) return Four{-0.5f * t * (1 - t), 1 - t * t, 0.5f * t * (1 + t), 0};
    return Four{t * (-0.5f + t * (1 - 0.5f * t)), 1 + t * t * (-2.5f + 1.5f * t),
                t * (0.5f + t * (2 - 1.5f * t)), t * t * (-0.5f + 0.5f * t)};
}

/// The derivatives of weightsAt().
[[gnu::always_inline]] inline Four slopesAt(float t, int side)
{
    if (side < 0) return Four{0, t - 1.5f, 2 - 2 * t, t - 0.5f};
    if (side > 0) return Four{t - 0.5f, -2 * t, t + 0.5f, 0};
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

/// The third differences of the values from @a at on, @a step floats apart, in eight rows.
[[gnu::always_inline]] inline Eight thirdDifference(const float* at, int step)
{
    return lanesAt<Eight>(at + 3 * step) - lanesAt<Eight>(at) +
           3 * (lanesAt<Eight>(at + step) - lanesAt<Eight>(at + 2 * step));
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
    std::array<Bits, 3> rough{};
    mIsSmooth = !findRough(known, rough);
    extrapolate();
    mSmooth = wholeCells(mKnown);
    const Cells inBand = touchedCells(known), torn = touchedCells(mTorn);
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y)
            mSmooth[x][y] &= std::uint8_t(inBand[x][y] & ~torn[x][y]);
    mUsable = mSmooth;
    if (!mIsSmooth) findSides(rough);
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
/// side: by the mean of the parabolas through those. In a block with creases, where these
/// differ or the third difference from there on is large, one may pass between. @return whether
/// there were some.
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
            const std::array<unsigned, 6> next = {row(x - 4, y) & from[0], row(x + 4, y) & from[1],
                                                  row(x, y - 4) & from[2], row(x, y + 4) & from[3],
                                                  own << 4 & from[4],      own >> 4 & from[5]};
            unsigned fillable = 0;
            for (const unsigned bits : from) fillable |= bits;
            if (fillable == 0) continue;
            filled = true;
            mKnown[std::size_t(x)][std::size_t(y)] |= std::uint16_t(fillable);
            for (int half = 0; half < 2; ++half) {
                float* const at = &mValues[index(x, y, 8 * half)];
                Eight total{}, count{}, low = kMost - Eight{}, high = Eight{} - kMost;
                unsigned torn = 0;
                for (std::size_t side = 0; side < from.size(); ++side) {
                    if ((from[side] >> 8 * half & 0xff) == 0) continue;
                    const int step = kSteps[side / 2] * (side % 2 ? 1 : -1);
                    const Eight chosen = onesWhere(from[side] >> 8 * half);
                    const Eight found =
                        3 * (lanesAt<Eight>(at + step) - lanesAt<Eight>(at + 2 * step)) +
                        lanesAt<Eight>(at + 3 * step);
                    total += chosen * found;
                    count += chosen;
                    if (mIsSmooth) continue;
                    if (const unsigned bits = next[side] >> 8 * half & 0xff)
                        torn |=
                            unsigned(bitsOf(magnitude(thirdDifference(at + step, step)) > limit)) &
                            bits;
                    low = chosen > 0 && found < low ? found : low;
                    high = chosen > 0 && found > high ? found : high;
                }
                const Eight kept = lanesAt<Eight>(at);
                const Eight mean = count > 0 ? total / count : kept;
                std::memcpy(at, &mean, sizeof mean);
                torn |= unsigned(bitsOf(high - low > limit));
                mTorn[std::size_t(x)][std::size_t(y)] |= std::uint16_t(torn << 8 * half);
            }
        }
    return filled;
}

/// The cells whose 64 voxels are all among @a voxels.
BandWindow::Cells BandWindow::wholeCells(const Bits& voxels)
{
    Bits along{}; // bit z: voxels y .. y + 3 and z .. z + 3 are there
    for (std::size_t x = kBelow - 1; x <= kBelow + kBlockDim + 1; ++x)
        for (std::size_t y = kBelow - 1; y < kBelow - 1 + kBlockDim; ++y) {
            const auto& rows = voxels[x];
            along[x][y] = fourFrom(rows[y] & rows[y + 1] & rows[y + 2] & rows[y + 3]);
        }
    Cells cells{};
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y) {
            unsigned whole = 0xffff;
            for (std::size_t i = 0; i < 4; ++i) whole &= along[x + kBelow - 1 + i][y + kBelow - 1];
            cells[x][y] = std::uint8_t(whole >> (kBelow - 1));
        }
    return cells;
}

/// The cells with a corner among @a voxels.
BandWindow::Cells BandWindow::touchedCells(const Bits& voxels)
{
    Cells cells{};
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y) {
            unsigned corners = 0;
            for (std::size_t i = kBelow; i < kBelow + 2; ++i)
                for (std::size_t j = kBelow; j < kBelow + 2; ++j) corners |= voxels[x + i][y + j];
            cells[x][y] = std::uint8_t((corners | corners >> 1) >> kBelow);
        }
    return cells;
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
        bits |= unsigned(bitsOf(magnitude(thirdDifference(at, step)) > limit)) << 8 * half;
    }
    return bits & from;
}

/// Finds large third differences along the lines through the cells' corners. @param rough  by axis,
/// bit z of row (x,y): of the four voxels from there on. @return whether there are some.
bool BandWindow::findRough(const Bits& known, std::array<Bits, 3>& rough) const
{
    /// Corners of the block's cells. [derived: the block's own voxels, and the next]
    constexpr int kFirst = kBelow, kLast = kBelow + kBlockDim;
    const auto row = [&](int x, int y) -> unsigned {
        return known[std::size_t(x)][std::size_t(y)];
    };
    unsigned any = 0;
    const auto find = [&](int x, int y, int axis, unsigned whole) {
        const unsigned bits = roughBits(x, y, axis, whole);
        rough[std::size_t(axis)][std::size_t(x)][std::size_t(y)] = std::uint16_t(bits);
        any |= bits;
    };
    for (int x = 0; x <= kLast; ++x)
        for (int y = 0; y <= kLast; ++y) {
            if (row(x, y) == 0) continue;
            if (y >= kFirst && x < kLast)
                find(x, y, 0, row(x, y) & row(x + 1, y) & row(x + 2, y) & row(x + 3, y));
            if (x >= kFirst && y < kLast)
                find(x, y, 1, row(x, y) & row(x, y + 1) & row(x, y + 2) & row(x, y + 3));
            if (x >= kFirst && y >= kFirst) find(x, y, 2, fourFrom(std::uint16_t(row(x, y))));
        }
    return any != 0;
}

/// Finds on which sides of cells creases pass, and unmarks the cells with one on both sides, or
/// with one and values that are extrapolated, perhaps across it.
void BandWindow::findSides(const std::array<Bits, 3>& rough)
{
    Bits sure = mKnown;
    for (std::size_t x = 0; x < kEdge; ++x)
        for (std::size_t y = 0; y < kEdge; ++y) sure[x][y] &= std::uint16_t(~mTorn[x][y]);
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y) {
            const std::size_t i = x + kBelow, j = y + kBelow;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const Bits& of = rough[axis];
                /// Of the cells, those of which a line through corners is rough from @a before
                /// voxels below the cell on.
                const auto cells = [&](std::size_t before) {
                    const std::size_t a = axis == 0 ? i - before : i,
                                      b = axis == 1 ? j - before : j;
                    unsigned bits = of[a][b];
                    if (axis != 0) bits |= of[a + 1][b];
                    if (axis != 1) bits |= of[a][b + 1];
                    if (axis == 2) bits |= of[a + 1][b + 1];
                    return (axis == 2 ? bits << before : bits | bits >> 1) >> kBelow;
                };
                const unsigned below = cells(2), above = cells(0);
                mBelow[axis][x][y] = std::uint8_t(below);
                mAbove[axis][x][y] = std::uint8_t(above);
                mUsable[x][y] &= std::uint8_t(~(below & above));
                mSmooth[x][y] &= std::uint8_t(~(below | cells(1) | above));
            }
            for (unsigned left = mUsable[x][y] & ~mSmooth[x][y]; left; left &= left - 1) {
                const int z = __builtin_ctz(left);
                if (!isWhole(sure, int(x), int(y), z)) mUsable[x][y] &= std::uint8_t(~(1u << z));
            }
        }
}

/// Whether all voxels from which value() takes a cell's values are among @a voxels.
bool BandWindow::isWhole(const Bits& voxels, int x, int y, int z) const
{
    const auto first = [&](std::size_t axis) { return side(axis, x, y, z) < 0 ? 0 : -1; };
    const auto last = [&](std::size_t axis) { return side(axis, x, y, z) > 0 ? 1 : 2; };
    unsigned row = 0xffff;
    for (int i = first(0); i <= last(0); ++i)
        for (int j = first(1); j <= last(1); ++j) {
            const int atX = x + kBelow + i, atY = y + kBelow + j;
            row &= voxels[std::size_t(atX)][std::size_t(atY)];
        }
    for (int k = first(2); k <= last(2); ++k)
        if (!(row >> (z + kBelow + k) & 1)) return false;
    return true;
}

float BandWindow::value(const Vec3f& place) const
{
    const int x = int(place[0]), y = int(place[1]), z = int(place[2]);
    const Four alongX = weightsAt(place[0] - float(x), side(0, x, y, z));
    const Four alongY = weightsAt(place[1] - float(y), side(1, x, y, z));
    const float* const first = &mValues[index(x + kBelow - 1, y + kBelow - 1, z + kBelow - 1)];
    Four rows{};
    for (int i = 0; i < 4; ++i) {
        const float* const at = first + i * kEdge * kRow;
        const Four plane =
            (alongY[0] * lanesAt<Four>(at) + alongY[1] * lanesAt<Four>(at + kRow)) +
            (alongY[2] * lanesAt<Four>(at + 2 * kRow) + alongY[3] * lanesAt<Four>(at + 3 * kRow));
        rows += alongX[i] * plane;
    }
    return sum(rows * weightsAt(place[2] - float(z), side(2, x, y, z)));
}

float BandWindow::value(const Vec3f& place, Vec3f& gradient) const
{
    const int x = int(place[0]), y = int(place[1]), z = int(place[2]);
    const float s = place[0] - float(x), t = place[1] - float(y), u = place[2] - float(z);
    const int sideX = side(0, x, y, z), sideY = side(1, x, y, z), sideZ = side(2, x, y, z);
    const Four alongX = weightsAt(s, sideX), slopeX = slopesAt(s, sideX);
    const Four alongY = weightsAt(t, sideY), slopeY = slopesAt(t, sideY);
    const Four alongZ = weightsAt(u, sideZ);
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
    gradient =
        Vec3f(sum(byX * alongZ), sum(byY * alongZ), sum(rows * slopesAt(u, sideZ))) / mVoxelSize;
    return sum(rows * alongZ);
}

} // namespace mpuvdb
