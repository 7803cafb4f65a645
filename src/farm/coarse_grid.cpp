#include "coarse_grid.h"

#include "files/atomic_file.h"
#include "grid/transform_lattice.h"
#include "io/vdb/leaf_files.h"
#include "quiet.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::FloatGrid;
using Leaf = openvdb::FloatTree::LeafNodeType;

/// Half-width, voxels. [derived: the default of level sets]
constexpr double kHalfWidth = 3;
/// The same of the values that are taken from the finer grid. [derived: above sqrt(3), the distance
/// of a crossed cell's corners]
constexpr double kCrossingWidth = 2;
/// Voxels of the coarser grid about a part. [derived: a leaf, in which the band's distances end]
constexpr int kCoarseBeside = kBlockDim;
/// Voxels of the finer grid about these. [derived: a leaf: the wider band, and its stencil]
constexpr int kFineBeside = kBlockDim;
/// Voxels beside a part that check() looks at. [derived: its own stencil; the cut's are farther]
constexpr int kChecked = 2;
/// How far from a part, in voxels of the coarser grid, the surface changes no voxel that is looked
/// at. [derived: half the band, and a cell that is crossed]
constexpr int kReach = kChecked + int(kHalfWidth) + 1;

/// The finer voxels of @a box.
CoordBBox finer(const CoordBBox& box)
{
    const auto times = [](const Coord& at, int plus) {
        return Coord(kCoarsening * (at[0] + plus), kCoarsening * (at[1] + plus),
                     kCoarsening * (at[2] + plus));
    };
    return {times(box.min(), 0), times(box.max(), 1).offsetBy(-1)};
}

/// Every second value of @a at on each axis, in the block from @a origin on; null where the surface
/// is not near. @param isInside  says then on which side the block is.
std::unique_ptr<Leaf> blockOf(const FloatGrid::ConstAccessor& at, const Coord& origin,
                              float background, bool& isInside)
{
    const auto fineOf = [](const Coord& voxel) {
        return Coord(kCoarsening * voxel[0], kCoarsening * voxel[1], kCoarsening * voxel[2]);
    };
    // Between leaves are tiles, each of one sign.
    const Coord first = fineOf(origin);
    isInside = at.getValue(first) < 0;
    bool hasLeaf = false;
    for (int n = 0; n < 8 && !hasLeaf; ++n) {
        const Coord corner =
            first.offsetBy(kBlockDim * (n >> 2), kBlockDim * (n >> 1 & 1), kBlockDim * (n & 1));
        hasLeaf = at.probeConstLeaf(corner) || (at.getValue(corner) < 0) != isInside;
    }
    if (!hasLeaf) return nullptr;
    auto leaf = std::make_unique<Leaf>(origin, background);
    for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
        const float value = at.getValue(fineOf(leaf->offsetToGlobalCoord(n)));
        if (std::abs(value) < background)
            leaf->setValueOn(n, value);
        else
            leaf->setValueOnly(n, std::copysign(background, value));
    }
    isInside = leaf->getFirstValue() < 0;
    if (leaf->isEmpty()) leaf.reset();
    return leaf;
}

/// Every second value of @a fine on each axis, in @a box (coarse voxels) and as far as the surface
/// is near.
FloatGrid::Ptr everySecond(const FloatGrid& fine, const CoordBBox& box, Interrupter& progress)
{
    const float background = float(kCrossingWidth * kCoarsening * fine.voxelSize()[0]);
    const Coord blocks(box.dim()[0] / kBlockDim, box.dim()[1] / kBlockDim,
                       box.dim()[2] / kBlockDim);
    struct Row {
        std::vector<std::unique_ptr<Leaf>> leaves;
        std::vector<Coord> inside; ///< blocks without a leaf
    };
    std::vector<Row> rows(std::size_t(blocks[0]) * std::size_t(blocks[1]));
    tbb::parallel_for(0, blocks[0] * blocks[1], [&](int row) {
        progress.check();
        const FloatGrid::ConstAccessor at = fine.getConstAccessor();
        Row& made = rows[std::size_t(row)];
        for (int k = 0; k < blocks[2]; ++k) {
            const Coord origin = box.min().offsetBy(kBlockDim * (row / blocks[1]),
                                                    kBlockDim * (row % blocks[1]), kBlockDim * k);
            bool isInside = false;
            if (auto leaf = blockOf(at, origin, background, isInside))
                made.leaves.push_back(std::move(leaf));
            else if (isInside)
                made.inside.push_back(origin);
        }
    });
    const FloatGrid::Ptr grid = FloatGrid::create(background);
    for (Row& row : rows) {
        for (std::unique_ptr<Leaf>& leaf : row.leaves) grid->tree().addLeaf(leaf.release());
        for (const Coord& origin : row.inside) grid->tree().addTile(1, origin, -background, false);
    }
    return grid;
}

