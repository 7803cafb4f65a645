#include "smooth_filters.h"

#include <mpuvdb/interrupter.h>

#include <openvdb/math/Stencils.h>
#include <openvdb/tools/Filter.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using Leaf = FloatGrid::TreeType::LeafNodeType;
using LeafManager = openvdb::tree::LeafManager<openvdb::FloatTree>;

/// The number of means that make a Gaussian. [derived: as openvdb::tools::Filter::gaussian()]
constexpr int kMeansPerGaussian = 4;
/// The steps of curvature flow before the distance is restored. [tuned: filters_test]
constexpr int kFlowSteps = 4;
/// The half-width for these steps, in voxels. [derived: errors at the band's rim come a voxel
/// nearer with each step]
constexpr double kFlowHalfWidth = kFlowSteps + 2;

/// The largest difference, in widths, between the mean or median over a cube and its middle value.
/// [derived: the median distance of a cube's voxels to its middle, sqrt(2) at width one]
constexpr double kShiftPerWidth = 1.42;

/// The largest distance from the surface to the filtered zero set, voxels.
double reachOf(const SmoothSettings& settings)
{
    return kShiftPerWidth * settings.width + 1;
}

/// The share of the filtered value at a place, in [0,1].
class Mask
{
public:
    Mask(const FloatGrid::ConstPtr& mask, const openvdb::math::Transform& voxels)
        : mVoxels(voxels), mMask(mask), mAccess(mask ? mask->tree() : kNone)
    {
    }

    float operator()(const Coord& at)
    {
        if (!mMask) return 1;
        const openvdb::Vec3d there = mMask->worldToIndex(mVoxels.indexToWorld(at));
        const openvdb::Vec3d whole(std::round(there[0]), std::round(there[1]),
                                   std::round(there[2]));
        // The distance, in voxels, up to which places are voxels of the mask. [derived: rounding]
        constexpr double kSame = 1e-6;
        const float m = (there - whole).length() < kSame
                            ? mAccess.getValue(Coord::round(there))
                            : openvdb::tools::BoxSampler::sample(mAccess, there);
        return m > 0 ? std::min(m, 1.0f) : 0.0f;
    }

private:
    static inline const openvdb::FloatTree kNone{};

    const openvdb::math::Transform& mVoxels;
    FloatGrid::ConstPtr mMask;
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
};

/// Mixes the values of @a grid within @a reach (world units) with filtered ones, by the mask.
/// @param makeFiltered  makes a function that gives a voxel's filtered value, one for each leaf.
template <typename MakeFiltered>
void mix(FloatGrid& grid, const SmoothSettings& settings, float reach, Interrupter& progress,
         MakeFiltered makeFiltered)
{
    LeafManager leaves(grid.tree(), 1);
    leaves.foreach ([&](Leaf& leaf, std::size_t n) {
        Mask mask(settings.mask, grid.transform());
        auto filtered = makeFiltered();
        float* const next = leaves.getBuffer(n, 1).data();
        for (auto voxel = leaf.cbeginValueOn(); voxel; ++voxel) {
            if (!(std::abs(*voxel) <= reach)) continue;
            const float share = mask(voxel.getCoord());
            if (share == 0) continue;
            progress.check();
            next[voxel.pos()] = *voxel + share * (filtered(voxel) - *voxel);
        }
    });
    leaves.swapLeafBuffer(1);
}

FloatGrid::Ptr mean(const LevelSet& wide, const SmoothSettings& settings, Interrupter& progress)
{
    const FloatGrid::Ptr means = wide.grid().deepCopy(), grid = wide.grid().deepCopy();
    progress.check();
    openvdb::tools::Filter<FloatGrid, FloatGrid, Interrupter>(*means, &progress)
        .mean(settings.width);
    progress.check();
    mix(*grid, settings, float(reachOf(settings) * wide.voxelSize()), progress, [&] {
        return [access = means->getConstAccessor()](const Leaf::ValueOnCIter& voxel) {
            return access.getValue(voxel.getCoord());
        };
    });
    return grid;
}

FloatGrid::Ptr median(const LevelSet& wide, const SmoothSettings& settings, Interrupter& progress)
{
    const FloatGrid::Ptr grid = wide.grid().deepCopy();
    const int width = settings.width;
    mix(*grid, settings, float(reachOf(settings) * wide.voxelSize()), progress, [&] {
        return [access = wide.grid().getConstAccessor(), width,
                values = std::vector<float>()](const Leaf::ValueOnCIter& voxel) mutable {
            values.clear();
            const Coord at = voxel.getCoord();
            for (int x = -width; x <= width; ++x)
                for (int y = -width; y <= width; ++y)
                    for (int z = -width; z <= width; ++z)
                        values.push_back(access.getValue(at.offsetBy(x, y, z)));
            const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
            std::nth_element(values.begin(), middle, values.end());
            return *middle;
        };
    });
    return grid;
}

/// The flow by the sum of the principal curvatures, in forward steps of h^2 / 6, the longest stable
/// ones.
FloatGrid::Ptr flow(const LevelSet& wide, const SmoothSettings& settings, int steps,
                    Interrupter& progress)
{
    const FloatGrid::Ptr grid = wide.grid().deepCopy();
    const auto h = float(wide.voxelSize());
    for (int step = 0; step < steps; ++step)
        mix(*grid, settings, wide.grid().background(), progress, [&] {
            return [stencil = openvdb::math::CurvatureStencil<FloatGrid>(*grid, h),
                    h](const Leaf::ValueOnCIter& voxel) mutable {
                stencil.moveTo(voxel);
                return *voxel + h * h / 6 * 2 * stencil.meanCurvatureNormGrad();
            };
        });
    return grid;
}

} // namespace

int passesOf(const SmoothSettings& settings)
{
    return settings.iterations * (settings.filter == Filter::Gaussian ? kMeansPerGaussian : 1);
}

FilterPass nextPass(const SmoothSettings& settings, int done)
{
    if (settings.filter == Filter::MeanCurvature)
        return {kFlowHalfWidth, std::min(kFlowSteps, passesOf(settings) - done)};
    // The filter is exact up to a voxel from where the zero set may lie.
    return {reachOf(settings) + 1 + std::sqrt(3.0) * settings.width, 1};
}

FloatGrid::Ptr filter(const LevelSet& wide, const SmoothSettings& settings, const FilterPass& pass,
                      Interrupter& progress)
{
    switch (settings.filter) {
    case Filter::MeanCurvature:
        return flow(wide, settings, pass.steps, progress);
    case Filter::Median:
        return median(wide, settings, progress);
    case Filter::Mean:
    case Filter::Gaussian:
        break;
    }
    return mean(wide, settings, progress);
}

} // namespace mpuvdb
