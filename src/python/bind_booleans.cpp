// Union, intersection, difference of any number of shapes.
#include "arguments.h"
#include "bindings.h"

#include <mpuvdb/error.h>

#include <pybind11/stl.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

Shape combine(Boolean kind, std::vector<Shape> shapes, const LengthArgument& blend)
{
    Box3d box;
    for (const Shape& shape : shapes) box.extend(shape.bounds());
    return Shape::combine(kind, std::move(shapes), worldLength(blend, {box}));
}

/// After *args pybind11 converts nothing, and would refuse whole numbers.
LengthArgument blendLength(const py::object& blend)
{
    try {
        return blend.cast<LengthArgument>();
    } catch (const py::cast_error&) {
        throw py::type_error("blend: give a number of world units, or text such as '1%'");
    }
}

std::vector<Shape> shapesOf(const py::args& arguments)
{
    std::vector<Shape> shapes;
    for (const py::handle argument : arguments) {
        if (!py::isinstance<Shape>(argument) && !py::isinstance<LevelSet>(argument))
            throw py::type_error("shapes: give Shapes or LevelSets, each as an argument");
        shapes.push_back(argument.cast<Shape>());
    }
    return shapes;
}

} // namespace

void bindBooleans(py::module_& module)
{
    const auto boolean = [&](const char* name, Boolean kind, const char* doc) {
        module.def(
            name,
            [kind](const py::args& shapes, const py::object& blend) {
                return combine(kind, shapesOf(shapes), blendLength(blend));
            },
            py::kw_only(), "blend"_a = 0.0, doc);
    };
    boolean("union", Boolean::Union,
            "All shapes as one. Creases that come about are filleted with the radius blend (world "
            "units, or '1%' of the diagonal of all); 0: they stay sharp.");
    boolean("intersection", Boolean::Intersection,
            "What lies in all shapes; blend as for union().");
    boolean("difference", Boolean::Difference,
            "The first shape without all the others; blend as for union().");
    module.def(
        "blend_union",
        [](const Shape& a, const Shape& b, const LengthArgument& radius) {
            return combine(Boolean::Union, {a, b}, radius);
        },
        "a"_a, "b"_a, "radius"_a,
        "The union of two with a fillet of radius (world units, or '1%'): union(a, b, "
        "blend=radius).");
}

} // namespace mpuvdb::python
