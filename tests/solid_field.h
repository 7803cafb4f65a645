// A solid as a field: what a level set of exact distances must come out as.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/scan_sampler.h>

#include <cmath>

namespace mpuvdb
{

class SolidField final : public Field
{
public:
    explicit SolidField(std::shared_ptr<const Solid> solid) : mSolid(std::move(solid)) {}

    Box3d bounds() const override { return mSolid->bounds(); }

    FieldSample evaluate(const Vec3d& position) const override
    {
        return {mSolid->distance(position), mSolid->normal(position), 0, true};
    }

    /// All blocks that the surface may meet, by the distance at their centres.
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        const double edge = kBlockDim * lattice.voxelSize;
        const Vec3d toCenter = Vec3d::Constant((kBlockDim - 1) / 2.0 * lattice.voxelSize);
        const double reach = std::sqrt(3.0) / 2 * edge;
        const auto blockOf = [&](const Vec3d& p) {
            return Vec3i(((p - lattice.origin) / edge).array().floor().cast<int>());
        };
        const Vec3i low = blockOf(bounds().min()), high = blockOf(bounds().max());
        std::vector<Vec3i> blocks;
        for (int x = low.x(); x <= high.x(); ++x)
            for (int y = low.y(); y <= high.y(); ++y)
                for (int z = low.z(); z <= high.z(); ++z) {
                    const Vec3d corner = lattice.origin + edge * Vec3d(x, y, z);
                    if (std::abs(mSolid->distance(corner + toCenter)) <= reach)
                        blocks.emplace_back(x, y, z);
                }
        return blocks;
    }

    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double) const override
    {
        return std::make_unique<Sampler>(*mSolid, lattice);
    }

private:
    class Sampler final : public BlockSampler
    {
    public:
        Sampler(const Solid& solid, const Lattice& lattice) : mSolid(solid), mLattice(lattice) {}
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            for (int i = 0; i < kBlockVoxels; ++i) {
                const Vec3i voxel =
                    kBlockDim * block +
                    Vec3i(i / (kBlockDim * kBlockDim), i / kBlockDim % kBlockDim, i % kBlockDim);
                const Vec3d p = mLattice.origin + mLattice.voxelSize * voxel.cast<double>();
                values[i] = float(mSolid.distance(p));
            }
        }

    private:
        const Solid& mSolid;
        Lattice mLattice;
    };

    std::shared_ptr<const Solid> mSolid;
};

} // namespace mpuvdb