/// Whether the surface may pass between two voxels of @a grid in @a box: where it does, both are
/// active.
bool isCrossed(const FloatGrid& grid, const CoordBBox& box)
{
    bool isInside = false, isOutside = false;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf && !(isInside && isOutside); ++leaf) {
        if (!box.hasOverlap(leaf->getNodeBoundingBox())) continue;
        for (auto voxel = leaf->cbeginValueOn(); voxel; ++voxel)
            if (box.isInside(voxel.getCoord())) (*voxel < 0 ? isInside : isOutside) = true;
    }
    return isInside && isOutside;
}

/// The cubes of @a coarse that parts of @a fine are near to, sorted.
std::set<Coord> cubesNear(const PartedGrid& coarse, const PartedGrid& fine)
{
    std::set<Coord> cubes;
    for (const auto& [part, file] : fine.parts()) {
        const CoordBBox box = fine.boxOf(part); // of whole leaves
        const auto cubeOf = [&](const Coord& corner, int beside) {
            return coarse.cubeOf((corner >> 1).offsetBy(beside));
        };
        const Coord first = cubeOf(box.min(), -kReach), last = cubeOf(box.max(), kReach);
        for (auto cube = CoordBBox(first, last).begin(); cube; ++cube) cubes.insert(*cube);
    }
    return cubes;
}

/// The coarser level set of @a own (its voxels); null where there is no surface.
std::optional<LevelSet> coarserPart(const PartedGrid& fine, const std::string& prefix,
                                    const Lattice& lattice, const CoordBBox& own,
                                    Interrupter& progress)
{
    CoordBBox around = own;
    around.expand(kCoarseBeside);
    CoordBBox box = finer(around);
    box.expand(kFineBeside);
    const std::vector<ArrayFile> files = fine.filesIn(box);
    if (files.empty()) return std::nullopt;
    const auto part = openvdb::gridPtrCast<FloatGrid>(readLeaves(files, prefix, box, progress));
    CoordBBox near = own;
    near.expand(kReach);
    if (!isCrossed(*part, finer(near))) return std::nullopt;
    // Measured anew: whether its values are distances would be judged for each part by itself.
    const LevelSet wide = redistance(*part, kCrossingWidth * kCoarsening, &progress);
    const FloatGrid::Ptr values = everySecond(wide.grid(), around, progress);
    if (!isCrossed(*values, near)) return std::nullopt;
    setLattice(*values, lattice);
    values->setGridClass(openvdb::GRID_LEVEL_SET);
    values->setName(part->getName());
    return redistance(*values, kHalfWidth, &progress);
}

/// What check() says of all parts: their gradients count together, as a few voxels beside a corner
/// of the solid say nothing of a whole.
class PartsChecked
{
public:
    void add(const CheckReport& part)
    {
        for (const CheckFinding& fault : part.findings) mFaults.push_back(fault.what);
        mVoxels += double(part.activeVoxels);
        mGradientErrors += part.meanGradientError * double(part.activeVoxels);
    }
    std::vector<std::string> faults() const
    {
        std::vector<std::string> all = mFaults;
        const double n = std::max(mVoxels, 1.0), mean = mGradientErrors / n;
        if (mean > kGradientTolerance + 0.5 / std::sqrt(n)) // as in check()
            all.push_back(fmt::format("not a distance: ||grad| - 1| is {:.3g} on average", mean));
        return all;
    }

private:
    std::vector<std::string> mFaults;
    double mVoxels = 0, mGradientErrors = 0;
};

} // namespace

PartedGrid coarserGrid(const PartedGrid& fine, const std::string& prefix, int edge,
                       const fs::path& folder, std::vector<std::string>& faults,
                       Interrupter& progress)
{
    const double h = kCoarsening * fine.lattice().voxelSize;
    PartedGrid coarse({fine.lattice().origin, h}, edge);
    const std::set<Coord> cubes = cubesNear(coarse, fine);
    fs::create_directory(folder);
    progress.beginStage("coarse", double(cubes.size()));
    Quiet quiet(progress);
    PartsChecked found;
    for (const Coord& cube : cubes) {
        progress.advance();
        const CoordBBox own = coarse.boxOf(cube);
        const auto made = coarserPart(fine, prefix, coarse.lattice(), own, quiet);
        if (!made) continue;
        CoordBBox checked = own;
        checked.expand(kChecked);
        found.add(check(made->grid(), std::numeric_limits<double>::max(), checked, &quiet));
        const fs::path file = folder / fmt::format("{}_{}_{}.bin", cube[0], cube[1], cube[2]);
        writeAtomically(file, [&](const fs::path& temporary) {
            ArrayFileWriter arrays(temporary);
            saveLeaves(arrays, prefix, made->grid(), own, quiet);
            arrays.finish();
        });
        const ArrayFile written(file);
        if (hasLeaves(written, prefix)) coarse.add(cube, written);
    }
    for (const std::string& fault : found.faults())
        faults.push_back(fmt::format("voxels of {:g}: {}", h, fault));
    progress.endStage();
    return coarse;
}

} // namespace mpuvdb
