// Leaves are looked at with a rim of one voxel around them; most questions are answered for eight
// voxels at once, as bits of a row along z.
#include "leaf_check.h"

#include <mpuvdb/field.h>
#include <mpuvdb/progress.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;
static_assert(Leaf::DIM == kBlockDim, "rows of bits hold one leaf");

using Row = std::uint32_t;
constexpr int kPadded = kBlockDim + 2;
/// The bits of a row that belong to the leaf itself.
constexpr Row kInner = 0x1FE;

template <typename Visit>
void forEachBit(Row row, const Visit& visit)
{
    for (; row; row &= row - 1) visit(__builtin_ctz(row));
}

/// A leaf and its rim: values, and rows of bits along z.
class Neighbourhood
{
public:
    Neighbourhood(const openvdb::FloatGrid::ConstAccessor& accessor, const CheckLimits& limits)
        : mAccessor(accessor), mLimits(limits)
    {
    }

    /// Judge @a leaf. @return the sums of ||grad| - 1|.
    SideSums judge(const Leaf& leaf, FaultTallies& tallies)
    {
        mOrigin = leaf.origin();
        load();
        SideSums steepness = {};
        for (int x = 1; x <= kBlockDim; ++x)
            for (int y = 1; y <= kBlockDim; ++y) {
                judgeValues(x, y, tallies);
                judgeSigns(x, y, tallies);
                judgeBand(x, y, tallies);
                judgeSteps(x, y, tallies, steepness);
            }
        return steepness;
    }

private:
    using Bits = Row[kPadded][kPadded];

    Coord coord(int x, int y, int z) const { return mOrigin.offsetBy(x - 1, y - 1, z - 1); }

    void load()
    {
        for (int dx = -1; dx <= 1; ++dx)
            for (int dy = -1; dy <= 1; ++dy)
                for (int dz = -1; dz <= 1; ++dz) loadPart(dx, dy, dz);
        for (int x = 0; x < kPadded; ++x)
            for (int y = 0; y < kPadded; ++y) markRow(x, y);
    }

    /// Copy what the leaf, or the tile, at this side of ours has of our block.
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

    void markRow(int x, int y)
    {
        Row negative = 0, face = 0, edge = 0, corner = 0;
        for (int z = 0; z < kPadded; ++z) {
            const float v = mValue[x][y][z], magnitude = std::abs(v);
            negative |= Row(v < 0) << z;
            face |= Row(magnitude < mLimits.near[0]) << z;
            edge |= Row(magnitude < mLimits.near[1]) << z;
            corner |= Row(magnitude < mLimits.near[2]) << z;
        }
        mNegative[x][y] = negative;
        mNear[0][x][y] = face & mActive[x][y];
        mNear[1][x][y] = edge & mActive[x][y];
        mNear[2][x][y] = corner & mActive[x][y];
    }

    /// Calls @a visit with each face neighbour's offset.
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

    /// Row (x,y) of the block shifted by an offset: bit z is the neighbour's.
    static Row neighbour(const Bits& bits, int x, int y, int dx, int dy, int dz)
    {
        const Row row = bits[x + dx][y + dy];
        return dz < 0 ? row << 1 : dz > 0 ? row >> 1 : row;
    }

    void judgeValues(int x, int y, FaultTallies& tallies) const
    {
        const Row active = mActive[x][y];
        for (int z = 1; z <= kBlockDim; ++z) {
            const float v = mValue[x][y][z];
            const float excess = std::abs(v) - mLimits.background;
            if (active >> z & 1) {
                tallies.lowest = std::min(tallies.lowest, v);
                tallies.highest = std::max(tallies.highest, v);
                if (excess <= mLimits.tolerance) continue;
            } else if (std::abs(excess) <= mLimits.tolerance)
                continue;
            const Fault fault = !std::isfinite(v) ? Fault::NotFinite
                                : active >> z & 1 ? Fault::BeyondBackground
                                                  : Fault::InactiveValue;
            tallies[fault].add(coord(x, y, z));
        }
    }

    /// Changes of sign where one of two neighbours is inactive. The inactive one is at fault; what
    /// a tile is at fault for is noted at its neighbour.
    void judgeSigns(int x, int y, FaultTallies& tallies) const
    {
        const auto changes = [&](int dx, int dy, int dz) {
            const Row bothActive = mActive[x][y] & neighbour(mActive, x, y, dx, dy, dz);
            const Row mine = ~mActive[x][y] | neighbour(mTile, x, y, dx, dy, dz);
            return (mNegative[x][y] ^ neighbour(mNegative, x, y, dx, dy, dz)) & ~bothActive & mine;
        };
        Row any = 0;
        forEachFace([&](int dx, int dy, int dz) { any |= changes(dx, dy, dz); });
        forEachBit(any & kInner, [&](int z) {
            int faces = 0;
            forEachFace([&](int dx, int dy, int dz) { faces += changes(dx, dy, dz) >> z & 1; });
            tallies[Fault::SignChange].add(coord(x, y, z), faces);
        });
    }

