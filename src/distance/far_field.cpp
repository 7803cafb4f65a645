#include "far_field.h"

#include "patch_tree.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

Coord middleOf(const openvdb::FloatTree& tree)
{
    openvdb::CoordBBox box;
    tree.evalLeafBoundingBox(box);
    return Coord::round(box.getCenter());
}

class FarField final : public Field
{
public:
    FarField(const LevelSet& levelSet, double trusted, Interrupter& progress)
        : mNear(makeGridField(levelSet)), mLattice(levelSet.lattice()),
          mTrusted(trusted * mLattice.voxelSize),
          mPatches(surfacePatches(levelSet.grid().tree(), mLattice.voxelSize, Values::Distances,
                                  progress)),
          mOutside(mPatches, middleOf(levelSet.grid().tree()), 1, progress),
          mInside(mPatches, mOutside.frame(), -1, progress)
    {
    }

    Box3d bounds() const override { return mNear->bounds(); }
    bool isDistanceFar() const override { return true; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        FieldSample sample = mNear->evaluate(p);
        if (std::abs(sample.value) < mTrusted) return sample;
        Search search(*this, std::numeric_limits<double>::infinity());
        const bool inside = sample.value < 0;
        sample.value = search.distance(p, inside);
        const Vec3d away = p - search.place();
        sample.gradient = (inside ? -1 : 1) * away.normalized();
        return sample;
    }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        return mNear->seedBlocks(lattice);
    }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        return std::make_unique<Sampler>(*this, lattice, band);
    }

private:
    /// Finds distances at one place after the other. For one thread.
    class Search
    {
    public:
        /// @param most  world units, beyond which only signs are wanted.
        Search(const FarField& field, double most)
            : mField(field), mMost(float(most / field.mLattice.voxelSize))
        {
        }
        double distance(const Vec3d& p, bool inside)
        {
            const Coord& frame = mField.mOutside.frame();
            const Vec3d voxels = (p - mField.mLattice.origin) / mField.mLattice.voxelSize;
            const Vec3f at = (voxels - Vec3d(frame[0], frame[1], frame[2])).cast<float>();
            const PatchTree& tree = inside ? mField.mInside : mField.mOutside;
            // The foot that was nearest to the last place is at most so far from this one.
            const float known = mFoot ? (*mFoot - at).norm() + kSlack : mMost;
            PatchTree::Near near = tree.nearest(at, std::min(known, mMost));
            if (!near.isFound() && known < mMost) near = tree.nearest(at, mMost);
            const float found = near.isFound() ? near.distance : mMost;
            if (near.isFound()) mFoot = tree.footOf(near.patch);
            mPlace = near.place;
            return (inside ? -1 : 1) * double(found) * mField.mLattice.voxelSize;
        }
        /// The nearest place to that of the last distance, world units.
        Vec3d place() const
        {
            const Coord& frame = mField.mOutside.frame();
            const Vec3d voxels = mPlace.cast<double>() + Vec3d(frame[0], frame[1], frame[2]);
            return mField.mLattice.origin + mField.mLattice.voxelSize * voxels;
        }

    private:
        /// Voxels, for roundings. [free: time; where none is found, all are searched]
        static constexpr float kSlack = 0.01f;

        const FarField& mField;
        float mMost;
        std::optional<Vec3f> mFoot;
        Vec3f mPlace = Vec3f::Zero();
    };

    class Sampler final : public BlockSampler
    {
    public:
        Sampler(const FarField& field, const Lattice& lattice, double band)
            : mField(field), mLattice(lattice), mNear(field.mNear->sampler(lattice, band)),
              mSearch(field, std::max(band, field.mTrusted) + lattice.voxelSize)
        {
        }
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            mNear->evaluate(block, values);
            for (int i = 0; i < kBlockVoxels; ++i) {
                float& value = values[std::size_t(i)];
                if (std::abs(double(value)) < mField.mTrusted) continue;
                const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
                const Vec3d p = mLattice.origin + mLattice.voxelSize * voxel.cast<double>();
                value = float(mSearch.distance(p, value < 0));
            }
        }

    private:
        const FarField& mField;
        Lattice mLattice;
        std::unique_ptr<BlockSampler> mNear;
        Search mSearch;
    };

    FieldPtr mNear;
    Lattice mLattice;
    double mTrusted; ///< world units
    SurfacePatches mPatches;
    PatchTree mOutside, mInside;
};

} // namespace

FieldPtr makeFarField(const LevelSet& levelSet, double trusted, Interrupter& progress)
{
    return std::make_shared<FarField>(levelSet, trusted, progress);
}

} // namespace mpuvdb
