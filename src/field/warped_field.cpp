// Fields moved and deformed.
#include "point_field.h"
#include <mpuvdb/error.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using WarpPtr = std::shared_ptr<const Warp>;

class AffineWarp final : public Warp
{
public:
    /// @throws UsageError for a motion that has no inverse or is not finite.
    static std::shared_ptr<const AffineWarp> of(const Eigen::Affine3d& motion);
    explicit AffineWarp(const Eigen::Affine3d& motion) : mMotion(motion), mInverse(motion.inverse())
    {
        const Eigen::JacobiSVD<Eigen::Matrix3d> svd(motion.linear());
        mStretch = 1 / svd.singularValues()[2];
        mLeast = 1 / svd.singularValues()[0];
    }
    Vec3d inverse(const Vec3d& p) const override { return mInverse * p; }
    Box3d image(const Box3d& box) const override
    {
        if (!isFinite(box)) return wholeSpace();
        const Vec3d center = mMotion * Vec3d(box.center());
        const Vec3d half = mMotion.linear().cwiseAbs() * (box.sizes() / 2);
        return Box3d(center - half, center + half);
    }
    double stretch(const Box3d& /*image*/) const override { return mStretch; }
    WarpPtr after(const Warp& first) const override
    {
        const auto* const motion = dynamic_cast<const AffineWarp*>(&first);
        return motion ? of(mMotion * motion->mMotion) : nullptr;
    }
    bool keepsRatios() const { return mStretch - mLeast <= 1e-9 * mStretch; }
    const Eigen::Affine3d& motion() const { return mMotion; }

private:
    Eigen::Affine3d mMotion, mInverse;
    double mStretch = 1, mLeast = 1; ///< of the inverse
};

std::shared_ptr<const AffineWarp> AffineWarp::of(const Eigen::Affine3d& motion)
{
    /// Smallest to largest singular value of a motion with an inverse. [derived: seven digits of
    /// the inverse are left]
    constexpr double kMinSingularRatio = 1e-9;
    if (!motion.matrix().allFinite())
        throw UsageError("motion: it is not finite. Give finite numbers");
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(motion.linear());
    if (!(svd.singularValues()[2] > kMinSingularRatio * svd.singularValues()[0]))
        throw UsageError("motion: it has no inverse, as it flattens everything. Scale by numbers "
                         "other than 0");
    return std::make_shared<AffineWarp>(motion);
}

/// A set of blocks, with a fast test whether a ball of any size meets any of their cubes.
class BlockSet
{
public:
    BlockSet(const Lattice& lattice, std::vector<Vec3i> blocks)
        : mOrigin(lattice.origin - Vec3d::Constant(lattice.voxelSize / 2)),
          mEdge(kBlockDim * lattice.voxelSize)
    {
        while (!blocks.empty()) {
            mLevels.emplace_back();
            for (const Vec3i& b : blocks) mLevels.back().insert(key(b));
            if (blocks.size() == 1 || mLevels.size() == 32) break;
            for (Vec3i& b : blocks) b = Vec3i(b[0] >> 1, b[1] >> 1, b[2] >> 1);
            sortBlocks(blocks);
        }
    }

    bool meets(const Vec3d& center, double radius) const
    {
        if (mLevels.empty()) return false;
        // At most three cubes of the level along the ball's diameter.
        const double ratio = std::max(radius / mEdge, 1.0);
        const auto level = std::size_t(std::ceil(std::log2(std::min(ratio, 1e15))));
        if (level >= mLevels.size()) return true;
        const double edge = std::ldexp(mEdge, int(level));
        const Eigen::Array3d low = ((center - mOrigin).array() - radius) / edge;
        const Eigen::Array3d high = ((center - mOrigin).array() + radius) / edge;
        if (!(low.abs() < kMaxIndex).all() || !(high.abs() < kMaxIndex).all()) return true;
        const Vec3i first = low.floor().cast<int>(), last = high.floor().cast<int>();
        for (int x = first[0]; x <= last[0]; ++x)
            for (int y = first[1]; y <= last[1]; ++y)
                for (int z = first[2]; z <= last[2]; ++z)
                    if (mLevels[level].count(key(Vec3i(x, y, z)))) return true;
        return false;
    }

private:
    /// Largest index of a cube. [derived: an int, with room]
    static constexpr double kMaxIndex = 1 << 30;

