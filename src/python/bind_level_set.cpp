// Level sets: what they are, and where they come from and go to.
#include "arguments.h"
#include "arrays.h"
#include "bindings.h"
#include "dense.h"
#include "pyopenvdb.h"
#include "run.h"

#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/io.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>

#include <algorithm>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

/// A level set made elsewhere, if its values may be distances; what was mended becomes a note.
LevelSet taken(const openvdb::FloatGrid::ConstPtr& grid, Interrupter& progress)
{
    std::vector<std::string> notes;
    LevelSet levelSet = distancesFromGrid(
        grid, "Make distances: LevelSet.isosurface(source, 0, inside='below')", notes, &progress);
    for (const std::string& text : notes) progress.note(text);
    return levelSet;
}

void bindProperties(LevelSetClass& levelSets)
{
    levelSets
        .def_property_readonly("voxel_size", &LevelSet::voxelSize, "Edge of a voxel, world units.")
        .def_property_readonly("half_width", &LevelSet::halfWidth,
                               "Width of the band on either side of the surface, voxels.")
        .def_property_readonly(
            "origin", [](const LevelSet& s) { return arrayOf(s.lattice().origin); },
            "World position (3,) of the center of voxel (0, 0, 0).")
        .def_property_readonly(
            "active_voxels", [](const LevelSet& s) { return s.grid().activeVoxelCount(); },
            "Number of voxels in the band.")
        .def_property_readonly(
            "memory", [](const LevelSet& s) { return s.grid().memUsage(); }, "Bytes it takes.")
        .def_property_readonly(
            "explained",
            [](const LevelSet& s) -> py::object {
                if (!s.explained()) return py::none();
                return std::visit([](const auto& e) { return py::cast(e); }, s.explained()->by);
            },
            "How it compares with the points or the mesh it was made of: PointsExplained or "
            "MeshExplained; None for what operations make and files hold.")
        .def("__repr__", [](const LevelSet& s) {
            return fmt::format("<mpuvdb.LevelSet: voxel size {:.6g}, half-width {:.3g}, {} active "
                               "voxels>",
                               s.voxelSize(), s.halfWidth(), s.grid().activeVoxelCount());
        });
}

void bindFiles(LevelSetClass& levelSets)
{
    levelSets
        .def_static(
            "read",
            [](const std::filesystem::path& file, const std::optional<std::string>& grid) {
                return run(py::none(), [&](Interrupter& p) {
                    return readLevelSet(file, grid.value_or(""), 0, Validation::Distances, &p);
                });
            },
            "file"_a, "grid"_a = py::none(),
            "Read the level set called grid from a .vdb file; None: 'surface', or the only one.\n\n"
            "A background that promises more than the band holds, and values that check() does not "
            "take for distances, are mended, with a UserWarning.")
        .def(
            "write",
            [](const LevelSet& levelSet, const std::filesystem::path& file,
               const std::map<std::string, std::string>& metadata, const py::object& progress) {
                runWork(progress,
                        [&](Interrupter& p) { writeAny(file, levelSet, nullptr, metadata, p); });
            },
            "file"_a, "metadata"_a = std::map<std::string, std::string>(),
            "progress"_a = py::none(),
            "Write .vdb, with metadata (names to texts) on the grid; or the mesh as .ply, .obj, "
            ".off, .stl, .glb or .usda. The file appears whole or not at all." MPUVDB_PROGRESS_DOC);
}

void bindArrays(LevelSetClass& levelSets)
{
    levelSets
        .def("to_numpy", &denseOf,
             "(values, origin): the smallest block (nx, ny, nz) of float32 that holds the band, "
             "and the world position (3,) of values[0, 0, 0]. Beyond the band values are the "
             "band's width, negative inside.")
        .def_static(
            "from_numpy",
            [](const py::array_t<float, py::array::forcecast>& values, const Vec3d& origin,
               double voxelSize, double halfWidth) {
                return run(py::none(), [&](Interrupter& p) {
                    const LevelSet made =
                        taken(levelSetOf(values, origin, voxelSize, halfWidth, p).gridPtr(), p);
                    const LevelSet asked = emptyLevelSet({origin, voxelSize}, halfWidth);
                    return made.grid().background() == asked.grid().background()
                               ? made
                               : withHalfWidth(made, asked.halfWidth(), &p);
                });
            },
            "values"_a, "origin"_a, "voxel_size"_a, "half_width"_a = 3.0,
            "The level set of a block (nx, ny, nz) of signed distances, world units, negative "
            "inside; values[0, 0, 0] lies at origin. The solid must not meet the block's border. "
            "Values that are clipped within the band, or that check() does not take for distances, "
            "are measured anew from the surface, with a UserWarning.")
        .def(
            "to_pyopenvdb", [](const LevelSet& s) { return toPyOpenVdb(s.grid()); },
            "A FloatGrid of OpenVDB's own Python module, with the same voxels and transform.")
        .def_static(
            "from_pyopenvdb",
            [](const py::object& grid) {
                const openvdb::FloatGrid::Ptr made = fromPyOpenVdb(grid, "grid");
                return run(py::none(), [&](Interrupter& p) { return taken(made, p); });
            },
            "grid"_a,
            "The level set of a FloatGrid of OpenVDB's own Python module.\n\n"
            "Raises InputError unless it has the class level set, uniform voxels, a positive "
            "background, finite values and a band between inside and outside. A background that "
            "promises more than the band holds, and values that check() does not take for "
            "distances, are mended, with a UserWarning.");
}

