// Checks of leaves with a rim of one voxel around them; most tests treat eight voxels at once, as
// bits of a row along z.
#include "leaf_check.h"

#include "core/clones.h"
#include "core/lanes.h"
#include <mpuvdb/field.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;
static_assert(Leaf::DIM == kBlockDim, "rows of bits hold one leaf");

using Row = std::uint32_t;
/// Lanes for the eight rows along y, and for the eight voxels of one row.
using Rows = Row __attribute__((vector_size(sizeof(Row) * kBlockDim)));
using Lanes = float __attribute__((vector_size(sizeof(float) * kBlockDim)));
constexpr int kPadded = kBlockDim + 2; ///< edge of a leaf with its rim, voxels [derived: sum]
/// Mask of a row's bits that belong to the leaf itself.
constexpr Row kInner = 0x1FE;

[[gnu::always_inline]] inline Lanes squareRoot(const Lanes& v)
{
    float a[kBlockDim];
    std::memcpy(a, &v, sizeof v);
    for (float& x : a) x = std::sqrt(x);
    return lanesAt<Lanes>(a);
}

template <typename Visit>
[[gnu::always_inline]] inline void forEachBit(Row row, const Visit& visit)
{
    for (; row; row &= row - 1) visit(__builtin_ctz(row));
}

/// A leaf with its rim: values, and rows of bits along z.
class LeafAndRim
{
public:
    LeafAndRim(const openvdb::FloatGrid::ConstAccessor& accessor, const CheckLimits& limits)
        : mAccessor(accessor), mLimits(limits)
    {
    }

    /// Check @a leaf. @return the sums of ||grad| - 1|.
    MPUVDB_CLONES
    SideSums check(const Leaf& leaf, FaultTallies& tallies)
    {
        mOrigin = leaf.origin();
        loadAll();
        SideSums steepness = {};
        for (int x = 1; x <= kBlockDim; ++x) {
            checkSigns(x, tallies);
            checkBand(x, tallies);
            for (int y = 1; y <= kBlockDim; ++y) {
                checkValues(x, y, tallies);
                checkSteps(x, y, tallies, steepness);
            }
        }
        return steepness;
    }

private:
    using Bits = Row[kPadded][kPadded];

    Coord coord(int x, int y, int z) const { return mOrigin.offsetBy(x - 1, y - 1, z - 1); }

    [[gnu::always_inline]] void loadAll()
    {
        for (int dx = -1; dx <= 1; ++dx)
            for (int dy = -1; dy <= 1; ++dy)
                for (int dz = -1; dz <= 1; ++dz) loadPart(dx, dy, dz);
        for (int x = 0; x < kPadded; ++x)
            for (int y = 0; y < kPadded; ++y) markRow(x, y);
    }

    /// Copy the part of the padded block that the leaf or tile at offset (dx,dy,dz) holds.
    void loadPart(int dx, int dy, int dz)
    {
        const auto first = [](int d) { return d < 0 ? 0 : d == 0 ? 1 : kPadded - 1; };
        const auto last = [](int d) { return d < 0 ? 0 : d == 0 ? kBlockDim : kPadded - 1; };
        const Coord origin = mOrigin.offsetBy(dx * kBlockDim, dy * kBlockDim, dz * kBlockDim);
        const Leaf* leaf = mAccessor.probeConstLeaf(origin);
        const float* values = leaf ? leaf->buffer().data() : nullptr;
        float tile = 0;
        const bool tileOn = !leaf && mAccessor.probeValue(origin, tile);
        const int z0 = first(dz), z1 = last(dz), from = (z0 + 7) & 7;
        const Row part = ((Row(2) << z1) - 1) & ~((Row(1) << z0) - 1);
        for (int x = first(dx); x <= last(dx); ++x)
            for (int y = first(dy); y <= last(dy); ++y) {
                const int row = ((x + 7) & 7) * 8 + ((y + 7) & 7);
                const Row on =
                    leaf ? (Row(leaf->valueMask().getWord<std::uint8_t>(openvdb::Index(row))) >>
                            from << z0) &
                               part
                    : tileOn ? part
                             : 0;
                mActive[x][y] = (mActive[x][y] & ~part) | on;
                mTile[x][y] = (mTile[x][y] & ~part) | (leaf ? 0 : part);
                for (int z = z0; z <= z1; ++z)
                    mValue[x][y][z] = leaf ? values[row * 8 + from + z - z0] : tile;
            }
    }

    /// A padded row of bits: whether f holds for the value at z; f takes eight values at once.
    template <typename F>
    [[gnu::always_inline]] Row wholeRow(int x, int y, const F& f) const
    {
        constexpr int kRest =
            kPadded - kBlockDim; ///< voxels beyond the lanes [derived: difference]
        const float* const values = mValue[x][y];
        return Row(bitsOf(f(lanesAt<Lanes>(values))) | bitsOf(f(lanesAt<Lanes>(values + kRest)))
                                                           << kRest);
    }