    /// Key of a block whose voxels have ints for indices, or of its parents.
    static std::uint64_t key(const Vec3i& b)
    {
        const auto bits = [](int v) { return std::uint64_t(v) & 0x1fffff; };
        return bits(b[0]) | bits(b[1]) << 21 | bits(b[2]) << 42;
    }

    Vec3d mOrigin;
    double mEdge;
    std::vector<std::unordered_set<std::uint64_t>> mLevels;
};

/// A warp of a chain.
struct Step {
    WarpPtr warp;
    Box3d before; ///< bounds of what it warps
};

/// Bounds and steepness of a deformed field.
struct Extent {
    Box3d bounds;
    double steepness = 0;
};

/// The extent of @a source deformed by a chain of warps, over cubes that fill the source's bounds:
/// smaller cubes give tighter bounds.
Extent measured(const Source& source, const std::vector<Step>& steps)
{
    constexpr double kCubesPerSide = 24; ///< cubes along the longest side [tuned: warp_test]
    const Box3d box = source.field().bounds();
    Extent result;
    if (box.isEmpty()) return result;
    const double edge = std::max(box.sizes().maxCoeff() / kCubesPerSide, 1e-300);
    const Vec3i count = (box.sizes() / edge).array().ceil().max(1.0).min(kCubesPerSide).cast<int>();
    const Vec3d size = box.sizes().cwiseQuotient(count.cast<double>());
    for (int x = 0; x < count[0]; ++x)
        for (int y = 0; y < count[1]; ++y)
            for (int z = 0; z < count[2]; ++z) {
                const Vec3d low = box.min() + size.cwiseProduct(Vec3d(x, y, z));
                const Box3d cube(low, low + size);
                Box3d image = cube;
                double stretch = 1;
                for (const Step& step : steps) {
                    image = step.warp->image(image);
                    stretch *= step.warp->stretch(image);
                }
                result.bounds.extend(image);
                const Vec3d center = cube.center();
                if (!(std::abs(source.bound(center)) > source.change(center, size.norm() / 2)))
                    result.steepness = std::max(result.steepness, stretch);
            }
    if (!(result.steepness > 0)) result.steepness = 1; // there is no zero set
    result.steepness *= source.field().steepness();
    return result;
}

/// scale * field(inverse(p)), where the inverse is that of a chain of warps.
class WarpedField final : public PointField
{
public:
    /// @param scale  factor of the values; other than 1 for similarities.
    WarpedField(Source source, std::vector<Step> steps, const Extent& extent, double scale,
                bool isDistance)
        : mSource(std::move(source)), mSteps(std::move(steps)), mBounds(extent.bounds),
          mSteepness(scale * extent.steepness), mScale(scale), mIsDistance(isDistance),
          mStep(isFinite(mBounds) ? kRelativeStep * mBounds.diagonal().norm() : 1e-3)
    {
    }

