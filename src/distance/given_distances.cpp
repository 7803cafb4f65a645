// Level sets from other programs whose values become distances.
#include "core/quantile.h"
#include "grid/band_limits.h"
#include "grid/leaf_words.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

const Coord kSteps[3] = {Coord(1, 0, 0), Coord(0, 1, 0), Coord(0, 0, 1)};

/// Append the lengths of the gradient in the active voxels of @a leaf beside the zero set. Each
/// axis counts with its steeper side, so that the middle of a thin wall is as steep as its sides.
void addSlopes(const FloatLeaf& leaf, FloatGrid::ConstAccessor& at, double voxelSize,
               std::vector<float>& slopes)
{
    for (auto on = leaf.cbeginValueOn(); on; ++on) {
        const Coord voxel = on.getCoord();
        bool crossed = false, whole = true;
        double square = 0;
        for (const Coord& step : kSteps) {
            double steepest = -1;
            for (const Coord& beside : {voxel - step, voxel + step}) {
                float value = 0;
                if (!at.probeValue(beside, value)) continue;
                crossed |= (value < 0) != (*on < 0);
                steepest = std::max(steepest, std::abs(double(value) - double(*on)) / voxelSize);
            }
            whole &= steepest >= 0;
            square += steepest * steepest;
        }
        if (crossed && whole) slopes.push_back(float(std::sqrt(square)));
    }
}

/// The median slope beside the zero set; 1 where there is none.
double medianSlope(const LevelSet& levelSet, const Interrupter& progress)
{
    std::vector<const FloatLeaf*> leaves;
    levelSet.grid().tree().getNodes(leaves);
    std::vector<std::vector<float>> found(leaves.size());
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        progress.check();
        FloatGrid::ConstAccessor at = levelSet.grid().getConstAccessor();
        addSlopes(*leaves[n], at, levelSet.voxelSize(), found[n]);
    });
    std::vector<float> slopes;
    for (const std::vector<float>& part : found)
        slopes.insert(slopes.end(), part.begin(), part.end());
    return slopes.empty() ? 1 : double(quantile(slopes, 0.5));
}

/// The half-width, voxels, for values of @a slope: that of the background, if it is not more than
/// that of the voxels that are there, but at least the usual one.
double widthFor(const LevelSet& levelSet, double slope)
{
    constexpr double kUsualHalfWidth = 3; ///< voxels [derived: the default of all operations]
    const double there = levelSet.halfWidth() / slope;
    return std::clamp(levelSet.halfWidth(), kUsualHalfWidth,
                      std::clamp(there, kUsualHalfWidth, kMaxHalfWidth));
}

} // namespace

LevelSet distancesFromGrid(const FloatGrid::ConstPtr& grid, const std::string& cure,
                           std::vector<std::string>& notes, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    LevelSet given = levelSetFromGrid(grid, notes, &progress);
    const std::string missing = requireBand(given, cure, &progress);
    if (hasSlopesOfDistances(given, &progress)) {
        if (!missing.empty()) notes.push_back(fmt::format("{}. {}", missing, cure));
        return given;
    }
    const double slope = medianSlope(given, progress), width = widthFor(given, slope);
    notes.push_back(fmt::format("grid '{}': its values are not distances in world units: beside "
                                "the surface they change by {:.3g} per unit, where a distance "
                                "changes by 1. They were measured anew from the surface where "
                                "they are 0, in a band of {:.4g} voxels",
                                grid->getName(), slope, width));
    return redistance(given.grid(), width, &progress);
}

} // namespace mpuvdb