    [[gnu::always_inline]] void markRow(int x, int y)
    {
        mNegative[x][y] = wholeRow(x, y, [](const Lanes& v) { return v < 0; });
        for (int n = 0; n < 3; ++n) {
            const float near = mLimits.near[n];
            mNear[n][x][y] =
                mActive[x][y] & wholeRow(x, y, [&](const Lanes& v) { return magnitude(v) < near; });
        }
    }

    /// Call visit(dx, dy, dz) with each face neighbor's offset.
    template <typename Visit>
    static void forEachFace(const Visit& visit)
    {
        visit(-1, 0, 0);
        visit(1, 0, 0);
        visit(0, -1, 0);
        visit(0, 1, 0);
        visit(0, 0, -1);
        visit(0, 0, 1);
    }

    /// Rows (x,1) to (x,8) shifted by an offset: bit z is the neighbor's.
    [[gnu::always_inline]] static Rows neighbors(const Bits& bits, int x, int dx, int dy, int dz)
    {
        const Rows rows = lanesAt<Rows>(&bits[x + dx][1 + dy]);
        return dz < 0 ? rows << 1 : dz > 0 ? rows >> 1 : rows;
    }

    /// Call visit(y, z) for the leaf's voxels in rows (x,1) to (x,8).
    template <typename Visit>
    [[gnu::always_inline]] static void forEachInner(const Rows& rows, const Visit& visit)
    {
        if (!bitsOf((rows & kInner) != 0)) return;
        for (int y = 1; y <= kBlockDim; ++y)
            forEachBit(rows[y - 1] & kInner, [&](int z) { visit(y, z); });
    }

    [[gnu::always_inline]] void checkValues(int x, int y, FaultTallies& tallies) const
    {
        const Lanes v = lanesAt<Lanes>(&mValue[x][y][1]),
                    excess = magnitude(v) - mLimits.background;
        const Row active = mActive[x][y] >> 1 & 0xff;
        const Row beyond = ~Row(bitsOf(excess <= mLimits.tolerance)),
                  off = ~Row(bitsOf(magnitude(excess) <= mLimits.tolerance));
        forEachBit(active, [&](int z) {
            tallies.lowest = std::min(tallies.lowest, v[z]);
            tallies.highest = std::max(tallies.highest, v[z]);
        });
        forEachBit(((active & beyond) | (~active & off)) & 0xff, [&](int z) {
            const Fault fault = !std::isfinite(v[z]) ? Fault::NotFinite
                                : active >> z & 1    ? Fault::BeyondBackground
                                                     : Fault::InactiveValue;
            tallies[fault].add(coord(x, y, z + 1));
        });
    }

    /// Changes of sign where one of two neighbors is inactive. They count at the inactive one, or
    /// at the neighbor of a tile.
    [[gnu::always_inline]] void checkSigns(int x, FaultTallies& tallies) const
    {
        const Rows active = lanesAt<Rows>(&mActive[x][1]),
                   negative = lanesAt<Rows>(&mNegative[x][1]);
        const auto changes = [&](int dx, int dy, int dz) {
            const Rows bothActive = active & neighbors(mActive, x, dx, dy, dz);
            const Rows mine = ~active | neighbors(mTile, x, dx, dy, dz);
            return Rows((negative ^ neighbors(mNegative, x, dx, dy, dz)) & ~bothActive & mine);
        };
        Rows any{};
        forEachFace([&](int dx, int dy, int dz) { any |= changes(dx, dy, dz); });
        forEachInner(any, [&](int y, int z) {
            int faces = 0;
            forEachFace(
                [&](int dx, int dy, int dz) { faces += int(changes(dx, dy, dz)[y - 1] >> z & 1); });
            tallies[Fault::SignChange].add(coord(x, y, z), faces);
        });
    }

    /// Inactive voxels that a neighbor's distance puts inside the band: a voxel l voxels from one
    /// of distance d is at most d + l voxels from the surface.
    [[gnu::always_inline]] void checkBand(int x, FaultTallies& tallies) const
    {
        const Rows active = lanesAt<Rows>(&mActive[x][1]);
        Rows missing{};
        for (int dx = -1; dx <= 1; ++dx)
            for (int dy = -1; dy <= 1; ++dy)
                for (int dz = -1; dz <= 1; ++dz) {
                    const int axes = dx * dx + dy * dy + dz * dz;
                    if (axes == 0) continue;
                    const Bits& near = mNear[axes - 1];
                    missing |= neighbors(near, x, dx, dy, dz) & ~active;
                    missing |= lanesAt<Rows>(&near[x][1]) & neighbors(mTile, x, dx, dy, dz) &
                               ~neighbors(mActive, x, dx, dy, dz);
                }
        forEachInner(missing,
                     [&](int y, int z) { tallies[Fault::MissingVoxel].add(coord(x, y, z)); });
    }

