// What a level set promises, looked at voxel by voxel. Leaves are looked at with a rim of one voxel
// around them; most questions are answered for eight voxels at once, as bits of a row along z.
#include <mpuvdb/error.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/progress.h>

#include "transform_lattice.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <array>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
static_assert(Leaf::DIM == kBlockDim, "rows of bits hold one leaf");

enum Kind {
    NotFinite,
    ActiveTile,
    BeyondBackground,
    InactiveValue,
    MissingVoxel,
    SignChange,
    Jump,
    Steepness,
    KindCount
};

/// A half float has 11 significant bits, all others are exact but for a rounding or two.
constexpr double kHalfTolerance = 1.0 / 1024, kFloatTolerance = 1e-5;
/// A distance changes by at most one voxel from voxel to voxel; beyond two, it is none.
constexpr double kLargestStep = 2;
/// How much farther than its neighbour's distance allows a voxel may be before it is missed.
constexpr double kBandMargin = 0.5;

/// All thresholds, in world units.
struct Limits {
    float background, tolerance, step, twiceVoxel;
    std::array<float, 3> near; ///< below: the neighbours across a face, edge, corner are active
    float steepness;           ///< largest ||grad| - 1| that is not counted
};

Limits limitsOf(const openvdb::FloatGrid& grid, double voxelSize, double gradientTolerance)
{
    Limits limits;
    limits.background = grid.background();
    limits.tolerance =
        float(limits.background * (grid.saveFloatAsHalf() ? kHalfTolerance : kFloatTolerance));
    limits.step = float(kLargestStep * voxelSize);
    limits.twiceVoxel = float(2 * voxelSize);
    for (int n = 0; n < 3; ++n)
        limits.near[n] = float(limits.background - (std::sqrt(n + 1.0) + kBandMargin) * voxelSize);
    limits.steepness = float(gradientTolerance);
    return limits;
}

/// How often something was seen, and where most of it: the first voxel of those of highest rank.
struct Tally {
    std::uint64_t count = 0;
    double rank = -1;
    Coord voxel;

    void add(const Coord& at, double atRank = 0, std::uint64_t times = 1)
    {
        count += times;
        place(at, atRank);
    }
    void join(const Tally& other)
    {
        count += other.count;
        if (other.rank >= 0) place(other.voxel, other.rank);
    }

private:
    void place(const Coord& at, double atRank)
    {
        if (atRank < rank || (atRank == rank && !(at < voxel))) return;
        rank = atRank;
        voxel = at;
    }
};

/// What does not depend on the order in which voxels are looked at.
struct Tallies {
    std::array<Tally, KindCount> of;
    std::uint64_t active = 0;
    std::array<std::uint64_t, 2> gradients = {}; ///< outside, inside
    double maxSteepness = 0;
    float lowest = 0, highest = 0;

    void join(const Tallies& other)
    {
        for (int kind = 0; kind < KindCount; ++kind) of[kind].join(other.of[kind]);
        active += other.active;
        for (std::size_t side : {0, 1}) gradients[side] += other.gradients[side];
        maxSteepness = std::max(maxSteepness, other.maxSteepness);
        lowest = std::min(lowest, other.lowest);
        highest = std::max(highest, other.highest);
    }
};

