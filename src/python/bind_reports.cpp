// What check() and measure() tell.
#include "arguments.h"
#include "bindings.h"

#include <mpuvdb/explained.h>

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

void bindMeshRepair(py::module_& module)
{
    using R = MeshRepair;
    py::class_<R>(module, "MeshRepair", "What the repair of a broken mesh did.")
        .def_readonly("dropped", &R::dropped,
                      "Triangles with vertices that are not finite or not there, left out.")
        .def_readonly("copies", &R::copies, "Triangles left out for others with their corners.")
        .def_readonly("turned", &R::turned, "Whole patches that were turned outward.")
        .def_readonly("holes", &R::holes, "Holes that were closed.")
        .def_readonly("holes_area", &R::holesArea,
                      "Of the surfaces that close them, world units squared.")
        .def_readonly("widest_hole", &R::widestHole,
                      "Diagonal of the box of the widest, world units; 0: none.")
        .def_property_readonly(
            "widest_hole_at",
            [](const R& r) {
                const Vec3d& at = r.widestHoleAt;
                return py::make_tuple(at[0], at[1], at[2]);
            },
            "Middle of that box (x, y, z), world units.")
        .def_readonly("inner_walls", &R::innerWalls, "Open surfaces within the solid, left out.")
        .def_readonly("sheets", &R::sheets, "Open surfaces that were made walls.")
        .def_readonly("sheets_area", &R::sheetsArea, "Of these, world units squared.")
        .def("__repr__", [](const R& r) {
            return fmt::format("<mpuvdb.MeshRepair: {} holes closed, {} patches turned>", r.holes,
                               r.turned);
        });
}

void bindMeshExplained(py::module_& module)
{
    using E = MeshExplained;
    py::class_<E>(module, "MeshExplained",
                  "A mesh and the level set of its solid, compared: LevelSet.explained.")
        .def_property_readonly(
            "sound", [](const E& e) { return e.findings.empty(); },
            "Whether the voxel size explains all that differs.")
        .def_readonly("findings", &E::findings, "What it does not explain, with the cure.")
        .def_readonly("volume_in", &E::volumeIn, "Of the mesh's solid, world units cubed.")
        .def_readonly("volume_out", &E::volumeOut, "Of the level set's, world units cubed.")
        .def_readonly("volume_explained", &E::volumeExplained,
                      "Their difference that the voxel size explains, world units cubed.")
        .def_readonly("area_in", &E::areaIn, "Of the solid's boundary, world units squared.")
        .def_readonly("area_out", &E::areaOut, "Of the level set's, world units squared.")
        .def_readonly("parts_in", &E::partsIn, "Surfaces that enclose some of the mesh's solid.")
        .def_readonly("parts_out", &E::partsOut, "Connected parts of the level set's solid.")
        .def_readonly("cavities_in", &E::cavitiesIn, "Surfaces that enclose none of the solid.")
        .def_readonly("cavities_out", &E::cavitiesOut, "Connected parts of what is enclosed.")
        .def_readonly("missed", &E::missed, "Share of the boundary that no voxels show.")
        .def_readonly("open_edges", &E::openEdges, "Edges whose triangles do not cancel.")
        .def_readonly("turned", &E::turned,
                      "Triangles that faced another way than their neighbors.")
        .def_readonly("inside_out", &E::insideOut, "Whether all faced inward, and were turned.")
        .def_readonly("area_within", &E::areaWithin,
                      "Of triangles inside the solid, world units squared.")
        .def_readonly("area_of_nothing", &E::areaOfNothing,
                      "Of parts that face inward and lie in no other, world units squared.")
        .def_readonly("repair", &E::repair, "What repair did, a MeshRepair; None without it.")
        .def("__repr__", [](const E& e) {
            return fmt::format("<mpuvdb.MeshExplained: volume {:.6g} of {:.6g}, {}>", e.volumeOut,
                               e.volumeIn, e.findings.empty() ? "sound" : e.findings.front());
        });
}

void bindPointsExplained(py::module_& module)
{
    using E = PointsExplained;
    const auto ofMesh = [](auto number) {
        return [number](const E& e) {
            return e.mesh ? py::cast((*e.mesh).*number) : py::object(py::none());
        };
    };
    py::class_<E>(module, "PointsExplained",
                  "Points and the level set made of them, compared: LevelSet.explained.")
        .def_property_readonly(
            "sound", [](const E& e) { return e.findings.empty(); },
            "Whether noise, spacing and voxel size explain all that differs.")
        .def_readonly("findings", &E::findings, "What they do not explain, with the cure.")
        .def_readonly("points", &E::points, "Number of points.")
        .def_readonly("limit", &E::limit,
                      "Points so near to the surface are explained by it, world units: half a "
                      "voxel, the tolerance, and three standard deviations of the noise.")
        .def_readonly("within", &E::within, "Share of the points that are explained.")
        .def_readonly("largest", &E::largest,
                      "Largest distance, world units, up to the band's width.")
        .def_readonly("beyond_band", &E::beyondBand,
                      "Number of points that are that far away, or farther.")
        .def_readonly(
            "against", &E::against,
            "Share of the points whose normals are more than 60 degrees off the surface's.")
        .def_readonly("unsupported", &E::unsupported,
                      "Share of the surface without a point within five spacings.")
        .def_readonly("volume", &E::volume, "Of the level set's solid, world units cubed.")
        .def_readonly("area", &E::area, "Of its surface, world units squared.")
        .def_readonly("parts", &E::parts, "Connected parts of the solid.")
        .def_readonly("cavities", &E::cavities, "Connected parts of what it encloses.")
        .def_property_readonly("mesh_volume", ofMesh(&VertexMesh::volume),
                               "Of the mesh whose vertices the points are, world units cubed, 0 if "
                               "it is open; None without one.")
        .def_property_readonly("mesh_area", ofMesh(&VertexMesh::area),
                               "Of that mesh, world units squared; None without one.")
        .def_property_readonly("mesh_parts", ofMesh(&VertexMesh::parts),
                               "Connected parts of that mesh; None without one.")
        .def_property_readonly("mesh_cavities", ofMesh(&VertexMesh::cavities),
                               "Its closed parts that face inward; None without one.")
        .def_readonly("mesh_within", &E::meshWithin,
                      "Share of that mesh's area that the surface follows.")
        .def("__repr__", [](const E& e) {
            return fmt::format("<mpuvdb.PointsExplained: {:.4g} % of {} points within {:.3g}, {}>",
                               100 * e.within, e.points, e.limit,
                               e.findings.empty() ? "sound" : e.findings.front());
        });
}

} // namespace

void bindReports(py::module_& module)
{
    bindChecks(module);
    bindSolidMeasures(module);
    bindMeshReport(module);
    bindMeshRepair(module);
    bindMeshExplained(module);
    bindPointsExplained(module);
}

} // namespace mpuvdb::python
