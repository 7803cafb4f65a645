#include "point_field.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <tuple>

namespace mpuvdb
{
namespace
{

constexpr double kMaxBlockIndex = 1 << 26; ///< largest index [derived: those of voxels are ints]
/// Most blocks of a field. [free: a limit of memory]
constexpr std::size_t kMaxBlocks = std::size_t(1) << 26;
const double kSqrt3 = std::sqrt(3.0);

/// Factor on the steepness of fields that are no PointField: far from their data values may be more
/// than the distance. [tuned: fields_test]
constexpr double kSteepnessFactor = 2;

class Descent
{
public:
    Descent(const Lattice& lattice, const BlockRange& range, const CubesTest& mayMeet)
        : mLattice(lattice), mRange(range), mMayMeet(mayMeet)
    {
    }

    std::vector<Vec3i> run()
    {
        const Vec3i size = mRange.high - mRange.low;
        int level = 0;
        while (size.maxCoeff() >> level > 0) ++level;
        mOpen.push_back({mRange.low, level});
        while (!mOpen.empty()) testSome();
        sortBlocks(mBlocks);
        return std::move(mBlocks);
    }

private:
    /// A cube of 8^level blocks, of which @a low is the first.
    struct Cube {
        Vec3i low;
        int level;
    };

    void testSome()
    {
        /// Cubes tested at once: a call for each of so many costs little. [free: time]
        constexpr std::size_t kBatch = 512;
        const auto first = mOpen.end() - std::ptrdiff_t(std::min(kBatch, mOpen.size()));
        mTested.assign(first, mOpen.end());
        mOpen.erase(first, mOpen.end());
        mBatch.centers.clear();
        mBatch.radii.clear();
        for (const Cube& cube : mTested) {
            const double half = 0.5 * kBlockDim * std::ldexp(1.0, cube.level); // voxels
            const Vec3d corner = double(kBlockDim) * cube.low.cast<double>() - Vec3d::Constant(0.5);
            mBatch.centers.emplace_back(mLattice.origin +
                                        mLattice.voxelSize * (corner + Vec3d::Constant(half)));
            mBatch.radii.push_back(kSqrt3 * half * mLattice.voxelSize);
        }
        mMeets.assign(mTested.size(), 0);
        mMayMeet(mBatch, mMeets);
        for (std::size_t n = 0; n < mTested.size(); ++n)
            if (mMeets[n]) descend(mTested[n]);
    }

    void descend(const Cube& cube)
    {
        if (cube.level == 0) {
            if (mBlocks.size() == kMaxBlocks)
                throw LimitError(fmt::format("the surface meets more than {} blocks of voxels of "
                                             "size {}: use larger voxels",
                                             kMaxBlocks, mLattice.voxelSize));
            mBlocks.push_back(cube.low);
            return;
        }
        const int step = 1 << (cube.level - 1);
        for (int octant = 0; octant < 8; ++octant) {
            const Vec3i low = cube.low + step * Vec3i(octant >> 2, octant >> 1 & 1, octant & 1);
            if ((low.array() <= mRange.high.array()).all()) mOpen.push_back({low, cube.level - 1});
        }
    }

    Lattice mLattice;
    BlockRange mRange;
    const CubesTest& mMayMeet;
    std::vector<Cube> mOpen, mTested;
    CubeBatch mBatch;
    std::vector<char> mMeets;
    std::vector<Vec3i> mBlocks;
};

/// Evaluates voxel by voxel, but for cubes of voxels that are beyond the band by a value at their
/// center.
class PointSampler final : public BlockSampler
{
public:
    PointSampler(const PointField& field, const Lattice& lattice, double band)
        : mField(field), mLattice(lattice), mBand(band)
    {
    }