void bindIsosurface(LevelSetClass& levelSets)
{
    levelSets.def_static(
        "isosurface",
        [](const py::object& source, double value, const std::string& inside,
           const std::optional<Vec3d>& origin, const std::optional<double>& voxelSize,
           double halfWidth, const py::object& progress) {
            const auto side = choose<Inside>(inside, "inside",
                                             {{"above", Inside::Above}, {"below", Inside::Below}});
            const auto surfaceOf = [&](const openvdb::FloatGrid& grid, Interrupter& p) {
                return isosurface(grid, value, side, halfWidth, 0, &p);
            };
            if (py::isinstance<py::array>(source)) {
                if (!voxelSize) throw UsageError("voxel_size: an array of values needs one");
                const auto values = source.cast<py::array_t<float, py::array::forcecast>>();
                const Vec3d first = origin.value_or(Vec3d::Zero());
                return run(progress, [&](Interrupter& p) {
                    return surfaceOf(*gridOf(values, first, *voxelSize, value, side, p), p);
                });
            }
            if (origin || voxelSize)
                throw UsageError("origin and voxel_size go with an array: a grid has its own");
            const auto grid = fromPyOpenVdb(source, "source");
            return run(progress, [&](Interrupter& p) { return surfaceOf(*grid, p); });
        },
        "source"_a, "value"_a = 0.5, py::kw_only(), "inside"_a = "above", "origin"_a = py::none(),
        "voxel_size"_a = py::none(), "half_width"_a = 3.0, "progress"_a = py::none(),
        "The surface where a density, or any values, pass value: a block (nx, ny, nz) of numpy, "
        "values[0, 0, 0] at origin (default: the world's), voxel_size in world units, or a "
        "FloatGrid of OpenVDB's own Python module, of any class.\n\n"
        "inside: 'above', as of densities, or 'below', as of distances. half_width: of the band, "
        "voxels. The block's border, or the grid's background, has to be outside.\n\n"
        "Raises InputError where values are not finite or nothing is inside." MPUVDB_PROGRESS_DOC);
}

void bindQuestions(LevelSetClass& levelSets)
{
    levelSets
        .def(
            "check",
            [](const LevelSet& levelSet, double tolerance, const py::object& progress) {
                if (!(tolerance >= 0))
                    throw UsageError(fmt::format("check: gradient_tolerance is {}; it must be 0 or "
                                                 "above",
                                                 tolerance));
                return run(progress, [&](Interrupter& p) {
                    return check(levelSet.grid(), tolerance, openvdb::CoordBBox::inf(), &p);
                });
            },
            "gradient_tolerance"_a = 0.1, "progress"_a = py::none(),
            "Whether it is a true signed distance in a complete band: a CheckReport. "
            "gradient_tolerance is the largest mean of ||grad| - 1|, 0 or "
            "above." MPUVDB_PROGRESS_DOC)
        .def(
            "measure",
            [](const LevelSet& levelSet, const py::object& progress) {
                return run(progress, [&](Interrupter& p) { return measure(levelSet, &p); });
            },
            "progress"_a = py::none(),
            "Volume, area, bounds, genus, thickness: SolidMeasures." MPUVDB_PROGRESS_DOC)
        .def(
            "to_mesh",
            [](const LevelSet& levelSet, const py::object& progress) {
                return run(progress, [&](Interrupter& p) {
                    return std::make_shared<Mesh>(extractMesh(levelSet, {}, &p));
                });
            },
            "progress"_a = py::none(), "The surface as triangles: a Mesh." MPUVDB_PROGRESS_DOC)
        .def(
            "shape",
            [](const LevelSet& levelSet, const std::string& name) { return Shape(levelSet, name); },
            "name"_a = "grid", "A Shape of it, called name in plans.");
}

} // namespace

void demandWritable(const std::filesystem::path& file)
{
    const std::vector<std::string>& meshes = meshExtensions();
    const std::string extension = file.extension().string();
    if (extension == ".vdb" || std::find(meshes.begin(), meshes.end(), extension) != meshes.end())
        return;
    throw UsageError(fmt::format("{}: of no kind that can be written. Name a .vdb, {} file",
                                 file.string(), fmt::join(meshes, " or ")));
}

void writeAny(const std::filesystem::path& file, const LevelSet& levelSet, const Field* field,
              const std::map<std::string, std::string>& metadata, Interrupter& progress)
{
    demandWritable(file);
    if (file.extension() == ".vdb") {
        std::map<std::string, std::string> all = {{"mpuvdb:version", MPUVDB_VERSION}};
        all.insert(metadata.begin(), metadata.end());
        return writeLevelSet(file, levelSet, all, {}, &progress);
    }
    writeMesh(file, extractMesh(levelSet, {field}, &progress), {}, &progress);
}

void noteIfEmpty(const LevelSet& made, Interrupter& progress)
{
    if (made.grid().activeVoxelCount() > 0) return;
    progress.note(fmt::format("nothing is left: the level set is empty. Walls thinner than its "
                              "voxels, which are {:g}, do not show",
                              made.voxelSize()));
}

void bindLevelSet(LevelSetClass& levelSets)
{
    bindProperties(levelSets);
    bindFiles(levelSets);
    bindArrays(levelSets);
    bindIsosurface(levelSets);
    bindQuestions(levelSets);
}

} // namespace mpuvdb::python
