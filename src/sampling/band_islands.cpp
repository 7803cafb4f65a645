// Removal of islands: small components of one sign, enclosed by the other, that data do not
// support.
#include "band.h"
#include "core/union_find.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

constexpr std::uint64_t kMaxIslandVoxels = 1
                                           << 18; ///< of a removed component [tuned: unseen_bench]
/// Number of data points in its voxels from which on a component is an object: about half of the
/// points of an object lie there, the others outside. [tuned: noise_bench]
constexpr std::size_t kMinObjectPoints = 30;
/// Divisor of the number of all points that gives that number, if lower. [tuned: handles_test]
constexpr std::size_t kObjectShare = 4;

using Part = Band::Regions::Part;

std::vector<Part> partsOf(const SignWords& inside)
{
    SignWords outside = inside;
    for (std::uint64_t& w : outside) w = ~w;
    std::vector<Part> parts;
    for (const SignWords& voxels : connectedParts(outside)) parts.push_back({voxels, false});
    for (const SignWords& voxels : connectedParts(inside)) parts.push_back({voxels, true});
    return parts;
}

} // namespace

std::uint32_t Band::Regions::rootOf(std::size_t block, int voxel) const
{
    const auto holds = [voxel](const Part& part) {
        return (part.voxels[std::size_t(voxel) / 64] >> (voxel % 64) & 1u) != 0;
    };
    const auto found = std::find_if(parts[block].begin(), parts[block].end(), holds);
    return roots[first[block] + std::uint32_t(found - parts[block].begin())];
}

Band::Regions Band::labelRegions() const
{
    Regions regions;
    std::vector<std::vector<Part>>& parts = regions.parts;
    std::vector<std::uint32_t>& first = regions.first;
    std::vector<std::uint64_t>& voxels = regions.voxels;
    parts.resize(mBlocks.size());
    tbb::parallel_for(std::size_t(0), mBlocks.size(), [&](std::size_t n) {
        if (n % 1024 == 0) mProgress.check();
        parts[n] = partsOf(mBlocks[n].inside);
    });
    first.assign(mBlocks.size() + 1, 0);
    for (std::size_t n = 0; n < parts.size(); ++n)
        first[n + 1] = first[n] + std::uint32_t(parts[n].size());

    UnionFind components(first.back());
    voxels.resize(first.back());
    /// Voxels of an unbounded part. [derived: above kMaxIslandVoxels, with room for sums]
    constexpr std::uint64_t kUnbounded = std::uint64_t(1) << 40;
    std::vector<std::uint8_t>& goesOn = regions.goesOn;
    goesOn.assign(first.back(), 0);
    for (std::size_t n = 0; n < mBlocks.size(); ++n) {
        const Vec3i at = mBlocks[n].at;
        for (std::uint32_t p = 0; p < parts[n].size(); ++p) {
            const Part& part = parts[n][p];
            voxels[first[n] + p] = countVoxels(part.voxels);
            for (int axis = 0; axis < 3; ++axis) {
                for (const bool upper : {false, true}) {
                    if (!reachesFace(part.voxels, axis, upper)) continue;
                    const auto next =
                        mIndex.find(packed(at + (upper ? 1 : -1) * Vec3i::Unit(axis)));
                    if (next == mIndex.end()) {
                        if (isKnown(at + (upper ? 1 : -1) * Vec3i::Unit(axis)))
                            voxels[first[n] + p] = kUnbounded;
                        else
                            goesOn[first[n] + p] = 1;
                        continue;
                    }
                    const std::uint32_t m = next->second;
                    for (std::uint32_t q = 0; upper && q < parts[m].size(); ++q)
                        if (parts[m][q].inside == part.inside &&
                            meet(part.voxels, parts[m][q].voxels, axis))
                            components.join(first[n] + p, first[m] + q);
                }
            }
        }
    }
    const std::vector<std::uint32_t>& roots = regions.roots = components.roots();
    for (std::uint32_t p = 0; p < roots.size(); ++p)
        if (roots[p] != p) {
            voxels[roots[p]] += voxels[p];
            goesOn[roots[p]] |= goesOn[p];
        }
    return regions;
}

std::size_t Band::removeIslands()
{
    std::size_t removed = 0;
    // An island within another now has the sign of its surroundings, and those inside it are left.
    while (const std::size_t turned = turnIslands()) removed += turned;
    return removed;
}

