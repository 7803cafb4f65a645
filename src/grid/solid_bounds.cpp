#include "solid_bounds.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <cmath>
#include <vector>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;

/// The box of a solid by the distances of voxels. A ball of that radius about a voxel inside lies
/// in the solid, and one about a voxel outside touches it. So along each axis the solid reaches at
/// least as far as a voxel's coordinate less its value, and just as far where the voxel's nearest
/// place on the surface is the farthest one and lies along the axis.
class Extent
{
public:
    void add(const Leaf& leaf, const Lattice& lattice)
    {
        for (auto voxel = leaf.cbeginValueOn(); voxel; ++voxel) {
            const openvdb::Coord at = voxel.getCoord();
            const Vec3d place = lattice.origin + lattice.voxelSize * Vec3d(at.x(), at.y(), at.z());
            const auto value = double(*voxel);
            mLow = mLow.cwiseMin(Vec3d(place.array() + value));
            mHigh = mHigh.cwiseMax(Vec3d(place.array() - value));
        }
    }
    void add(const Extent& other)
    {
        mLow = mLow.cwiseMin(other.mLow);
        mHigh = mHigh.cwiseMax(other.mHigh);
    }
    /// The part of it in @a box: values that are no distances may reach farther.
    Box3d within(const Box3d& box) const { return Box3d(mLow, mHigh).intersection(box); }

private:
    Vec3d mLow = Vec3d::Constant(HUGE_VAL), mHigh = Vec3d::Constant(-HUGE_VAL);
};

} // namespace

Box3d solidBounds(const LevelSet& levelSet)
{
    const Box3d box = levelSet.bounds();
    if (box.isEmpty()) return box;
    const Lattice lattice = levelSet.lattice();
    std::vector<const Leaf*> leaves;
    levelSet.grid().tree().getNodes(leaves);
    constexpr std::size_t kLeaves = 64; // of a task [free: grain size]
    const Extent all = tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, leaves.size(), kLeaves), Extent(),
        [&](const auto& range, Extent extent) {
            for (std::size_t n = range.begin(); n < range.end(); ++n)
                extent.add(*leaves[n], lattice);
            return extent;
        },
        [](Extent a, const Extent& b) {
            a.add(b);
            return a;
        });
    return all.within(box);
}

} // namespace mpuvdb