    const FieldPtr& source() const { return mSource.pointer(); }
    double scale() const { return mScale; }
    const std::vector<Step>& steps() const { return mSteps; }
    Box3d bounds() const override { return mBounds; }
    FieldSample evaluate(const Vec3d& p) const override { return sample(p, mSource.field()); }
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override
    {
        return std::make_unique<MadeEvaluator<WarpedField>>(*this, mSource.field(), spacing);
    }
    template <typename Evaluator>
    FieldSample sample(const Vec3d& p, Evaluator& source) const
    {
        FieldSample result = source.evaluate(inverse(p));
        Eigen::Matrix3d jacobian;
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3d by = mStep * Vec3d::Unit(axis);
            jacobian.col(axis) = (inverse(p + by) - inverse(p - by)) / (2 * mStep);
        }
        result.value *= mScale;
        result.gradient = mScale * (jacobian.transpose() * result.gradient);
        return result;
    }
    double value(const Vec3d& p) const override { return mScale * mSource.value(inverse(p)); }
    double bound(const Vec3d& p) const override { return mScale * mSource.bound(inverse(p)); }
    void values(const std::vector<Vec3d>& points, std::vector<double>& values) const override
    {
        std::vector<Vec3d> from = points, to;
        for (auto step = mSteps.rbegin(); step != mSteps.rend(); ++step) {
            to.swap(from);
            step->warp->inverses(to, from);
        }
        mSource.values(from, values);
        for (double& value : values) value *= mScale;
    }
    bool inBatches() const override
    {
        return mSource.inBatches() || std::any_of(mSteps.begin(), mSteps.end(), [](const Step& s) {
                   return s.warp->inBatches();
               });
    }
    double change(const Vec3d& center, double radius) const override
    {
        const Ball from = inverse(Ball{center, radius});
        return mScale * mSource.change(from.center, from.radius);
    }
    bool isDistance() const override { return mIsDistance; }
    bool isDistanceFar() const override { return mIsDistance && mSource.field().isDistanceFar(); }
    double steepness() const override { return mSteepness; }
    std::size_t countData(const Box3d& box, std::size_t limit) const override
    {
        const Ball from = inverse(Ball{box.center(), box.diagonal().norm() / 2});
        if (!std::isfinite(from.radius)) return limit;
        return mSource.field().countData(about(from), limit);
    }

    /// A source that is a distance only near its zero set has seeds of its own: the blocks that
    /// these are moved to.
    std::vector<Vec3i> seedsWithin(const Lattice& lattice, const Box3d& box) const override
    {
        if (mSource.points() || mSource.field().bounds().isEmpty())
            return PointField::seedsWithin(lattice, box);
        const Lattice from{mSource.field().bounds().min(),
                           lattice.voxelSize * mSteepness / mSource.field().steepness() / mScale};
        const BlockSet seeds(from, mSource.field().seedBlocks(from));
        return descendBlocks(lattice, box, [&](const Vec3d& center, double radius) {
            const Ball from = inverse(Ball{center, radius});
            return seeds.meets(from.center, from.radius);
        });
    }

private:
    struct Ball {
        Vec3d center;
        double radius;
    };
    static Box3d about(const Ball& ball)
    {
        return Box3d(ball.center - Vec3d::Constant(ball.radius),
                     ball.center + Vec3d::Constant(ball.radius));
    }
    Vec3d inverse(const Vec3d& p) const
    {
        Vec3d from = p;
        for (auto step = mSteps.rbegin(); step != mSteps.rend(); ++step)
            from = step->warp->inverse(from);
        return from;
    }
    /// A ball that holds the inverse of a ball, or all of the source: the stretch over a large ball
    /// may have no end, as that of a twist, which grows with the distance from its axis.
    Ball inverse(Ball ball) const
    {
        for (auto step = mSteps.rbegin(); step != mSteps.rend(); ++step) {
            const Vec3d from = step->warp->inverse(ball.center);
            if (ball.radius > 0) {
                const Box3d& box = step->before;
                const double whole =
                    (from - box.min()).cwiseAbs().cwiseMax((from - box.max()).cwiseAbs()).norm();
                const double stretched = ball.radius * step->warp->stretch(about(ball));
                ball.radius = stretched < whole ? stretched : whole;
            }
            ball.center = from;
        }
        return ball;
    }

    Source mSource;
    std::vector<Step> mSteps; ///< in the order in which they are applied
    Box3d mBounds;
    double mSteepness, mScale;
    bool mIsDistance;
    double mStep; ///< of central differences, world units
};

/// A field scaled and translated, whose lattices are lattices of the field itself.
class ShiftedField final : public Field
{
public:
    ShiftedField(FieldPtr field, double scale, const Vec3d& translation)
        : mField(std::move(field)), mScale(scale), mTranslation(translation)
    {
    }

    const FieldPtr& source() const { return mField; }
    Eigen::Affine3d motion() const
    {
        return Eigen::Translation3d(mTranslation) * Eigen::Affine3d(Eigen::Scaling(mScale));
    }
    Box3d bounds() const override
    {
        const Box3d box = mField->bounds();
        return box.isEmpty()
                   ? box
                   : Box3d(mScale * box.min() + mTranslation, mScale * box.max() + mTranslation);
    }
    FieldSample evaluate(const Vec3d& p) const override { return sample(p, *mField); }
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override
    {
        return std::make_unique<MadeEvaluator<ShiftedField>>(*this, *mField, spacing);
    }
    template <typename Evaluator>
    FieldSample sample(const Vec3d& p, Evaluator& source) const
    {
        FieldSample result = source.evaluate(from(p));
        result.value *= mScale;
        return result;
    }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        return mField->seedBlocks(from(lattice));
    }
    std::size_t countData(const Box3d& box, std::size_t limit) const override
    {
        return mField->countData(Box3d(from(box.min()), from(box.max())), limit);
    }
    bool isDistance() const override { return mField->isDistance(); }
    bool isDistanceFar() const override { return mField->isDistanceFar(); }
    double steepness() const override { return mField->steepness(); }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        return std::make_unique<Sampler>(mField->sampler(from(lattice), band / mScale),
                                         float(mScale), float(band));
    }

