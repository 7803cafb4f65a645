// Faults of a level set's voxels, found leaf by leaf.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A violated property of a voxel or tile.
enum class Fault {
    NotFinite,
    ActiveTile,
    BeyondBackground,
    InactiveValue,
    MissingVoxel,
    SignChange,
    Jump,
    Flat,
    Steepness
};
constexpr std::size_t kFaults = std::size_t(Fault::Steepness) + 1; ///< kinds [derived: the last]

/// Thresholds of the checks, in world units.
struct CheckLimits {
    float background, tolerance, step, twiceVoxel;
    std::array<float, 3> near; ///< |value| below which neighbors by face, edge, corner are active
    float steepness;           ///< largest ||grad| - 1| that is not counted
};

/// How often a fault was found, and its worst voxel: the first of those of highest rank.
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

/// The result of a check; it does not depend on the order in which voxels are visited.
struct FaultTallies {
    std::array<FaultTally, kFaults> faults;
    std::array<std::uint64_t, 2> gradients = {}; ///< outside, inside
    double maxSteepness = 0;
    float lowest = 0, highest = 0;

    FaultTally& operator[](Fault fault) { return faults[std::size_t(fault)]; }
    void join(const FaultTallies& other)
    {
        for (std::size_t n = 0; n < kFaults; ++n) faults[n].join(other.faults[n]);
        for (std::size_t side : {0, 1}) gradients[side] += other.gradients[side];
        maxSteepness = std::max(maxSteepness, other.maxSteepness);
        lowest = std::min(lowest, other.lowest);
        highest = std::max(highest, other.highest);
    }
};

using SideSums = std::array<double, 2>; ///< outside, inside

/// Whether the cube at @a origin lies in @a within, and the voxels around it.
inline bool isWellWithin(const openvdb::Coord& origin, int dim, const openvdb::CoordBBox& within)
{
    return within == openvdb::CoordBBox::inf() ||
           within.isInside(openvdb::CoordBBox(origin.offsetBy(-1), origin.offsetBy(dim)));
}

/// Check @a leaves of @a grid; @a steepness becomes the sums of ||grad| - 1|, added up in the
/// leaves' order. @param units  by which the running stage advances. @throws Interrupted.
FaultTallies checkLeaves(const openvdb::FloatGrid& grid,
                         const std::vector<const openvdb::FloatTree::LeafNodeType*>& leaves,
                         const CheckLimits& limits, SideSums& steepness, Interrupter& progress,
                         double units = 0);

} // namespace mpuvdb