using SideSums = std::array<double, 2>; ///< outside, inside

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
    Neighbourhood(const openvdb::FloatGrid::ConstAccessor& accessor, const Limits& limits)
        : mAccessor(accessor), mLimits(limits)
    {
    }

    /// Judge @a leaf. @return the sums of ||grad| - 1|.
    SideSums judge(const Leaf& leaf, Tallies& tallies)
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

    void judgeValues(int x, int y, Tallies& tallies) const
    {
        const Row active = mActive[x][y];
        tallies.active += std::uint64_t(__builtin_popcount(active & kInner));
        for (int z = 1; z <= kBlockDim; ++z) {
            const float v = mValue[x][y][z];
            const float excess = std::abs(v) - mLimits.background;
            if (active >> z & 1) {
                tallies.lowest = std::min(tallies.lowest, v);
                tallies.highest = std::max(tallies.highest, v);
                if (excess <= mLimits.tolerance) continue;
            } else if (std::abs(excess) <= mLimits.tolerance)
                continue;
            const Kind kind = !std::isfinite(v) ? NotFinite
                              : active >> z & 1 ? BeyondBackground
                                                : InactiveValue;
            tallies.of[kind].add(coord(x, y, z));
        }
    }

    /// Changes of sign where one of two neighbours is inactive. The inactive one is at fault; what
    /// a tile is at fault for is noted at its neighbour.
    void judgeSigns(int x, int y, Tallies& tallies) const
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
            tallies.of[SignChange].add(coord(x, y, z), faces);
        });
    }

    /// Inactive voxels that a neighbour's distance puts inside the band. A voxel at l voxels from
    /// one of distance d is at most d + l voxels from the surface.
    void judgeBand(int x, int y, Tallies& tallies) const
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
        forEachBit(missing & kInner, [&](int z) { tallies.of[MissingVoxel].add(coord(x, y, z)); });
    }

    /// Steps between active neighbours, and the gradient where all of them are active.
    void judgeSteps(int x, int y, Tallies& tallies, SideSums& sums) const
    {
        const auto& v = mValue;
        forEachBit(mActive[x][y] & kInner, [&](int z) {
            int steps = 0, actives = 0;
            forEachFace([&](int dx, int dy, int dz) {
                const int on = mActive[x + dx][y + dy] >> (z + dz) & 1;
                actives += on;
                steps += on & int(std::abs(v[x + dx][y + dy][z + dz] - v[x][y][z]) > mLimits.step);
            });
            if (steps) tallies.of[Jump].add(coord(x, y, z), steps);
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
            if (steepness > mLimits.steepness) tallies.of[Steepness].add(coord(x, y, z), steepness);
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
    const Limits& mLimits;
    Coord mOrigin;
    float mValue[kPadded][kPadded][kPadded];
    Bits mActive = {}, mTile = {}, mNegative = {};
    Bits mNear[3] = {};
};

/// Judge a tile: inactive, of background's magnitude, of the same sign as what it touches. Smaller
/// neighbours look at it from their side.
void judgeTile(const openvdb::FloatGrid::ConstAccessor& accessor, const Limits& limits,
               const Coord& origin, int dim, Tallies& tallies)
{
    float value = 0;
    const bool active = accessor.probeValue(origin, value);
    const std::uint64_t voxels = std::uint64_t(dim) * dim * dim;
    if (active) {
        tallies.active += voxels;
        tallies.of[ActiveTile].add(origin, 0, voxels);
    }
    if (!std::isfinite(value))
        tallies.of[NotFinite].add(origin, 0, voxels);
    else if (!active && !(std::abs(std::abs(value) - limits.background) <= limits.tolerance))
        tallies.of[InactiveValue].add(origin, 0, voxels);
    for (int axis = 0; axis < 3; ++axis)
        for (int side : {-1, dim}) {
            Coord beyond = origin;
            beyond[axis] += side;
            float other = 0;
            const bool bothActive = accessor.probeValue(beyond, other) && active;
            if (!bothActive && (value < 0) != (other < 0)) tallies.of[SignChange].add(origin);
        }
}

/// Judge the tiles of all nodes of one level.
template <typename Node>
Tallies judgeTilesOf(const openvdb::FloatGrid& grid, const Limits& limits, Progress& progress)
{
    std::vector<const Node*> nodes;
    grid.tree().getNodes(nodes);
    return tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, nodes.size(), 1), Tallies{},
        [&](const tbb::blocked_range<std::size_t>& range, Tallies tallies) {
            const auto accessor = grid.getConstAccessor();
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                for (auto tile = nodes[n]->cbeginValueAll(); tile; ++tile)
                    judgeTile(accessor, limits, tile.getCoord(), Node::ChildNodeType::DIM, tallies);
            }
            return tallies;
        },
        [](Tallies a, const Tallies& b) {
            a.join(b);
            return a;
        });
}

Tallies judgeTiles(const openvdb::FloatGrid& grid, const Limits& limits, Progress& progress)
{
    using Upper = Tree::RootNodeType::ChildNodeType;
    using Lower = Upper::ChildNodeType;
    Tallies tallies = judgeTilesOf<Upper>(grid, limits, progress);
    tallies.join(judgeTilesOf<Lower>(grid, limits, progress));
    const auto accessor = grid.getConstAccessor();
    for (auto tile = grid.tree().root().cbeginValueAll(); tile; ++tile)
        judgeTile(accessor, limits, tile.getCoord(), Upper::DIM, tallies);
    return tallies;
}

