#include "dense.h"

#include "arrays.h"
#include "run.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// z fastest, as numpy's C order has it.
using Dense = openvdb::tools::Dense<float, openvdb::tools::LayoutZYX>;
using Values = py::detail::unchecked_reference<float, 3>;

void demandBlock(const py::array_t<float>& values, const Vec3d& origin, double voxelSize)
{
    if (values.ndim() != 3)
        throw UsageError(
            fmt::format("values: an array of {} dimensions; it must have 3", values.ndim()));
    if (!(voxelSize > 0) || !std::isfinite(voxelSize) || !origin.allFinite())
        throw UsageError(
            fmt::format("voxel size {}: it must be above 0, and the origin finite", voxelSize));
}

/// Call @a use(place, value) for all voxels, which have to be finite, and outside at the border.
template <typename IsInside, typename Use>
void forEachVoxel(const Values& values, const Interrupter& progress, IsInside isInside, Use use)
{
    const auto nx = values.shape(0), ny = values.shape(1), nz = values.shape(2);
    for (py::ssize_t x = 0; x < nx; ++x)
        for (py::ssize_t y = 0; y < ny; ++y) {
            progress.check();
            for (py::ssize_t z = 0; z < nz; ++z) {
                const float value = values(x, y, z);
                if (!std::isfinite(value))
                    throw InputError(
                        fmt::format("values: that of voxel ({}, {}, {}) is not finite", x, y, z));
                const bool border =
                    x == 0 || y == 0 || z == 0 || x == nx - 1 || y == ny - 1 || z == nz - 1;
                if (border && isInside(value))
                    throw InputError(fmt::format("values: the solid meets the array's border at "
                                                 "voxel ({}, {}, {}). Pad the array",
                                                 x, y, z));
                use(openvdb::Coord(int(x), int(y), int(z)), value);
            }
        }
}

/// The magnitude, world units, below which values are those of a band of @a halfWidth voxels: @a
/// width, unless nearly everywhere @a values change by more across the surface than distances do.
float bandOf(const Values& values, float width, double halfWidth, const Interrupter& progress)
{
    // The part of the faces across the surface that tells. [derived: requireBand() allows for holes
    // at the others]
    constexpr double kFaces = 0.9;
    // The least half-width and the usual one, voxels. [derived: those of all operations; distances
    // change by one voxel at most]
    constexpr double kLeastHalfWidth = 1.5, kUsualHalfWidth = 3;
    float largest = 0;
    std::vector<float> steps; // across the surface
    const auto compare = [&](float v, float other) {
        if ((v < 0) != (other < 0)) steps.push_back(std::abs(v - other));
    };
    forEachVoxel(
        values, progress, [](float v) { return v <= 0; },
        [&](const openvdb::Coord& at, float v) {
            const py::ssize_t x = at.x(), y = at.y(), z = at.z();
            largest = std::max(largest, std::abs(v));
            if (x > 0) compare(v, values(x - 1, y, z));
            if (y > 0) compare(v, values(x, y - 1, z));
            if (z > 0) compare(v, values(x, y, z - 1));
        });
    if (steps.empty()) return width;
    const auto step = steps.begin() + std::ptrdiff_t(kFaces * double(steps.size() - 1));
    std::nth_element(steps.begin(), step, steps.end());
    const double voxelSize = double(width) / halfWidth;
    if (double(*step) <= kLeastHalfWidth * voxelSize) return width;
    // A step is as wide as a voxel.
    const double steep = std::max(halfWidth, kUsualHalfWidth) * double(*step);
    return std::max(width, std::min(float(steep), largest));
}