private:
    class Sampler final : public BlockSampler
    {
    public:
        Sampler(std::unique_ptr<BlockSampler> field, float scale, float band)
            : mField(std::move(field)), mScale(scale), mBand(band)
        {
        }
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            mField->evaluate(block, values);
            for (float& v : values) v = std::clamp(v * mScale, -mBand, mBand);
        }

    private:
        std::unique_ptr<BlockSampler> mField;
        float mScale, mBand;
    };

    Vec3d from(const Vec3d& p) const { return (p - mTranslation) / mScale; }
    Lattice from(const Lattice& lattice) const
    {
        return {from(lattice.origin), lattice.voxelSize / mScale};
    }

    FieldPtr mField;
    double mScale;
    Vec3d mTranslation;
};

/// @a field deformed by @a warp: no distance. A chain of warps is one field, and warps of one kind
/// are one warp: bounds of bounds would grow with each.
/// @param scale  factor of the values.
FieldPtr deformed(FieldPtr field, WarpPtr warp, double scale)
{
    const std::vector<Step> last{{std::move(warp), field->bounds()}};
    std::vector<Step> steps = last;
    Extent extent = measured(Source(field), last);
    if (const auto* const warped = dynamic_cast<const WarpedField*>(field.get())) {
        steps = warped->steps();
        if (const WarpPtr both = last.front().warp->after(*steps.back().warp))
            steps.back().warp = both;
        else
            steps.push_back(last.front());
        // Of both ways to bounds the tighter: cubes grow on their way through a long chain.
        const FieldPtr origin = warped->source();
        const Extent whole = measured(Source(origin), steps);
        extent.bounds = extent.bounds.intersection(whole.bounds);
        extent.steepness = std::min(extent.steepness / warped->scale(), whole.steepness);
        scale *= warped->scale();
        field = origin;
    }
    if (!std::isfinite(extent.steepness))
        throw UsageError("warp: it presses a part of the solid into a point or a line: the solid "
                         "reaches as far as the center of a bend. Bend it less, or to the other "
                         "side");
    return std::make_shared<WarpedField>(Source(std::move(field)), std::move(steps), extent, scale,
                                         false);
}

} // namespace

FieldPtr makeMovedField(FieldPtr field, const Eigen::Affine3d& motion)
{
    const auto warp = AffineWarp::of(motion);
    if (const auto* const shifted = dynamic_cast<const ShiftedField*>(field.get()))
        return makeMovedField(shifted->source(), motion * shifted->motion());
    const double stretch = warp->stretch({});
    const bool similar = warp->keepsRatios();
    const double scale = similar ? 1 / stretch : 1;
    if (const auto* const warped = dynamic_cast<const WarpedField*>(field.get())) {
        // One motion after the other is one motion: a scale and the scale back leave distances.
        const auto* const first =
            dynamic_cast<const AffineWarp*>(warped->steps().front().warp.get());
        return first && warped->steps().size() == 1
                   ? makeMovedField(warped->source(), motion * first->motion())
                   : deformed(std::move(field), warp, scale);
    }
    Source source(field);
    if (const double factor = motion.linear()(0, 0);
        !source.points() && factor > 0 && motion.linear() == factor * Eigen::Matrix3d::Identity())
        return std::make_shared<ShiftedField>(std::move(field), factor, motion.translation());
    const Box3d box = field->bounds();
    const Extent extent{box.isEmpty() ? Box3d() : warp->image(box), stretch * field->steepness()};
    return std::make_shared<WarpedField>(std::move(source), std::vector<Step>{{warp, box}}, extent,
                                         scale, similar && field->isDistance());
}

FieldPtr makeWarpedField(FieldPtr field, std::shared_ptr<const Warp> warp)
{
    const Box3d box = field->bounds();
    if (!box.isEmpty() && !isFinite(box))
        throw UsageError("warp: the solid has no bounds. Intersect it with a box first");
    return deformed(std::move(field), std::move(warp), 1);
}

} // namespace mpuvdb
