// Finds patches by their voxels.
#pragma once
#include "surface_patches.h"

#include <array>
#include <unordered_map>

namespace mpuvdb
{

/// The numbers of patches, by leaf and voxel.
class PatchIndex
{
public:
    explicit PatchIndex(const SurfacePatches& patches)
    {
        for (std::size_t n = 0; n < patches.leaves.size(); ++n) {
            if (patches.first[n] == patches.first[n + 1]) continue;
            Entry& entry = mEntries[patches.leaves[n]->origin()];
            entry.first = patches.first[n];
            for (std::uint32_t m = patches.first[n]; m < patches.first[n + 1]; ++m) {
                const auto voxel = Leaf::coordToOffset(patches.patches[m].voxel);
                entry.voxels[voxel >> 6] |= std::uint64_t(1) << (voxel & 63);
            }
            for (std::size_t word = 1; word < kDim; ++word)
                entry.before[word] = std::uint16_t(entry.before[word - 1] +
                                                   __builtin_popcountll(entry.voxels[word - 1]));
        }
    }

private:
    friend class PatchesAround;
    using Leaf = SurfacePatches::Leaf;
    static constexpr int kDim = 8;

    struct Entry {
        std::uint32_t first; ///< of its patches
        std::array<std::uint64_t, kDim> voxels = {};
        std::array<std::uint16_t, kDim> before = {}; ///< patches in the words before
    };
    struct HashCoord {
        std::size_t operator()(const openvdb::Coord& c) const { return c.hash<20>(); }
    };
    std::unordered_map<openvdb::Coord, Entry, HashCoord> mEntries;
};

/// Looks into the index about voxels that follow each other leaf by leaf. For one thread.
class PatchesAround
{
public:
    explicit PatchesAround(const PatchIndex& index) : mIndex(index) {}

    /// Call f(number) for the patches of the voxels up to @a reach (at most 8) from @a voxel.
    template <typename F>
    void forEach(const openvdb::Coord& voxel, int reach, F f)
    {
        moveTo(voxel & ~(kDim - 1));
        for (int x = -reach; x <= reach; ++x)
            for (int y = -reach; y <= reach; ++y)
                for (int z = -reach; z <= reach; ++z) {
                    const openvdb::Coord at = voxel.offsetBy(x, y, z);
                    const openvdb::Coord side = (at - mHome) >> 3;
                    const PatchIndex::Entry* const entry =
                        mLeaves[std::size_t(side[0] * 9 + side[1] * 3 + side[2] + 13)];
                    if (!entry) continue;
                    const auto n = PatchIndex::Leaf::coordToOffset(at);
                    const std::uint64_t word = entry->voxels[n >> 6];
                    const std::uint64_t bit = std::uint64_t(1) << (n & 63);
                    if (!(word & bit)) continue;
                    f(entry->first + entry->before[n >> 6] +
                      std::uint32_t(__builtin_popcountll(word & (bit - 1))));
                }
    }

private:
    static constexpr int kDim = PatchIndex::kDim;

    void moveTo(const openvdb::Coord& home)
    {
        if (mAnywhere && home == mHome) return;
        mAnywhere = true;
        mHome = home;
        for (int n = 0; n < 27; ++n) {
            const openvdb::Coord side(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            const auto found = mIndex.mEntries.find(
                home + openvdb::Coord(side[0] * kDim, side[1] * kDim, side[2] * kDim));
            mLeaves[std::size_t(n)] = found == mIndex.mEntries.end() ? nullptr : &found->second;
        }
    }

    const PatchIndex& mIndex;
    bool mAnywhere = false;
    openvdb::Coord mHome;
    std::array<const PatchIndex::Entry*, 27> mLeaves;
};

} // namespace mpuvdb
