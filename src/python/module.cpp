// The Python module mpuvdb.
#include "bindings.h"
#include "errors.h"

#include <openvdb/openvdb.h>

namespace py = pybind11;
using namespace mpuvdb;
using namespace mpuvdb::python;

PYBIND11_MODULE(mpuvdb, module)
{
    openvdb::initialize();
    module.doc() =
        "Points, meshes and formulas to correct OpenVDB level sets, and modelling with them.\n\n"
        "A Shape only describes a solid; writing, meshing or sampling it plans first how wide a "
        "band and which region each part needs. A LevelSet is a sampled one, a Mesh its triangles. "
        "All are immutable.\n\n"
        "Lengths are world units, or text with a unit: '0.1%' of the diagonal of the bounding box, "
        "'1.5vx' voxels where there are voxels. Half-widths are voxels. Negative is inside.\n\n"
        "Long calls let other threads run, stop on Ctrl-C, and take progress=callback.";
    module.attr("__version__") = MPUVDB_VERSION;
    bindErrors(module);
    bindReports(module);
    // All classes before any function, so that signatures name them.
    MeshClass meshes(module, "Mesh",
                     "An indexed triangle mesh: Mesh(vertices, faces), counter-clockwise seen from "
                     "outside. Vertices are floats about a double frame.");
    LevelSetClass levelSets(module, "LevelSet",
                            "A solid as a narrow band of signed distances on voxels, immutable. "
                            "Made by Shape.level_set(), read(), from_numpy(), from_pyopenvdb().",
                            py::dynamic_attr());
    ShapeClass shapes(module, "Shape",
                      "An immutable solid as an expression: combined by | & - and the functions of "
                      "this module, sampled when a level set, a mesh or a file is asked for.",
                      py::dynamic_attr());
    bindMesh(meshes);
    bindLevelSet(levelSets);
    bindLevelSetOperations(levelSets);
    bindShape(shapes, levelSets);
    bindDeformations(shapes);
    py::implicitly_convertible<LevelSet, Shape>();
    bindQueries(module, levelSets, shapes);
    bindBooleans(module);
    bindPrimitives(module);
    bindParticles(module);
    bindReconstruction(module);
    bindSources(module);
}
