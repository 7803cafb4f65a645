// What is wrong with the voxels of a leaf.
#pragma once
#include <mpuvdb/field.h>

#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <cstdint>

namespace mpuvdb
{

/// What a voxel can be at fault for, or a tile.
enum class Fault {
    NotFinite,
    ActiveTile,
    BeyondBackground,
    InactiveValue,
    MissingVoxel,
    SignChange,
    Jump,
    Steepness
};
constexpr std::size_t kFaults = std::size_t(Fault::Steepness) + 1;

/// All thresholds, in world units.
struct CheckLimits {
    float background, tolerance, step, twiceVoxel;
    std::array<float, 3> near; ///< below: the neighbours across a face, edge, corner are active
    float steepness;           ///< largest ||grad| - 1| that is not counted
};

/// How often a fault was seen, and where most of it: the first voxel of those of highest rank.
struct FaultTally {
    std::uint64_t count = 0;
    double rank = -1;
    openvdb::Coord voxel;

    void add(const openvdb::Coord& at, double atRank = 0, std::uint64_t times = 1)
    {
        count += times;
        place(at, atRank);
    }
    void join(const FaultTally& other)
    {
        count += other.count;
        if (other.rank >= 0) place(other.voxel, other.rank);
    }

private:
    void place(const openvdb::Coord& at, double atRank)
    {
        if (atRank < rank || (atRank == rank && !(at < voxel))) return;
        rank = atRank;
        voxel = at;
    }
};

/// What was seen: nothing of it depends on the order in which voxels are looked at.
struct FaultTallies {
    std::array<FaultTally, kFaults> faults;
    std::uint64_t active = 0;
    std::array<std::uint64_t, 2> gradients = {}; ///< outside, inside
    double maxSteepness = 0;
    float lowest = 0, highest = 0;

    FaultTally& operator[](Fault fault) { return faults[std::size_t(fault)]; }
    void join(const FaultTallies& other)
    {
        for (std::size_t n = 0; n < kFaults; ++n) faults[n].join(other.faults[n]);
        active += other.active;
        for (std::size_t side : {0, 1}) gradients[side] += other.gradients[side];
        maxSteepness = std::max(maxSteepness, other.maxSteepness);
        lowest = std::min(lowest, other.lowest);
        highest = std::max(highest, other.highest);
    }
};

using SideSums = std::array<double, 2>; ///< outside, inside

/// Looks at leaves with a rim of one voxel around them; most questions are answered for eight
/// voxels at once, as bits of a row along z.
class LeafCheck
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    LeafCheck(const openvdb::FloatGrid::ConstAccessor& accessor, const CheckLimits& limits)
        : mAccessor(accessor), mLimits(limits)
    {
    }

    /// Judge @a leaf. @return the sums of ||grad| - 1|.
    SideSums judge(const Leaf& leaf, FaultTallies& tallies);

private:
    using Row = std::uint32_t;
    static constexpr int kPadded = kBlockDim + 2;
    using Bits = Row[kPadded][kPadded];

    openvdb::Coord coord(int x, int y, int z) const
    {
        return mOrigin.offsetBy(x - 1, y - 1, z - 1);
    }
    static Row neighbour(const Bits& bits, int x, int y, int dx, int dy, int dz);
    void load();
    void loadPart(int dx, int dy, int dz);
    void markRow(int x, int y);
    void judgeValues(int x, int y, FaultTallies& tallies) const;
    void judgeSigns(int x, int y, FaultTallies& tallies) const;
    void judgeBand(int x, int y, FaultTallies& tallies) const;
    void judgeSteps(int x, int y, FaultTallies& tallies, SideSums& sums) const;

    const openvdb::FloatGrid::ConstAccessor& mAccessor;
    const CheckLimits& mLimits;
    openvdb::Coord mOrigin;
    float mValue[kPadded][kPadded][kPadded];
    Bits mActive = {}, mTile = {}, mNegative = {};
    Bits mNear[3] = {};
};

} // namespace mpuvdb