    /// Inactive voxels that a neighbour's distance puts inside the band. A voxel at l voxels from
    /// one of distance d is at most d + l voxels from the surface.
    void judgeBand(int x, int y, FaultTallies& tallies) const
    {
        const Row active = mActive[x][y];
        Row missing = 0;
        for (int dx = -1; dx <= 1; ++dx)
            for (int dy = -1; dy <= 1; ++dy)
                for (int dz = -1; dz <= 1; ++dz) {
                    const int axes = dx * dx + dy * dy + dz * dz;
                    if (axes == 0) continue;
                    const Bits& near = mNear[axes - 1];
                    missing |= neighbour(near, x, y, dx, dy, dz) & ~active;
                    missing |= near[x][y] & neighbour(mTile, x, y, dx, dy, dz) &
                               ~neighbour(mActive, x, y, dx, dy, dz);
                }
        forEachBit(missing & kInner,
                   [&](int z) { tallies[Fault::MissingVoxel].add(coord(x, y, z)); });
    }

    /// Steps between active neighbours, and the gradient where all of them are active.
    void judgeSteps(int x, int y, FaultTallies& tallies, SideSums& sums) const
    {
        const auto& v = mValue;
        forEachBit(mActive[x][y] & kInner, [&](int z) {
            int steps = 0, actives = 0;
            forEachFace([&](int dx, int dy, int dz) {
                const int on = mActive[x + dx][y + dy] >> (z + dz) & 1;
                actives += on;
                steps += on & int(std::abs(v[x + dx][y + dy][z + dz] - v[x][y][z]) > mLimits.step);
            });
            if (steps) tallies[Fault::Jump].add(coord(x, y, z), steps);
            if (actives < 6) return;
            const float at = v[x][y][z];
            const float gx = twiceSlope(v[x - 1][y][z], at, v[x + 1][y][z]),
                        gy = twiceSlope(v[x][y - 1][z], at, v[x][y + 1][z]),
                        gz = twiceSlope(v[x][y][z - 1], at, v[x][y][z + 1]);
            const float steepness =
                std::abs(std::sqrt(gx * gx + gy * gy + gz * gz) / mLimits.twiceVoxel - 1);
            if (!std::isfinite(steepness)) return;
            const std::size_t side = at < 0;
            sums[side] += steepness;
            ++tallies.gradients[side];
            tallies.maxSteepness = std::max(tallies.maxSteepness, double(steepness));
            if (steepness > mLimits.steepness)
                tallies[Fault::Steepness].add(coord(x, y, z), steepness);
        });
    }

    /// Twice the slope along an axis: by central difference, but where the value turns between two
    /// sides of the surface by the steeper side.
    static float twiceSlope(float below, float at, float above)
    {
        const float rise = at - below, next = above - at;
        return rise * next < 0 ? 2 * std::max(std::abs(rise), std::abs(next)) : rise + next;
    }

    const openvdb::FloatGrid::ConstAccessor& mAccessor;
    const CheckLimits& mLimits;
    Coord mOrigin;
    float mValue[kPadded][kPadded][kPadded];
    Bits mActive = {}, mTile = {}, mNegative = {};
    Bits mNear[3] = {};
};

} // namespace

FaultTallies judgeLeaves(const openvdb::FloatGrid& grid, const CheckLimits& limits,
                         const openvdb::CoordBBox& within, SideSums& steepness, Progress& progress)
{
    std::vector<const Leaf*> leaves;
    grid.tree().getNodes(leaves);
    leaves.erase(std::remove_if(leaves.begin(), leaves.end(),
                                [&](const Leaf* leaf) {
                                    return !isWellWithin(leaf->origin(), Leaf::DIM, within);
                                }),
                 leaves.end());
    progress.beginStage("check", double(std::max<std::size_t>(leaves.size(), 1)));
    std::vector<SideSums> sums(leaves.size());
    const FaultTallies tallies = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, leaves.size(), 64), FaultTallies{},
        [&](const tbb::blocked_range<std::size_t>& range, FaultTallies part) {
            const auto accessor = grid.getConstAccessor();
            Neighbourhood neighbourhood(accessor, limits);
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                sums[n] = neighbourhood.judge(*leaves[n], part);
            }
            progress.advance(double(range.size()));
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
