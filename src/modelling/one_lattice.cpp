#include "one_lattice.h"

#include "grid/band_bytes.h"
#include "resample.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// The relative difference up to which voxel sizes are equal. [derived: they pass through files as
/// text or floats; lattices drift apart by a hundredth of a voxel over ten thousand]
constexpr double kSameSize = 1e-6;
/// The difference up to which origins are equal, voxels. [derived: as kSameSize, over a hundred]
constexpr double kSameOrigin = 1e-4;
/// The largest growth of the number of voxels. [derived: 8 x 8, where each voxel of a surface
/// becomes the face of a leaf, and the new lattice holds interpolation alone]
constexpr double kMaxGrowth = 64;

bool isSame(const Lattice& a, const Lattice& b)
{
    return std::abs(a.voxelSize - b.voxelSize) <= kSameSize * b.voxelSize &&
           (a.origin - b.origin).cwiseAbs().maxCoeff() <= kSameOrigin * b.voxelSize;
}

/// The first of the inputs with the smallest voxels, or with voxels of @a voxelSize > 0.
std::optional<std::size_t> findModel(const std::vector<LevelSet>& inputs, double voxelSize)
{
    std::optional<std::size_t> model;
    for (std::size_t n = 0; n < inputs.size(); ++n) {
        const double size = inputs[n].voxelSize();
        const bool isFiner = !model || size < inputs[*model].voxelSize() * (1 - kSameSize);
        const bool isWanted = !model && std::abs(size - voxelSize) <= kSameSize * voxelSize;
        if (voxelSize > 0 ? isWanted : isFiner) model = n;
    }
    return model;
}

Lattice latticeAbout(const std::vector<LevelSet>& inputs, double voxelSize)
{
    Box3d box;
    for (const LevelSet& input : inputs) box.extend(input.bounds());
    if (box.isEmpty()) box.extend(Vec3d(Vec3d::Zero()));
    return latticeFor(box, voxelSize);
}

void requireFewVoxels(const std::vector<LevelSet>& inputs, const Lattice& lattice)
{
    std::vector<Resampled> grids;
    grids.reserve(inputs.size());
    for (const LevelSet& input : inputs)
        grids.push_back({double(input.grid().activeVoxelCount()), input.voxelSize(),
                         lattice.voxelSize, input.halfWidth()});
    requireFewVoxels(grids);
}

} // namespace

void requireFewVoxels(const std::vector<Resampled>& grids)
{
    double now = 0, then = 0, bytes = 0, coarsest = 0, finest = 0;
    for (const Resampled& grid : grids) {
        const double times = grid.voxelSize / grid.to; // its square is that of a surface's voxels
        now += grid.voxels;
        then += grid.voxels * times * times;
        const double area = grid.voxels * grid.voxelSize * grid.voxelSize / (2 * grid.halfWidth);
        bytes += (1 + kResamplingGrids) * gridBytes(area, grid.to, grid.halfWidth);
        coarsest = std::max(coarsest, grid.voxelSize);
        if (!(finest > 0 && finest < grid.to)) finest = grid.to;
    }
    if (!(then > kMaxGrowth * now)) return;
    const double fitting = finest * std::sqrt(then / (kMaxGrowth * now));
    throw LimitError(fmt::format(
        "the grids' voxels are of {:g} to {:g}: on the finest lattice their {:.3g} million voxels "
        "become {:.3g} million, {:.0f} times as many, and about {:.3g} GB; more than {:g} times as "
        "many need a chosen voxel size. Choose the result's voxels (--voxel-size, in Python "
        "voxel_size): {:.2g} stays within that, {:g} makes them all",
        finest, coarsest, now / 1e6, then / 1e6, then / now, bytes / 1e9, kMaxGrowth,
        1.05 * fitting, finest));
}

OneLattice onOneLattice(const std::vector<LevelSet>& inputs, double voxelSize,
                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    OneLattice result;
    if (inputs.empty()) return result;
    result.model = findModel(inputs, voxelSize);
    const Lattice lattice =
        result.model ? inputs[*result.model].lattice() : latticeAbout(inputs, voxelSize);
    if (!(voxelSize > 0)) requireFewVoxels(inputs, lattice);
    for (std::size_t n = 0; n < inputs.size(); ++n) {
        const LevelSet& input = inputs[n];
        if (isSame(input.lattice(), lattice)) {
            result.levelSets.push_back(input);
            continue;
        }
        result.levelSets.push_back(resample(input, lattice, input.halfWidth(), &progress));
        result.resampled.push_back(n);
    }
    return result;
}

} // namespace mpuvdb
