#include "dense.h"

#include "arrays.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/SignedFloodFill.h>

#include <cmath>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// z fastest, as numpy's C order has it.
using Dense = openvdb::tools::Dense<float, openvdb::tools::LayoutZYX>;
using Values = py::detail::unchecked_reference<float, 3>;

/// Voxels nearer than @a background are active, with their values.
void fillBand(const Values& values, float background, openvdb::FloatTree& tree)
{
    const auto nx = values.shape(0), ny = values.shape(1), nz = values.shape(2);
    openvdb::tree::ValueAccessor<openvdb::FloatTree> accessor(tree);
    for (py::ssize_t x = 0; x < nx; ++x)
        for (py::ssize_t y = 0; y < ny; ++y)
            for (py::ssize_t z = 0; z < nz; ++z) {
                const float value = values(x, y, z);
                if (!std::isfinite(value))
                    throw InputError(
                        fmt::format("values: that of voxel ({}, {}, {}) is not finite", x, y, z));
                const bool border =
                    x == 0 || y == 0 || z == 0 || x == nx - 1 || y == ny - 1 || z == nz - 1;
                if (border && value <= 0)
                    throw InputError(fmt::format("values: the solid meets the array's border at "
                                                 "voxel ({}, {}, {}). Pad the array",
                                                 x, y, z));
                if (std::abs(value) < background)
                    accessor.setValue(openvdb::Coord(int(x), int(y), int(z)), value);
            }
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
    {
        const py::gil_scoped_release release;
        openvdb::tools::copyToDense(grid, dense);
    }
    const Lattice lattice = levelSet.lattice();
    const Vec3d index(first.x(), first.y(), first.z());
    return py::make_tuple(values, arrayOf(lattice.origin + lattice.voxelSize * index));
}

LevelSet levelSetOf(const py::array_t<float>& values, const Vec3d& origin, double voxelSize,
                    double halfWidth)
{
    if (values.ndim() != 3)
        throw UsageError(
            fmt::format("values: an array of {} dimensions; it must have 3", values.ndim()));
    if (!(voxelSize > 0) || !std::isfinite(voxelSize) || !origin.allFinite())
        throw UsageError(
            fmt::format("voxel size {}: it must be above 0, and the origin finite", voxelSize));
    const LevelSet nothing = emptyLevelSet({origin, voxelSize}, halfWidth);
    const openvdb::FloatGrid::Ptr grid = nothing.grid().deepCopy();
    const Values in = values.unchecked<3>();
    const py::gil_scoped_release release;
    fillBand(in, grid->background(), grid->tree());
    openvdb::tools::signedFloodFill(grid->tree());
    openvdb::tools::pruneLevelSet(grid->tree());
    return LevelSet(grid);
}

} // namespace mpuvdb::python
