// Shapes: what is asked of them, and operations that need no deformation of space.
#include "arguments.h"
#include "bindings.h"
#include "evaluation.h"
#include "modelling_arguments.h"
#include "run.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <optional>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

void bindEvaluation(ShapeClass& shapes)
{
    shapes
        .def(
            "level_set",
            [](const Shape& shape, const VoxelSize& voxelSize, double halfWidth,
               const MaxBytes& maxBytes, const py::object& progress) {
                const ShapeSettings s = settingsToWork(shape, voxelSize, halfWidth, maxBytes);
                return run(progress, [&](Interrupter& p) { return evaluated(shape, s, p); });
            },
            "voxel_size"_a = py::none(), "half_width"_a = 3.0, "max_bytes"_a = py::none(),
            "progress"_a = py::none(),
            "Plan and sample: a LevelSet." MPUVDB_SAMPLING_DOC MPUVDB_PROGRESS_DOC)
        .def(
            "to_mesh",
            [](const Shape& shape, const VoxelSize& voxelSize, const MaxBytes& maxBytes,
               const py::object& progress) {
                const ShapeSettings s = settingsToWork(shape, voxelSize, 3, maxBytes);
                return run(progress, [&](Interrupter& p) {
                    const FieldPtr field = shape.field();
                    return std::make_shared<Mesh>(
                        extractMesh(evaluated(shape, s, p), {field.get()}, &p));
                });
            },
            "voxel_size"_a = py::none(), "max_bytes"_a = py::none(), "progress"_a = py::none(),
            "Plan, sample and extract the surface: a Mesh, with creases as exact as the shape's "
            "formulas are where it has no grids, meshes, offsets or blends in "
            "it." MPUVDB_SAMPLING_DOC MPUVDB_PROGRESS_DOC)
        .def(
            "write",
            [](const Shape& shape, const std::filesystem::path& file, const VoxelSize& voxelSize,
               double halfWidth, const std::map<std::string, std::string>& metadata,
               const MaxBytes& maxBytes, const py::object& progress) {
                demandWritable(file);
                const ShapeSettings s = settingsToWork(shape, voxelSize, halfWidth, maxBytes);
                runWork(progress, [&](Interrupter& p) {
                    const FieldPtr field = shape.field();
                    writeAny(file, evaluated(shape, s, p), field.get(), metadata, p);
                });
            },
            "file"_a, "voxel_size"_a = py::none(), "half_width"_a = 3.0,
            "metadata"_a = std::map<std::string, std::string>(), "max_bytes"_a = py::none(),
            "progress"_a = py::none(),
            "Plan, sample and write .vdb, with metadata (names to texts) on the grid; or the mesh "
            "as .ply, .obj, .off, .stl, .glb or .usda. The file appears whole or not at "
            "all." MPUVDB_SAMPLING_DOC MPUVDB_PROGRESS_DOC)
        .def(
            "explain",
            [](const Shape& shape, const VoxelSize& voxelSize, double halfWidth) {
                const ShapeSettings s = settingsFor(shape, voxelSize, halfWidth, 0);
                return run(py::none(), [&](Interrupter&) { return shape.explain(s); });
            },
            "voxel_size"_a = py::none(), "half_width"_a = 3.0,
            "What level_set() would do: a line for each part, with its band, voxels and memory.")
        .def_property_readonly(
            "bounds", [](const Shape& shape) { return cornersOf(shape.bounds()); },
            "(low, high) of a box around the solid, world units, infinite where the solid is; None "
            "if there is nothing.")
        .def("__repr__", [](const Shape& shape) {
            const Box3d box = shape.bounds();
            if (box.isEmpty()) return std::string("<mpuvdb.Shape: nothing>");
            const Vec3d &a = box.min(), &b = box.max();
            return fmt::format("<mpuvdb.Shape within ({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, "
                               "{:.6g})>",
                               a[0], a[1], a[2], b[0], b[1], b[2]);
        });
}

void bindSurfaceOperations(ShapeClass& shapes)
{
    shapes
        .def(
            "offset",
            [](const Shape& shape, const LengthArgument& distance) {
                return shape.offset(worldLength(distance, {shape.bounds()}));
            },
            "distance"_a, "Grown by distance (world units, or '1%'), or shrunk by a negative one.")
        .def(
            "shell",
            [](const Shape& shape, const LengthArgument& thickness, const std::string& wall) {
                return shape.shell(worldLength(thickness, {shape.bounds()}), wallOf(wall));
            },
            "thickness"_a, "wall"_a = "inward",
            "The wall along the surface; wall is 'inward', 'outward' or 'centered'. Thinner than "
            "two voxels is a LimitError once it is sampled.")
        .def(
            "smooth",
            [](const Shape& shape, const std::string& filter, int iterations, int width,
               const py::object& mask) {
                return shape.smooth(smoothSettings(filter, iterations, width, mask));
            },
            "filter"_a = "gaussian", "iterations"_a = 1, "width"_a = 1, "mask"_a = py::none(),
            MPUVDB_SMOOTH_DOC)
        .def(
            "morph",
            [](const Shape& shape, const Shape& other, double t, const std::string& how) {
                return Shape::morph(shape, other, t,
                                    choose<Morphing>(how, "how",
                                                     {{"linear", Morphing::Linear},
                                                      {"advection", Morphing::Advection}}));
            },
            "other"_a, "t"_a, "how"_a = "linear",
            "On the way from this (t = 0) to other (t = 1). 'linear' blends the distances; "
            "'advection' moves the surface along its normals, for shapes that differ much; apart, "
            "self goes before other comes.");
}

/// Of shapes, or of level sets as shapes.
template <class Class>
void bindOperators(Class& solids)
{
    using Solid = typename Class::type;
    const auto operation = [&](const char* name, const char* doc, auto combine) {
        solids.def(
            name, [combine](const Solid& a, const Shape& b) { return combine(Shape(a), b); },
            "other"_a, py::is_operator(), doc);
    };
    operation("__or__", "The union.", [](const Shape& a, const Shape& b) { return a | b; });
    operation("__and__", "The intersection.", [](const Shape& a, const Shape& b) { return a & b; });
    operation("__sub__", "The difference.", [](const Shape& a, const Shape& b) { return a - b; });
    operation("__xor__", "What lies in one of both only.",
              [](const Shape& a, const Shape& b) { return (a - b) | (b - a); });
}

} // namespace

void bindShape(ShapeClass& shapes, LevelSetClass& levelSets)
{
    shapes.def(py::init([](const LevelSet& levelSet) { return Shape(levelSet); }), "level_set"_a,
               "The solid of a LevelSet; resampled where its voxels are not those asked for.");
    bindEvaluation(shapes);
    bindSurfaceOperations(shapes);
    bindOperators(shapes);
    bindOperators(levelSets);
}

} // namespace mpuvdb::python
