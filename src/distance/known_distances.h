// The closest patches of a leaf's voxels, and the distances to them.
#pragma once
#include "leaf_distances.h"
#include "surface/surface_patch.h"
#include <mpuvdb/field.h>

#include <array>

namespace mpuvdb
{

/// The closest patches found so far, for the voxels of a leaf that is not settled.
struct ClosestPatches {
    std::array<std::uint32_t, kBlockVoxels> patch;
    std::array<float, kBlockVoxels> distance2; ///< to the patch's foot, squared; beyond reach: more
    std::array<std::uint64_t, kBlockDim> pending = {}; ///< voxels with updates not yet propagated
    std::array<std::uint64_t, kBlockDim> negative;

    bool isNegative(int n) const { return negative[std::size_t(n >> 6)] >> (n & 63) & 1u; }
    /// Set a nearer patch of voxel @a n.
    void set(int n, std::uint32_t nearer, float itsDistance2)
    {
        patch[std::size_t(n)] = nearer;
        distance2[std::size_t(n)] = itsDistance2;
        pending[std::size_t(n >> 6)] |= std::uint64_t(1) << (n & 63);
    }
    static openvdb::Coord coordOf(int voxel)
    {
        return {voxel / (kBlockDim * kBlockDim), voxel / kBlockDim % kBlockDim, voxel % kBlockDim};
    }
};

/// The distances of a leaf's voxels to their closest patches.
class KnownDistances final : public LeafDistances
{
public:
    KnownDistances(const SurfacePatches& surface, const openvdb::Coord& origin,
                   const ClosestPatches& known)
        : mSurface(surface), mOrigin(origin), mKnown(known)
    {
    }

    float at(int voxel) const override;
    float atMost(int voxel) const override;
    std::uint32_t patch(int voxel) const override { return mKnown.patch[std::size_t(voxel)]; }

private:
    class Nearest;
    float distanceToPatch(std::uint32_t patch, const openvdb::Coord& at, float side) const;
    float distanceToFacets(int voxel, float side) const;
    void offerFan(std::uint32_t vertex, Nearest& nearest) const;

    const SurfacePatches& mSurface;
    openvdb::Coord mOrigin;
    const ClosestPatches& mKnown;
};

} // namespace mpuvdb