    /// Steps between active neighbors, voxels whose neighbors all have their value, and the
    /// gradient where all of them are active.
    [[gnu::always_inline]] void checkSteps(int x, int y, FaultTallies& tallies,
                                           SideSums& sums) const
    {
        const Row active = mActive[x][y];
        if (!(active & kInner)) return;
        const auto valuesAt = [&](int dx, int dy, int dz) {
            return lanesAt<Lanes>(&mValue[x + dx][y + dy][1 + dz]);
        };
        const auto activeAt = [&](int dx, int dy, int dz) {
            const Row row = mActive[x + dx][y + dy];
            return (dz < 0 ? row << 1 : dz > 0 ? row >> 1 : row) & active & kInner;
        };
        const Lanes at = valuesAt(0, 0, 0);
        const auto steps = [&](int dx, int dy, int dz) {
            return activeAt(dx, dy, dz) &
                   Row(bitsOf(magnitude(valuesAt(dx, dy, dz) - at) > mLimits.step)) << 1;
        };
        Row any = 0, full = kInner;
        Lanes largest{}; // steps
        forEachFace([&](int dx, int dy, int dz) {
            const Lanes step = magnitude(valuesAt(dx, dy, dz) - at);
            largest = step > largest ? step : largest;
            full &= activeAt(dx, dy, dz);
        });
        // Farther than a voxel from the surface, a neighbor towards it is nearer.
        const Row flat =
            active &
            Row(bitsOf((largest <= mLimits.tolerance) & (magnitude(at) * 2 > mLimits.twiceVoxel)))
                << 1;
        forEachBit(flat, [&](int z) { tallies[Fault::Flat].add(coord(x, y, z)); });
        if (bitsOf(largest > mLimits.step))
            forEachFace([&](int dx, int dy, int dz) { any |= steps(dx, dy, dz); });
        forEachBit(any, [&](int z) {
            int count = 0;
            forEachFace([&](int dx, int dy, int dz) { count += int(steps(dx, dy, dz) >> z & 1); });
            tallies[Fault::Jump].add(coord(x, y, z), count);
        });
        const Lanes gx = twiceSlope(valuesAt(-1, 0, 0), at, valuesAt(1, 0, 0)),
                    gy = twiceSlope(valuesAt(0, -1, 0), at, valuesAt(0, 1, 0)),
                    gz = twiceSlope(valuesAt(0, 0, -1), at, valuesAt(0, 0, 1));
        const Lanes steepness =
            magnitude(squareRoot(gx * gx + gy * gy + gz * gz) / mLimits.twiceVoxel - 1);
        const Row negative = mNegative[x][y];
        forEachBit(full, [&](int z) {
            const float s = steepness[z - 1];
            if (!std::isfinite(s)) return;
            const std::size_t side = negative >> z & 1;
            sums[side] += s;
            ++tallies.gradients[side];
            tallies.maxSteepness = std::max(tallies.maxSteepness, double(s));
            if (s > mLimits.steepness) tallies[Fault::Steepness].add(coord(x, y, z), s);
        });
    }

    /// Twice the slope along an axis: the central difference, but at an extremum between two sheets
    /// the steeper side.
    [[gnu::always_inline]] static Lanes twiceSlope(const Lanes& below, const Lanes& at,
                                                   const Lanes& above)
    {
        const Lanes rise = at - below, next = above - at;
        const Lanes a = magnitude(rise), b = magnitude(next);
        return rise * next < 0 ? 2 * (a < b ? b : a) : rise + next;
    }

    const openvdb::FloatGrid::ConstAccessor& mAccessor;
    const CheckLimits& mLimits;
    Coord mOrigin;
    float mValue[kPadded][kPadded][kPadded];
    Bits mActive = {}, mTile = {}, mNegative = {};
    Bits mNear[3] = {};
};

} // namespace

FaultTallies checkLeaves(const openvdb::FloatGrid& grid,
                         const std::vector<const openvdb::FloatTree::LeafNodeType*>& leaves,
                         const CheckLimits& limits, SideSums& steepness, Interrupter& progress,
                         double units)
{
    std::vector<SideSums> sums(leaves.size());
    const FaultTallies tallies = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, leaves.size(), 64), FaultTallies{},
        [&](const tbb::blocked_range<std::size_t>& range, FaultTallies part) {
            const auto accessor = grid.getConstAccessor();
            LeafAndRim neighborhood(accessor, limits);
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                sums[n] = neighborhood.check(*leaves[n], part);
            }
            progress.advance(units * double(range.size()) / double(leaves.size()));
            return part;
        },
        [](FaultTallies a, const FaultTallies& b) {
            a.join(b);
            return a;
        });
    steepness = {};
    for (const SideSums& sum : sums)
        for (std::size_t side : {0, 1}) steepness[side] += sum[side];
    return tallies;
}

} // namespace mpuvdb
