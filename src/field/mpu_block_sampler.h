// Samples an octree's blended fits block by block.
#pragma once
#include "block_kernel.h"
#include "coarse_sign.h"
#include "octree.h"

#include <mpuvdb/field.h>

#include <vector>

namespace mpuvdb
{

class MpuBlockSampler final : public BlockSampler
{
public:
    /// @param coarse  rules where data support nothing; null if the tree is complete.
    /// @param origin  of the lattice, local coordinates. @param band  world units.
    MpuBlockSampler(const Octree& tree, const CoarseSign* coarse, const Vec3d& origin,
                    double voxelSize, double band);
    void evaluate(const Vec3i& block, BlockValues& values) override;

private:
    struct NodeAt {
        std::uint32_t node;
        OctreeCell cell;
    };
    void gatherRegion(const Vec3i& region);
    /// Octree::descend() from a node, if that reaches into @a box.
    template <typename Visit>
    void descend(const NodeAt& at, const Box3d& box, const Visit& visit) const;
    void addLeaf(const NodeAt& leaf, const Vec3d& blockOrigin);

    void blendCoarse(const Vec3d& blockOrigin, BlockValues& values) const;

    const Octree& mTree;
    const CoarseSign* mCoarse;
    Vec3d mOrigin;
    double mVoxelSize;
    float mLimit;    ///< voxels
    float mFarthest; ///< what counts of a value that is blended with the coarse field, voxels
    void (*mAddCell)(const KernelCell&, BlockSums&);
    Vec3i mRegion;
    bool mHasRegion = false;
    std::vector<NodeAt> mRegionNodes; ///< cells that reach into the region, none finer than it
    BlockSums mSums;
    bool mSupported = true; ///< every cell of the block
};

} // namespace mpuvdb
