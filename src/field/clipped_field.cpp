#include "point_field.h"
#include <mpuvdb/error.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

class ClippedField final : public PointField
{
public:
    ClippedField(FieldPtr field, const Box3d& box) : mSource(std::move(field)), mBox(box) {}

    Box3d bounds() const override
    {
        const Box3d box = mSource.field().bounds().intersection(mBox);
        return box.isEmpty() ? Box3d() : box;
    }
    FieldSample evaluate(const Vec3d& p) const override { return sample(p, mSource.field()); }
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override
    {
        return std::make_unique<MadeEvaluator<ClippedField>>(*this, mSource.field(), spacing);
    }
    template <typename Evaluator>
    FieldSample sample(const Vec3d& p, Evaluator& source) const
    {
        const FieldSample inside = source.evaluate(p);
        const double wall = boxDistance(mBox, p);
        if (inside.value >= wall) return inside;
        return {wall, boxNormal(mBox, p), -1, true};
    }
    double value(const Vec3d& p) const override
    {
        return std::max(mSource.value(p), boxDistance(mBox, p));
    }
    void values(const std::vector<Vec3d>& points, std::vector<double>& values) const override
    {
        mSource.values(points, values);
        for (std::size_t i = 0; i < points.size(); ++i)
            values[i] = std::max(values[i], boxDistance(mBox, points[i]));
    }
    bool inBatches() const override { return mSource.inBatches(); }
    double bound(const Vec3d& p) const override
    {
        return std::max(mSource.bound(p), boxDistance(mBox, p));
    }
    double change(const Vec3d& center, double radius) const override
    {
        return std::max(mSource.change(center, radius), radius);
    }
    /// The value is less than the distance only outside the creases that clipping makes.
    bool isDistance() const override { return mSource.field().isDistance(); }
    bool isDistanceFar() const override { return mSource.field().isDistanceFar(); }
    double steepness() const override { return std::max(mSource.field().steepness(), 1.0); }
    std::size_t countData(const Box3d& box, std::size_t limit) const override
    {
        // The box's walls are real although no data lie on them.
        return mBox.contains(box) ? mSource.field().countData(box, limit) : limit;
    }

    /// Components of the zero set are the field's own, or meet the box's faces.
    std::vector<Vec3i> seedsWithin(const Lattice& lattice, const Box3d& box) const override
    {
        const Box3d common = box.intersection(mBox);
        if (common.isEmpty()) return {};
        std::vector<Vec3i> seeds = mSource.seedsWithin(lattice, common);
        const std::vector<Vec3i> walls =
            descendBlocks(lattice, common, [&](const Vec3d& center, double radius) {
                return std::abs(boxDistance(mBox, center)) <= radius &&
                       !(mSource.bound(center) > mSource.change(center, radius));
            });
        seeds.insert(seeds.end(), walls.begin(), walls.end());
        sortBlocks(seeds);
        return seeds;
    }

    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        return std::make_unique<Sampler>(mBox, mSource.field().sampler(lattice, band), lattice,
                                         band);
    }

private:
    class Sampler final : public BlockSampler
    {
    public:
        Sampler(const Box3d& box, std::unique_ptr<BlockSampler> field, const Lattice& lattice,
                double band)
            : mBox(box), mField(std::move(field)), mLattice(lattice), mBand(band)
        {
        }

        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            const Box3d cube = cubeOf(mLattice, block);
            const double wall = boxDistance(mBox, cube.center());
            const double radius = cube.diagonal().norm() / 2;
            if (wall > mBand + radius) {
                values.fill(float(mBand));
                return;
            }
            mField->evaluate(block, values);
            if (wall < -mBand - radius) return;
            for (int i = 0; i < kBlockVoxels; ++i) {
                const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
                const Vec3d p = mLattice.origin + mLattice.voxelSize * voxel.cast<double>();
                float& value = values[std::size_t(i)];
                value = std::max(value, float(boxDistance(mBox, p)));
            }
        }

    private:
        Box3d mBox;
        std::unique_ptr<BlockSampler> mField;
        Lattice mLattice;
        double mBand;
    };

    Source mSource;
    Box3d mBox;
};

} // namespace

FieldPtr makeClippedField(FieldPtr field, const Box3d& box)
{
    if (box.isEmpty() || !isFinite(box))
        throw UsageError("clip: the box is empty or not finite. Give its lower and upper corner");
    return std::make_shared<ClippedField>(std::move(field), box);
}

} // namespace mpuvdb
