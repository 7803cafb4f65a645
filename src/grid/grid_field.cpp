// A level set as a field. Cubic interpolation is several times closer to curved surfaces than
// linear or quadratic, and no worse at creases.
#include "field/point_field.h"
#include <mpuvdb/level_set.h>

#include <algorithm>
#include <cmath>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Accessor = openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>;

/// Distance from a voxel, voxels, below which a position is that voxel: its value stays the same to
/// the bit. [derived: roundings of positions with indices up to 2^32]
constexpr double kSameVoxel = 1e-6;

/// The four samples about a position along one axis, and their weights [Catmull74].
struct Stencil {
    int first; ///< the samples are first .. first + 3
    std::array<double, 4> weights, slopes;

    explicit Stencil(double position)
    {
        const double nearest = std::round(position);
        if (std::abs(position - nearest) < kSameVoxel) position = nearest;
        const double floor = std::floor(position), t = position - floor;
        first = int(floor) - 1;
        weights = {t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (-2.5 + 1.5 * t),
                   t * (0.5 + t * (2 - 1.5 * t)), t * t * (-0.5 + 0.5 * t)};
        slopes = {-0.5 + t * (2 - 1.5 * t), t * (-5 + 4.5 * t), 0.5 + t * (4 - 4.5 * t),
                  t * (-1 + 1.5 * t)};
    }
    /// @{ The value of four samples at the position, and its slope.
    double weighted(const std::array<float, 4>& samples) const { return sum(weights, samples); }
    double sloped(const std::array<float, 4>& samples) const { return sum(slopes, samples); }
    /// @}

private:
    static double sum(const std::array<double, 4>& w, const std::array<float, 4>& v)
    {
        return (w[0] * double(v[0]) + w[1] * double(v[1])) +
               (w[2] * double(v[2]) + w[3] * double(v[3]));
    }
};

/// The samples of four voxels along z.
std::array<float, 4> fourFrom(const Accessor& at, const Coord& first)
{
    std::array<float, 4> samples;
    if ((first[2] & (kBlockDim - 1)) > kBlockDim - 4) {
        for (int k = 0; k < 4; ++k) samples[std::size_t(k)] = at.getValue(first.offsetBy(0, 0, k));
    } else if (const auto* const leaf = at.probeConstLeaf(first)) {
        const float* const from =
            leaf->buffer().data() + openvdb::FloatTree::LeafNodeType::coordToOffset(first);
        std::copy_n(from, 4, samples.begin());
    } else {
        samples.fill(at.getValue(first));
    }
    return samples;
}

/// The samples that a block's voxels need along one axis, and how each combines four of them.
struct AxisPlan {
    std::vector<int> samples; ///< indices, ascending
    struct Row {
        std::array<std::size_t, 4> at; ///< in samples
        std::array<float, 4> weights;
    };
    std::array<Row, kBlockDim> rows;

    AxisPlan(double start, double step)
    {
        std::vector<Stencil> stencils;
        for (int i = 0; i < kBlockDim; ++i) {
            stencils.emplace_back(start + step * i);
            for (int k = 0; k < 4; ++k) samples.push_back(stencils.back().first + k);
        }
        std::sort(samples.begin(), samples.end());
        samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
        for (std::size_t i = 0; i < rows.size(); ++i)
            for (std::size_t k = 0; k < 4; ++k) {
                const int index = stencils[i].first + int(k);
                const auto found = std::lower_bound(samples.begin(), samples.end(), index);
                rows[i].at[k] = std::size_t(found - samples.begin());
                rows[i].weights[k] = float(stencils[i].weights[k]);
            }
    }
};

/// Interpolates along one axis after the other: both lattices have the same axes.
class GridSampler final : public BlockSampler
{
public:
    GridSampler(const openvdb::FloatGrid& grid, const Lattice& from, const Lattice& to)
        : mAccessor(grid.tree()), mStart((to.origin - from.origin) / from.voxelSize),
          mStep(to.voxelSize / from.voxelSize), mBackground(grid.background())
    {
    }

    void evaluate(const Vec3i& block, BlockValues& values) override
    {
        const Vec3d start = mStart + mStep * double(kBlockDim) * block.cast<double>();
        const AxisPlan x(start[0], mStep), y(start[1], mStep), z(start[2], mStep);
        if (!gather(x, y, z)) {
            values.fill(mSamples.front());
            return;
        }
        const std::size_t layer = y.samples.size() * z.samples.size();
        combine(x, 1, layer, mSamples.data(), mAlongX);
        combine(y, kBlockDim, z.samples.size(), mAlongX.data(), mAlongY);
        combine(z, kBlockDim * kBlockDim, 1, mAlongY.data(), mAlongZ);
        std::copy_n(mAlongZ.begin(), values.size(), values.begin());
    }

private:
    /// Read the samples; false if all are one background value.
    bool gather(const AxisPlan& x, const AxisPlan& y, const AxisPlan& z)
    {
        mSamples.clear();
        bool differ = false;
        for (const int i : x.samples)
            for (const int j : y.samples)
                for (const int k : z.samples) {
                    mSamples.push_back(mAccessor.getValue(Coord(i, j, k)));
                    differ |= mSamples.back() != mSamples.front();
                }
        return differ || std::abs(mSamples.front()) < mBackground;
    }