    void evaluate(const Vec3i& block, BlockValues& values) override
    {
        fill(kBlockDim * block, Vec3i::Zero(), kBlockDim, values);
    }

private:
    void fill(const Vec3i& first, const Vec3i& low, int size, BlockValues& values) const
    {
        const double half = 0.5 * (size - 1); // voxels
        const Vec3d center = world((first + low).cast<double>() + Vec3d::Constant(half));
        const double bound = mField.bound(center);
        const double change = mField.change(center, kSqrt3 * half * mLattice.voxelSize);
        if (std::abs(bound) > mBand + change) {
            const auto far = float(std::copysign(mBand, bound));
            forEachVoxel(
                low, size, [&](const Vec3i&, float& value) { value = far; }, values);
            return;
        }
        /// Edge of the smallest cube tested, voxels. [free: time]
        constexpr int kMinCube = 4;
        if (size == kMinCube) {
            const auto take = [&](const Vec3i& voxel, float& value) {
                value = float(mField.value(world((first + voxel).cast<double>())));
            };
            forEachVoxel(low, size, take, values);
            return;
        }
        for (int octant = 0; octant < 8; ++octant)
            fill(first, low + size / 2 * Vec3i(octant >> 2, octant >> 1 & 1, octant & 1), size / 2,
                 values);
    }

    Vec3d world(const Vec3d& voxel) const { return mLattice.origin + mLattice.voxelSize * voxel; }

    template <class F>
    static void forEachVoxel(const Vec3i& low, int size, F&& f, BlockValues& values)
    {
        for (int x = low[0]; x < low[0] + size; ++x)
            for (int y = low[1]; y < low[1] + size; ++y)
                for (int z = low[2]; z < low[2] + size; ++z)
                    f(Vec3i(x, y, z), values[std::size_t((x * kBlockDim + y) * kBlockDim + z)]);
    }

    const PointField& mField;
    Lattice mLattice;
    double mBand;
};

/// Evaluates all voxels of a block at once.
class BatchSampler final : public BlockSampler
{
public:
    BatchSampler(const PointField& field, const Lattice& lattice, double band)
        : mField(field), mLattice(lattice), mBand(band), mPoints(kBlockVoxels)
    {
    }

