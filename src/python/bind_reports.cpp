// What check() and measure() tell.
#include "arguments.h"
#include "bindings.h"

#include <fmt/format.h>

#include <pybind11/stl.h>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

void bindChecks(py::module_& module)
{
    py::class_<CheckFinding>(module, "CheckFinding", "One thing that is wrong with a level set.")
        .def_readonly("what", &CheckFinding::what, "What is wrong, with the numbers.")
        .def_property_readonly(
            "voxel",
            [](const CheckFinding& f) {
                return py::make_tuple(f.voxel.x(), f.voxel.y(), f.voxel.z());
            },
            "Index (i, j, k) of the voxel where it is worst.")
        .def_readonly("count", &CheckFinding::count, "Voxels; 0: the grid as a whole.")
        .def("__repr__",
             [](const CheckFinding& f) { return "<mpuvdb.CheckFinding " + f.what + ">"; });

    py::class_<CheckReport>(module, "CheckReport", "What LevelSet.check() measured.")
        .def_property_readonly("sound", &CheckReport::sound, "Whether nothing is wrong.")
        .def_readonly("active_voxels", &CheckReport::activeVoxels, "Number of active voxels.")
        .def_readonly("mean_gradient_error", &CheckReport::meanGradientError,
                      "Mean of ||grad| - 1|.")
        .def_readonly("max_gradient_error", &CheckReport::maxGradientError, "Largest ||grad| - 1|.")
        .def_readonly("band_inside", &CheckReport::bandInside,
                      "Largest distance of an active voxel inside, voxels.")
        .def_readonly("band_outside", &CheckReport::bandOutside,
                      "Largest distance of an active voxel outside, voxels.")
        .def_readonly("findings", &CheckReport::findings, "All that is wrong.")
        .def("__bool__", &CheckReport::sound, "Whether nothing is wrong.")
        .def("__repr__", [](const CheckReport& r) {
            return fmt::format("<mpuvdb.CheckReport: {}, {} active voxels>",
                               r.sound() ? "sound" : r.findings.front().what, r.activeVoxels);
        });
}

void bindSolidMeasures(py::module_& module)
{
    using M = SolidMeasures;
    py::class_<M>(module, "SolidMeasures", "What LevelSet.measure() measured.")
        .def_readonly("volume", &M::volume, "World units cubed.")
        .def_readonly("area", &M::area, "World units squared.")
        .def_property_readonly(
            "bounds", [](const M& m) { return cornersOf(m.bounds); },
            "(low, high) of the surface, world units; None if there is none.")
        .def_readonly("euler_characteristic", &M::eulerCharacteristic, "Of the surface.")
        .def_readonly("surfaces", &M::surfaces, "Connected parts of the surface, cavities too.")
        .def_readonly("genus", &M::genus, "Handles of all surfaces.")
        .def_readonly("min_thickness", &M::minThickness, "Smallest thickness, world units.")
        .def_readonly("mean_thickness", &M::meanThickness,
                      "Mean diameter of the largest ball inside that touches the surface at a "
                      "place, world units.")
        .def("__repr__", [](const M& m) {
            return fmt::format("<mpuvdb.SolidMeasures: volume {:.6g}, area {:.6g}, genus {}>",
                               m.volume, m.area, m.genus);
        });
}

void bindMeshReport(py::module_& module)
{
    using R = MeshReport;
    py::class_<R>(module, "MeshReport", "What Mesh.measure() measured.")
        .def_readonly("vertices", &R::vertices, "Number of vertices.")
        .def_readonly("triangles", &R::triangles, "Number of triangles.")
        .def_readonly("components", &R::components, "Connected parts, by shared vertices.")
        .def_readonly("boundary_edges", &R::boundaryEdges, "Edges with one triangle.")
        .def_readonly("boundary_loops", &R::boundaryLoops, "Connected parts of the boundary.")
        .def_readonly("non_manifold_edges", &R::nonManifoldEdges,
                      "Edges with more than two triangles, or two that disagree in direction.")
        .def_readonly("euler_characteristic", &R::eulerCharacteristic,
                      "Vertices - edges + triangles, of the vertices that are used.")
        .def_readonly("genus", &R::genus, "Handles, of all parts; if there are no bad edges.")
        .def_readonly("area", &R::area, "World units squared.")
        .def_readonly("volume", &R::volume, "Signed, world units cubed.")
        .def_readonly("smallest_angle", &R::smallestAngle, "Of all triangles, degrees.")
        .def_readonly("first_percentile_angle", &R::firstPercentileAngle,
                      "Smallest angle that one triangle in a hundred falls short of, degrees.")
        .def("__repr__", [](const R& r) {
            return fmt::format(
                "<mpuvdb.MeshReport: {} triangles, volume {:.6g}, {} boundary edges>", r.triangles,
                r.volume, r.boundaryEdges);
        });
}

} // namespace

void bindReports(py::module_& module)
{
    bindChecks(module);
    bindSolidMeasures(module);
    bindMeshReport(module);
}

} // namespace mpuvdb::python