/// Judge all leaves; @a steepness becomes the sums of ||grad| - 1|, added up in the leaves' order.
Tallies judgeLeaves(const openvdb::FloatGrid& grid, const Limits& limits, SideSums& steepness,
                    Progress& progress)
{
    std::vector<const Leaf*> leaves;
    grid.tree().getNodes(leaves);
    progress.beginStage("check", double(std::max<std::size_t>(leaves.size(), 1)));
    std::vector<SideSums> sums(leaves.size());
    const Tallies tallies = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, leaves.size(), 64), Tallies{},
        [&](const tbb::blocked_range<std::size_t>& range, Tallies part) {
            const auto accessor = grid.getConstAccessor();
            Neighbourhood neighbourhood(accessor, limits);
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                progress.check();
                sums[n] = neighbourhood.judge(*leaves[n], part);
            }
            progress.advance(double(range.size()));
            return part;
        },
        [](Tallies a, const Tallies& b) {
            a.join(b);
            return a;
        });
    steepness = {};
    for (const SideSums& sum : sums)
        for (std::size_t side : {0, 1}) steepness[side] += sum[side];
    return tallies;
}

/// What is wrong with a kind of tally, in words.
std::string describe(Kind kind, const Limits& limits, const CheckReport& report)
{
    switch (kind) {
    case NotFinite:
        return "values are not finite";
    case ActiveTile:
        return "active tiles: a distance is not constant over a whole tile";
    case BeyondBackground:
        return fmt::format("active values beyond the background {:g}", limits.background);
    case InactiveValue:
        return fmt::format("inactive values other than +-{:g}, the background", limits.background);
    case MissingVoxel:
        return fmt::format("voxels missing from the band, which reaches {:.2f} voxels inside and "
                           "{:.2f} outside of the {:.2f} that the background promises",
                           report.bandInside, report.bandOutside,
                           2 * limits.background / limits.twiceVoxel);
    case SignChange:
        return "the sign changes beside an inactive voxel or tile";
    case Jump:
        return fmt::format("the distance changes by more than {:g} voxels from voxel to voxel",
                           kLargestStep);
    default:
        return fmt::format("not a distance: ||grad| - 1| is {:.3f} on average (largest {:.3f}, "
                           "tolerance {:g})",
                           report.meanGradientError, report.maxGradientError, limits.steepness);
    }
}

/// What is wrong with the grid as a whole, and forbids to look at its voxels.
std::vector<CheckFinding> findingsOfGrid(const openvdb::FloatGrid& grid)
{
    std::vector<CheckFinding> findings;
    const auto add = [&](const std::string& what) { findings.push_back({what, Coord(), 0}); };
    const auto lattice = latticeOf(grid.transform());
    if (!lattice) add("voxels are not cubes along the axes");
    const float background = grid.background();
    if (!std::isfinite(background) || !(background > 0))
        add(fmt::format("the background is {:g}, and should be the band's half-width", background));
    else if (lattice && background < lattice->voxelSize * (1 - kHalfTolerance))
        add(fmt::format("the background is {:g} voxels, and a band has at least 1",
                        background / lattice->voxelSize));
    return findings;
}

} // namespace

CheckReport check(const openvdb::FloatGrid& grid, Progress& progress, double gradientTolerance)
{
    CheckReport report;
    report.activeVoxels = grid.activeVoxelCount();
    report.findings = findingsOfGrid(grid);
    const bool measurable = report.findings.empty();
    if (grid.getGridClass() != openvdb::GRID_LEVEL_SET)
        report.findings.push_back(
            {fmt::format("the class is '{}', and should be 'level set'",
                         openvdb::GridBase::gridClassToString(grid.getGridClass())),
             Coord(), 0});
    if (!measurable) return report;

    const double voxelSize = latticeOf(grid.transform())->voxelSize;
    const Limits limits = limitsOf(grid, voxelSize, gradientTolerance);
    SideSums steepness = {};
    Tallies tallies = judgeLeaves(grid, limits, steepness, progress);
    tallies.join(judgeTiles(grid, limits, progress));
    progress.endStage();

    report.activeVoxels = tallies.active;
    report.bandInside = -tallies.lowest / voxelSize;
    report.bandOutside = tallies.highest / voxelSize;
    report.maxGradientError = tallies.maxSteepness;
    // The better side counts: inside a wall thinner than the band there is no room for a slope.
    double mean = std::numeric_limits<double>::infinity();
    for (std::size_t side : {0, 1})
        if (const std::uint64_t n = tallies.gradients[side])
            mean = std::min(mean, steepness[side] / double(n));
    if (std::isfinite(mean)) report.meanGradientError = mean;
    for (int kind = 0; kind < KindCount; ++kind) {
        const Tally& tally = tallies.of[kind];
        if (tally.count == 0) continue;
        if (kind == Steepness && report.meanGradientError <= gradientTolerance) continue;
        report.findings.push_back({describe(Kind(kind), limits, report), tally.voxel, tally.count});
    }
    return report;
}

} // namespace mpuvdb
