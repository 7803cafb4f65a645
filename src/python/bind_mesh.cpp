// Triangle meshes.
#include "arguments.h"
#include "arrays.h"
#include "bindings.h"
#include "run.h"

#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <pybind11/stl/filesystem.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;

void bindMesh(MeshClass& meshes)
{
    meshes
        .def(py::init([](const py::object& vertices, const py::object& faces) {
                 return std::make_shared<Mesh>(meshOf(vertices, faces));
             }),
             "vertices"_a, "faces"_a,
             "vertices: (n, 3), world units; float32 and float64 are read in place.\n"
             "faces: (m, 3) integers, counter-clockwise seen from outside.\n\n"
             "Raises UsageError for other shapes, InputError for indices out of range.")
        .def_property_readonly(
            "vertices", [](const Mesh& mesh) { return worldVertices(mesh); },
            "World positions (n, 3), float64: frame + positions, made at each call.")
        .def_property_readonly(
            "frame", [](const Mesh& mesh) { return arrayOf(mesh.frame); },
            "World position (3,) that positions are relative to.")
        .def_property_readonly(
            "positions",
            [](const py::object& self) {
                const auto& mesh = self.cast<const Mesh&>();
                return viewOf(reinterpret_cast<const float*>(mesh.positions.data()),
                              {py::ssize_t(mesh.positions.size()), 3}, self);
            },
            "Positions relative to frame (n, 3), float32: a read-only view, no copy.")
        .def_property_readonly(
            "faces",
            [](const py::object& self) {
                const auto& mesh = self.cast<const Mesh&>();
                return viewOf(reinterpret_cast<const std::uint32_t*>(mesh.triangles.data()),
                              {py::ssize_t(mesh.triangles.size()), 3}, self);
            },
            "Vertex indices (m, 3), uint32: a read-only view, no copy.")
        .def_property_readonly(
            "colors",
            [](const py::object& self) -> py::object {
                const auto& mesh = self.cast<const Mesh&>();
                if (mesh.colors.empty()) return py::none();
                return viewOf(reinterpret_cast<const float*>(mesh.colors.data()),
                              {py::ssize_t(mesh.colors.size()), 3}, self);
            },
            "Linear red, green and blue of the vertices (n, 3), float32, or None: a read-only "
            "view.")
        .def_property_readonly(
            "scalars",
            [](const py::object& self) {
                py::dict scalars;
                for (const NamedScalars& s : self.cast<const Mesh&>().scalars)
                    scalars[py::str(s.name)] =
                        viewOf(s.values.data(), {py::ssize_t(s.values.size())}, self);
                return scalars;
            },
            "Numbers of the vertices by name, (n,) float32 each: read-only views.")
        .def(
            "measure",
            [](const Mesh& mesh) {
                return run(py::none(), [&](Interrupter&) { return measure(mesh); });
            },
            "Count, and measure area and volume: a MeshReport.")
        .def(
            "simplify",
            [](const Mesh& mesh, const LengthArgument& tolerance, bool strict,
               const py::object& progress) {
                Box3d box;
                for (const Vec3f& p : mesh.positions) box.extend(p.cast<double>());
                const double length = worldLength(tolerance, {box});
                return run(progress, [&](Interrupter& p) {
                    return std::make_shared<Mesh>(simplify(mesh, {length, strict}, &p));
                });
            },
            "tolerance"_a, "strict"_a = false, "progress"_a = py::none(),
            "A Mesh of fewer triangles, at most tolerance (a length; % is of the mesh's diagonal) "
            "from this one: edges and colors stay; strict: no triangles are made to "
            "cross." MPUVDB_PROGRESS_DOC)
        .def(
            "self_intersections",
            [](const Mesh& mesh, const py::object& progress) {
                return run(progress,
                           [&](Interrupter& p) { return findSelfIntersections(mesh, &p).size(); });
            },
            "progress"_a = py::none(), "How many pairs of triangles cross." MPUVDB_PROGRESS_DOC)
        .def(
            "shape",
            [](const std::shared_ptr<Mesh>& mesh) {
                return Shape(std::shared_ptr<const Mesh>(mesh));
            },
            "The solid inside a closed mesh, as a Shape.")
        .def(
            "write",
            [](const Mesh& mesh, const std::filesystem::path& file, const py::object& progress) {
                runWork(progress, [&](Interrupter& p) { writeMesh(file, mesh, {}, &p); });
            },
            "file"_a, "progress"_a = py::none(),
            "Write .ply, .obj, .off, .stl, .glb or .usda; it appears whole or not at "
            "all." MPUVDB_PROGRESS_DOC)
        .def("__repr__", [](const Mesh& mesh) {
            return fmt::format("<mpuvdb.Mesh: {} vertices, {} faces>", mesh.positions.size(),
                               mesh.triangles.size());
        });
}

} // namespace mpuvdb::python