    /// Interpolate along the middle of three axes: @a outer groups of plan.samples times @a inner
    /// values.
    static void combine(const AxisPlan& plan, std::size_t outer, std::size_t inner,
                        const float* from, std::vector<float>& to)
    {
        to.resize(outer * kBlockDim * inner);
        float* out = to.data();
        for (std::size_t o = 0; o < outer; ++o, from += plan.samples.size() * inner)
            for (const AxisPlan::Row& row : plan.rows) {
                const float* const a = from + row.at[0] * inner;
                const float* const b = from + row.at[1] * inner;
                const float* const c = from + row.at[2] * inner;
                const float* const d = from + row.at[3] * inner;
                const auto& w = row.weights;
                for (std::size_t i = 0; i < inner; ++i)
                    *out++ = w[0] * a[i] + w[1] * b[i] + w[2] * c[i] + w[3] * d[i];
            }
    }

    Accessor mAccessor;
    Vec3d mStart;
    double mStep;
    float mBackground;
    std::vector<float> mSamples, mAlongX, mAlongY, mAlongZ;
};

class GridField final : public Field
{
public:
    explicit GridField(const LevelSet& levelSet)
        : mGrid(levelSet.gridPtr()), mLattice(levelSet.lattice())
    {
        const Coord one(1, 1, 1);
        for (auto leaf = mGrid->tree().cbeginLeaf(); leaf; ++leaf) {
            openvdb::CoordBBox inside;
            for (auto on = leaf->cbeginValueOn(); on; ++on)
                if (*on < 0) inside.expand(on.getCoord());
            if (inside.empty()) continue;
            mBounds.extend(world(inside.min() - one));
            mBounds.extend(world(inside.max() + one));
        }
    }

    Box3d bounds() const override { return mBounds; }

    FieldSample evaluate(const Vec3d& p) const override
    {
        const Accessor at(mGrid->tree());
        const Vec3d q = (p - mLattice.origin) / mLattice.voxelSize;
        FieldSample sample;
        sample.supported = true;
        if (!(q.cwiseAbs().maxCoeff() < kFarVoxel)) {
            sample.value = double(mGrid->background());
            return sample;
        }
        const Stencil x(q[0]), y(q[1]), z(q[2]);
        for (int i = 0; i < 4; ++i) {
            double value = 0, alongY = 0, alongZ = 0; // of the plane of samples, and its slopes
            for (int j = 0; j < 4; ++j) {
                const auto row = fourFrom(at, Coord(x.first + i, y.first + j, z.first));
                const double inRow = z.weighted(row);
                value += y.weights[std::size_t(j)] * inRow;
                alongY += y.slopes[std::size_t(j)] * inRow;
                alongZ += y.weights[std::size_t(j)] * z.sloped(row);
            }
            const double weight = x.weights[std::size_t(i)];
            sample.value += weight * value;
            sample.gradient +=
                Vec3d(x.slopes[std::size_t(i)] * value, weight * alongY, weight * alongZ);
        }
        sample.gradient /= mLattice.voxelSize;
        return sample;
    }

    /// Blocks in the cubes of leaves with active voxels, where the surface lies.
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        std::vector<const openvdb::FloatTree::LeafNodeType*> leaves;
        mGrid->tree().getNodes(leaves);
        std::vector<std::vector<Vec3i>> ofLeaves(leaves.size());
        tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
            if (leaves[n]->getValueMask().isOff()) return;
            const Accessor at(mGrid->tree());
            // The middle of a block is at most sqrt(3) / 2 voxels from a voxel, whose distance is
            // known.
            const double reach = 0.87 * mLattice.voxelSize;
            const double background = double(mGrid->background());
            const auto mayMeet = [&](const Vec3d& center, double radius) {
                const double distance = std::abs(double(at.getValue(voxelAt(center))));
                return distance >= background || distance <= radius + reach;
            };
            const Coord origin = leaves[n]->origin() >> 3;
            const Vec3i leaf(origin[0], origin[1], origin[2]);
            ofLeaves[n] = descendBlocks(lattice, cubeOf(mLattice, leaf), mayMeet);
        });
        std::vector<Vec3i> blocks;
        for (const auto& found : ofLeaves) blocks.insert(blocks.end(), found.begin(), found.end());
        sortBlocks(blocks);
        return blocks;
    }

    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double /*band*/) const override
    {
        return std::make_unique<GridSampler>(*mGrid, mLattice, lattice);
    }

private:
    /// Index from which on positions are outside. [derived: half of the range of int]
    static constexpr double kFarVoxel = 1 << 30;

    Vec3d world(const Coord& c) const
    {
        return mLattice.origin + mLattice.voxelSize * Vec3d(c[0], c[1], c[2]);
    }
    Coord voxelAt(const Vec3d& p) const
    {
        const Vec3d q = (p - mLattice.origin) / mLattice.voxelSize;
        if (!(q.cwiseAbs().maxCoeff() < kFarVoxel)) return Coord::max();
        return Coord(int(std::round(q[0])), int(std::round(q[1])), int(std::round(q[2])));
    }

    openvdb::FloatGrid::ConstPtr mGrid;
    Lattice mLattice;
    Box3d mBounds;
};

} // namespace

FieldPtr makeGridField(const LevelSet& levelSet)
{
    return std::make_shared<GridField>(levelSet);
}

} // namespace mpuvdb