/// The values of @a grid, some rows at a time.
void fill(Dense& dense, const openvdb::FloatGrid& grid, const Interrupter& progress)
{
    using Rows = tbb::blocked_range2d<int>;
    constexpr int kAtOnce = 32;
    const openvdb::CoordBBox box = dense.bbox();
    const openvdb::Coord low = box.min(), high = box.max();
    const openvdb::tools::CopyToDense<openvdb::FloatTree, Dense> copy(grid.tree(), dense);
    tbb::parallel_for(
        Rows(low.x(), high.x() + 1, kAtOnce, low.y(), high.y() + 1, kAtOnce),
        [&](const Rows& rows) {
            progress.check();
            copy(openvdb::CoordBBox(rows.rows().begin(), rows.cols().begin(), low.z(),
                                    rows.rows().end() - 1, rows.cols().end() - 1, high.z()));
        },
        tbb::simple_partitioner());
}

} // namespace

py::tuple denseOf(const LevelSet& levelSet)
{
    const openvdb::FloatGrid& grid = levelSet.grid();
    openvdb::CoordBBox box;
    if (!grid.tree().evalActiveVoxelBoundingBox(box)) // empty
        box = openvdb::CoordBBox(openvdb::Coord(0), openvdb::Coord(0));
    const openvdb::Coord size = box.dim(), first = box.min();
    py::array_t<float> values(std::vector<py::ssize_t>{size.x(), size.y(), size.z()});
    Dense dense(box, values.mutable_data());
    runWork(py::none(), [&](const Interrupter& progress) { fill(dense, grid, progress); });
    const Lattice lattice = levelSet.lattice();
    const Vec3d index(first.x(), first.y(), first.z());
    return py::make_tuple(values, arrayOf(lattice.origin + lattice.voxelSize * index));
}

LevelSet levelSetOf(const py::array_t<float>& values, const Vec3d& origin, double voxelSize,
                    double halfWidth, const Interrupter& progress)
{
    demandBlock(values, origin, voxelSize);
    const LevelSet nothing = emptyLevelSet({origin, voxelSize}, halfWidth);
    const openvdb::FloatGrid::Ptr grid = nothing.grid().deepCopy();
    const Values in = values.unchecked<3>();
    const float background = bandOf(in, grid->background(), halfWidth, progress);
    grid->setTree(std::make_shared<openvdb::FloatTree>(background));
    openvdb::tree::ValueAccessor<openvdb::FloatTree> accessor(grid->tree());
    bool isInside = false, isWithin = false; // some values below 0, and some of these in the band
    forEachVoxel(
        in, progress, [](float) { return false; },
        [&](const openvdb::Coord& at, float v) {
            isInside = isInside || v < 0;
            if (!(std::abs(v) < background)) return;
            isWithin = isWithin || v < 0;
            accessor.setValue(at, v);
        });
    if (isInside && !isWithin)
        throw InputError(
            fmt::format("values: none below 0 is nearer to 0 than {:.4g}, the width "
                        "of the band: they are no distances. Give signed distances, world "
                        "units, or make a level set by isosurface()",
                        background));
    openvdb::tools::signedFloodFill(grid->tree());
    openvdb::tools::pruneLevelSet(grid->tree());
    return LevelSet(grid);
}

openvdb::FloatGrid::Ptr gridOf(const py::array_t<float>& values, const Vec3d& origin,
                               double voxelSize, double value, Inside inside,
                               const Interrupter& progress)
{
    demandBlock(values, origin, voxelSize);
    const bool above = inside == Inside::Above;
    const Values in = values.unchecked<3>();
    openvdb::FloatGrid::Ptr grid = emptyLevelSet({origin, voxelSize}, 3).grid().deepCopy();
    grid->setName("values");
    grid->setGridClass(openvdb::GRID_UNKNOWN);
    auto outermost = float(value);
    forEachVoxel(
        in, progress, [&](float v) { return above ? v > value : v < value; },
        [&](const openvdb::Coord&, float v) {
            outermost = above ? std::min(outermost, v) : std::max(outermost, v);
        });
    grid->setTree(std::make_shared<openvdb::FloatTree>(outermost));
    openvdb::tree::ValueAccessor<openvdb::FloatTree> accessor(grid->tree());
    forEachVoxel(
        in, progress, [](float) { return false; },
        [&](const openvdb::Coord& at, float v) {
            if (v != outermost) accessor.setValue(at, v);
        });
    return grid;
}

} // namespace mpuvdb::python