std::size_t Band::turnIslands()
{
    const Regions regions = labelRegions();
    const std::vector<std::vector<Part>>& parts = regions.parts;
    const std::vector<std::uint32_t>&first = regions.first, &roots = regions.roots;
    const std::vector<std::uint64_t>& voxels = regions.voxels;
    const Vec3d everywhere = Vec3d::Constant(std::numeric_limits<double>::max());
    const std::size_t all = mField.countData({-everywhere, everywhere},
                                             kObjectShare * kMinObjectPoints),
                      enough =
                          std::min(kMinObjectPoints, std::max<std::size_t>(all / kObjectShare, 1));
    struct Small {
        std::size_t points = 0;
        float deepest = 0;
        bool goesOn = false;
    };
    std::unordered_map<std::uint32_t, Small> small; // components, by root
    const auto forEachSmall = [&](auto f) {
        for (std::size_t n = 0; n < mBlocks.size(); ++n)
            for (std::uint32_t p = 0; p < parts[n].size(); ++p)
                if (const std::uint32_t root = roots[first[n] + p]; voxels[root] < kMaxIslandVoxels)
                    f(mBlocks[n], parts[n][p].voxels, root);
    };
    forEachSmall([&](const Block& block, const SignWords& part, std::uint32_t root) {
        Small& component = small[root];
        component.goesOn = regions.goesOn[root];
        component.deepest = std::max(component.deepest, deepestOf(block, part));
        if (component.points < enough) component.points += countData(block.at, part);
    });
    const float minDepth = isFromData() ? float(kMinFeatureDepth * mLattice.voxelSize) : 0.0f;
    const auto isIsland = [&](const Small& component) {
        return component.points < enough || component.deepest < minDepth;
    };
    // What goes on beyond the zone may be large, or hold data there.
    const auto isTurned = [&](const Small& component) {
        return isIsland(component) && !component.goesOn;
    };
    forEachSmall([&](Block& block, const SignWords& part, std::uint32_t root) {
        if (isTurned(small[root])) turn(block, part);
    });
    forEachSmall([&](const Block& block, const SignWords&, std::uint32_t root) {
        mIsCertain &= !(small[root].goesOn && isIsland(small[root]) && isWanted(block.at));
    });
    return std::size_t(std::count_if(small.begin(), small.end(),
                                     [&](const auto& c) { return isTurned(c.second); }));
}

/// Number of data points in the cubes of a block's voxels and up to half a voxel beside them:
/// points in a plane of voxels, all of one sign, are as near to the other side.
std::size_t Band::countData(const Vec3i& block, const SignWords& voxels) const
{
    const double h = mLattice.voxelSize;
    std::size_t count = 0;
    for (int row = 0; row < kBlockDim * kBlockDim; ++row) {
        const auto bits =
            unsigned(voxels[std::size_t(row / kBlockDim)] >> (8 * (row % kBlockDim))) & 0xffu;
        for (int z = 0; z < kBlockDim;) {
            if (!(bits >> z & 1u)) {
                ++z;
                continue;
            }
            const int first = z;
            while (z < kBlockDim && (bits >> z & 1u)) ++z;
            const Vec3i at = block * kBlockDim + Vec3i(row / kBlockDim, row % kBlockDim, first);
            /// Voxels from a center. [derived: half a voxel, half a voxel beside, and rounding]
            constexpr double kReach = 1.01;
            const Vec3d center = at.cast<double>(), last = center + Vec3d(0, 0, z - 1 - first);
            const Box3d around(center - Vec3d::Constant(kReach), last + Vec3d::Constant(kReach));
            count += mField.countData(
                {mLattice.origin + h * around.min(), mLattice.origin + h * around.max()},
                kMinObjectPoints);
        }
    }
    return count;
}

/// Largest depth of @a voxels in their side, world units.
float Band::deepestOf(const Block& block, const SignWords& voxels) const
{
    if (!block.leaf) return mBackground;
    const float* const values = block.leaf->buffer().data();
    float deepest = 0;
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::uint64_t rest = voxels[x]; rest; rest &= rest - 1)
            deepest =
                std::max(deepest, std::abs(values[x * 64 + std::size_t(__builtin_ctzll(rest))]));
    return deepest;
}

bool Band::isFromData() const
{
    const Vec3d nowhere = Vec3d::Constant(std::numeric_limits<double>::max());
    return mField.countData({nowhere, nowhere}, 1) == 0;
}

void Band::turn(Block& block, const SignWords& voxels)
{
    ensureLeaf(block);
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        for (std::uint64_t rest = voxels[x]; rest; rest &= rest - 1) {
            float& v = block.leaf->buffer().data()[x * 64 + std::size_t(__builtin_ctzll(rest))];
            v = v != 0 ? -v : -kRounding * mBackground; // -0 would be outside
        }
        block.inside[x] ^= voxels[x];
    }
}

} // namespace mpuvdb
