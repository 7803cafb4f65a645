// Samples an octree's blended fits block by block.
#pragma once
#include "block_kernel.h"
#include "leaf_finder.h"
#include "mpu/fill/coarse_sign.h"
#include "mpu/octree/octree.h"
#include <mpuvdb/field.h>

#include <vector>

namespace mpuvdb
{

class MpuBlockSampler final : public BlockSampler
{
public:
    /// @param coarse  the field where data support no fit; null if the tree is complete.
    /// @param origin  of the lattice, local coordinates. @param band  world units.
    MpuBlockSampler(const Octree& tree, const CoarseSign* coarse, const Vec3d& origin,
                    double voxelSize, double band);
    void evaluate(const Vec3i& block, BlockValues& values) override;

private:
    void gatherCell(const LeafAt& leaf, const Vec3d& blockOrigin);
    CubeSet cubesToSum(const Box3d& box, BlockValues& values);
    /// @param maxDistance  largest distance of the coarse field in this block, voxels.
    void blendCoarse(CubeSet cubes, const Vec3d& blockOrigin, float maxDistance,
                     BlockValues& values) const;

    const Octree& mTree;
    const CoarseSign* mCoarse;
    Vec3d mOrigin;
    double mVoxelSize;
    float mLimit;      ///< voxels
    float mMaxCoarse;  ///< largest distance of the coarse field within its bounds, voxels
    float mMaxBlended; ///< limit of values blended with the coarse field, voxels
    LeafFinder mLeaves;
    KernelCells mCells; ///< cells that reach into the block
    BlockSums mSums;
};

} // namespace mpuvdb