    void evaluate(const Vec3i& block, BlockValues& values) override
    {
        for (int i = 0; i < kBlockVoxels; ++i) {
            const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
            mPoints[std::size_t(i)] = mLattice.origin + mLattice.voxelSize * voxel.cast<double>();
        }
        mField.values(mPoints, mValues);
        for (std::size_t i = 0; i < values.size(); ++i)
            values[i] = float(std::clamp(mValues[i], -mBand, mBand));
    }

private:
    const PointField& mField;
    Lattice mLattice;
    double mBand;
    std::vector<Vec3d> mPoints;
    std::vector<double> mValues;
};

} // namespace

void sortBlocks(std::vector<Vec3i>& blocks)
{
    std::sort(blocks.begin(), blocks.end(), [](const Vec3i& a, const Vec3i& b) {
        return std::make_tuple(a[0], a[1], a[2]) < std::make_tuple(b[0], b[1], b[2]);
    });
    blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
}

BlockRange blocksOf(const Lattice& lattice, const Box3d& box)
{
    const auto blockOf = [&](const Vec3d& p) {
        const Eigen::Array3d voxel = (p - lattice.origin).array() / lattice.voxelSize + 0.5;
        const Eigen::Array3d block = (voxel / kBlockDim).floor();
        if (!(block.abs() < kMaxBlockIndex).all())
            throw LimitError(fmt::format("voxels of size {} about a box that reaches to ({}, {}, "
                                         "{}) are beyond the index range: use larger voxels",
                                         lattice.voxelSize, p[0], p[1], p[2]));
        return Vec3i(block.cast<int>().matrix());
    };
    return {blockOf(box.min()), blockOf(box.max())};
}

Box3d cubeOf(const Lattice& lattice, const Vec3i& block)
{
    const Vec3d corner = double(kBlockDim) * block.cast<double>() - Vec3d::Constant(0.5);
    const Vec3d low = lattice.origin + lattice.voxelSize * corner;
    return Box3d(low, low + Vec3d::Constant(kBlockDim * lattice.voxelSize));
}

std::vector<Vec3i> descendBlocks(const Lattice& lattice, const Box3d& box, const CubeTest& mayMeet)
{
    return descendBlocksInBatches(lattice, box,
                                  [&](const CubeBatch& cubes, std::vector<char>& meets) {
                                      for (std::size_t n = 0; n < meets.size(); ++n)
                                          meets[n] = mayMeet(cubes.centers[n], cubes.radii[n]);
                                  });
}

std::vector<Vec3i> descendBlocksInBatches(const Lattice& lattice, const Box3d& box,
                                          const CubesTest& mayMeet)
{
    if (box.isEmpty()) return {};
    return Descent(lattice, blocksOf(lattice, box), mayMeet).run();
}

double boxDistance(const Box3d& box, const Vec3d& p)
{
    const Vec3d q = (box.min() - p).cwiseMax(p - box.max());
    return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
}

Vec3d boxNormal(const Box3d& box, const Vec3d& p)
{
    const Vec3d low = box.min() - p, high = p - box.max();
    const Vec3d q = low.cwiseMax(high);
    Vec3d out = q.cwiseMax(0);
    if (!(out.squaredNorm() > 0)) {
        Eigen::Index axis = 0;
        q.maxCoeff(&axis);
        out = Vec3d::Unit(axis);
    }
    for (int k = 0; k < 3; ++k)
        if (low[k] > high[k]) out[k] = -out[k];
    return out.normalized();
}

Box3d wholeSpace()
{
    const Vec3d far = Vec3d::Constant(std::numeric_limits<double>::infinity());
    return Box3d(-far, far);
}

std::vector<Vec3i> PointField::seedsWithin(const Lattice& lattice, const Box3d& box) const
{
    const auto mayMeet = [&](const CubeBatch& cubes, std::vector<char>& meets) {
        std::vector<double> bounds;
        if (inBatches())
            values(cubes.centers, bounds);
        else
            for (const Vec3d& center : cubes.centers) bounds.push_back(bound(center));
        for (std::size_t n = 0; n < meets.size(); ++n)
            meets[n] = !(std::abs(bounds[n]) > change(cubes.centers[n], cubes.radii[n]));
    };
    return descendBlocksInBatches(lattice, box, mayMeet);
}

std::vector<Vec3i> PointField::seedBlocks(const Lattice& lattice) const
{
    const Box3d box = bounds();
    if (!box.isEmpty() && !isFinite(box))
        throw UsageError("the solid has no bounds: intersect it with a box or another solid "
                         "that has");
    return seedsWithin(lattice, box);
}

std::unique_ptr<BlockSampler> PointField::sampler(const Lattice& lattice, double band) const
{
    if (inBatches()) return std::make_unique<BatchSampler>(*this, lattice, band);
    return std::make_unique<PointSampler>(*this, lattice, band);
}

void PointField::values(const std::vector<Vec3d>& points, std::vector<double>& values) const
{
    values.clear();
    for (const Vec3d& p : points) values.push_back(value(p));
}

Vec3d PointField::slope(const Vec3d& p, double step) const
{
    Vec3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3d by = step * Vec3d::Unit(axis);
        gradient[axis] = (value(p + by) - value(p - by)) / (2 * step);
    }
    return gradient;
}

Source::Source(FieldPtr field)
    : mField(std::move(field)), mPoints(dynamic_cast<const PointField*>(mField.get()))
{
}

double Source::value(const Vec3d& p) const
{
    return mPoints ? mPoints->value(p) : mField->evaluate(p).value;
}

void Source::values(const std::vector<Vec3d>& points, std::vector<double>& values) const
{
    if (mPoints) return mPoints->values(points, values);
    values.clear();
    for (const Vec3d& p : points) values.push_back(mField->evaluate(p).value);
}

double Source::bound(const Vec3d& p) const
{
    return mPoints ? mPoints->bound(p) : mField->evaluate(p).value;
}

double Source::change(const Vec3d& center, double radius) const
{
    return mPoints ? mPoints->change(center, radius)
                   : kSteepnessFactor * mField->steepness() * radius;
}

std::vector<Vec3i> Source::seedsWithin(const Lattice& lattice, const Box3d& box) const
{
    if (mPoints) return mPoints->seedsWithin(lattice, box);
    std::vector<Vec3i> blocks = mField->seedBlocks(lattice);
    const auto apart = [&](const Vec3i& b) { return !cubeOf(lattice, b).intersects(box); };
    blocks.erase(std::remove_if(blocks.begin(), blocks.end(), apart), blocks.end());
    return blocks;
}

} // namespace mpuvdb
