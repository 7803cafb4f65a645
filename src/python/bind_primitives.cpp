// Shapes from formulas.
#include "arguments.h"
#include "bindings.h"
#include "callables.h"

#include <mpuvdb/error.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>

#include <pybind11/stl.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

std::string numbers(const Vec3d& v)
{
    return fmt::format("{},{},{}", v[0], v[1], v[2]);
}

Shape solidShape(const std::string& description, const std::string& name)
{
    return Shape(makeSolidField(parseSolid(description)), name);
}

Shape at(const Vec3d& place, const Shape& shape)
{
    return shape.moved(Eigen::Affine3d(Eigen::Translation3d(place)));
}

/// The solid called @a name of a radius and a height, which stands along z, put between @a a and
/// @a b.
Shape between(const char* name, const Vec3d& a, const Vec3d& b, double radius)
{
    const Vec3d along =
        finite(fmt::format("{}: b", name), b) - finite(fmt::format("{}: a", name), a);
    const double length = along.norm();
    if (!(length > 0) || !std::isfinite(length))
        throw UsageError(fmt::format("{}: its ends a and b are {} apart; that must be above 0 and "
                                     "finite",
                                     name, length));
    positive(fmt::format("{}: radius", name), radius);
    Eigen::Affine3d motion(Eigen::Translation3d((a + b) / 2));
    motion.rotate(Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(), along));
    return solidShape(fmt::format("{}({},{})", name, radius, length), name).moved(motion);
}

/// What a call was: name(0.35, radius=1).
std::string callOf(const char* name, const py::args& args, const py::kwargs& named)
{
    std::vector<std::string> words;
    for (const py::handle arg : args) words.push_back(py::repr(arg));
    for (const auto& [key, value] : named)
        words.push_back(
            fmt::format("{}={}", std::string(py::str(key)), std::string(py::repr(value))));
    return fmt::format("{}({})", name, fmt::join(words, ", "));
}

/// Defines a function whose TypeErrors say how it is called, by @a examples.
template <class Function, class... Extra>
void define(py::module_& module, const char* name, const char* examples, Function&& function,
            const Extra&... extra)
{
    module.def(name, std::forward<Function>(function), extra...);
    const py::object exact = module.attr(name);
    const std::string doc = py::str(exact.doc());
    py::options options;
    options.disable_function_signatures(); // doc has that of the function itself
    module.attr(name) = py::cpp_function(
        [exact, name, examples](const py::args& args, const py::kwargs& named) -> py::object {
            try {
                return exact(*args, **named);
            } catch (const py::error_already_set& error) {
                if (!error.matches(PyExc_TypeError)) throw;
                throw py::type_error(fmt::format("{}: it is not called like that. Write {}; a "
                                                 "place, a direction and the size of a box are "
                                                 "three numbers each, such as (0, 0, 1)",
                                                 callOf(name, args, named), examples));
            }
        },
        py::name(name), py::scope(module), doc.c_str());
}

Box3d boxOf(const std::optional<Vec3d>& low, const std::optional<Vec3d>& high,
            const std::optional<Vec3d>& center, const std::optional<Vec3d>& size)
{
    if (low && high && !center && !size) return boxBetween(*low, *high);
    if (size && !low && !high) {
        const Vec3d half = positive("box: size", *size) / 2;
        const Vec3d middle = finite("box: center", center.value_or(kZero));
        return boxBetween(middle - half, middle + half);
    }
    throw UsageError("a box: give low and high, or size=(x, y, z), and center=(x, y, z) with it "
                     "unless it lies about (0, 0, 0)");
}

void bindRound(py::module_& module)
{
    define(
        module, "sphere", "sphere(radius=0.5) or sphere((0, 0, 1), 0.5)",
        [](const Vec3d& center, double radius) {
            return at(finite("sphere: center", center),
                      solidShape(fmt::format("sphere({})", positive("sphere: radius", radius)),
                                 "sphere"));
        },
        "center"_a = kZero, "radius"_a = 1.0, "A ball; world units.");
    define(
        module, "ellipsoid", "ellipsoid((0, 0, 0), (3, 2, 1))",
        [](const Vec3d& center, const Vec3d& radii) {
            return at(finite("ellipsoid: center", center),
                      solidShape(fmt::format("ellipsoid({})",
                                             numbers(positive("ellipsoid: radii", radii))),
                                 "ellipsoid"));
        },
        "center"_a, "radii"_a, "An ellipsoid with radii along the axes; world units.");
    define(
        module, "torus", "torus(1, 0.3) or torus(1, 0.3, center=(0, 0, 1), axis='x')",
        [](double ring, double tube, const Vec3d& center, const AxisArgument& axis) {
            positive("torus: ring_radius", ring);
            positive("torus: tube_radius", tube);
            if (!(tube < ring))
                throw UsageError(
                    fmt::format("torus: tube_radius is {}; it must be less than ring_radius, "
                                "which is {}",
                                tube, ring));
            Eigen::Affine3d motion((Eigen::Translation3d(finite("torus: center", center))));
            motion.rotate(Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(),
                                                             directionOf(axis, "torus: axis")));
            return solidShape(fmt::format("torus({},{})", ring, tube), "torus").moved(motion);
        },
        "ring_radius"_a, "tube_radius"_a, "center"_a = kZero, "axis"_a = "z",
        "A ring about axis ('x', 'y', 'z' or a vector) through center; world units.");
    define(
        module, "capsule", "capsule((0, 0, 0), (0, 0, 1), 0.1)",
        [](const Vec3d& a, const Vec3d& b, double radius) {
            return between("capsule", a, b, radius);
        },
        "a"_a, "b"_a, "radius"_a, "All places within radius of the line from a to b; world units.");
    define(
        module, "cylinder", "cylinder((0, 0, 0), (0, 0, 1), 0.1)",
        [](const Vec3d& a, const Vec3d& b, double radius) {
            return between("cylinder", a, b, radius);
        },
        "a"_a, "b"_a, "radius"_a, "A cylinder with its ends' middles at a and b; world units.");
    define(
        module, "cone", "cone((0, 0, 0), (0, 0, 1), 0.5)",
        [](const Vec3d& a, const Vec3d& b, double radius) { return between("cone", a, b, radius); },
        "a"_a, "b"_a, "radius"_a,
        "A cone with its base of radius about a and its apex at b; world units.");
}

void bindBoxes(py::module_& module)
{
    using Place = std::optional<Vec3d>;
    define(
        module, "box", "box((0, 0, 0), (1, 1, 1)) or box(size=(1, 1, 1))",
        [](const Place& low, const Place& high, const Place& center, const Place& size) {
            const Box3d box = boxOf(low, high, center, size);
            return at(box.center(),
                      solidShape(fmt::format("box({})", numbers(box.sizes())), "box"));
        },
        "low"_a = py::none(), "high"_a = py::none(), py::kw_only(), "center"_a = py::none(),
        "size"_a = py::none(),
        "A box along the axes, from low to high, or of size about center; world units.");
    define(
        module, "rounded_box",
        "rounded_box((0, 0, 0), (1, 1, 1), 0.1) or rounded_box(size=(1, 1, 1), radius=0.1)",
        [](const Place& low, const Place& high, double radius, const Place& center,
           const Place& size) {
            const Box3d box = boxOf(low, high, center, size);
            const double most = box.sizes().minCoeff() / 2;
            if (!(radius >= 0 && radius <= most))
                throw UsageError(fmt::format("rounded_box: radius is {}; it must be from 0 to {}, "
                                             "half the smallest side",
                                             radius, most));
            const std::string sizes = numbers(box.sizes());
            return at(box.center(),
                      solidShape(radius > 0 ? fmt::format("roundedbox({},{})", sizes, radius)
                                            : fmt::format("box({})", sizes),
                                 "rounded box"));
        },
        "low"_a = py::none(), "high"_a = py::none(), "radius"_a = 0.0, py::kw_only(),
        "center"_a = py::none(), "size"_a = py::none(),
        "A box along the axes whose edges are rounded with radius, up to half its smallest side.");
}

void bindOthers(py::module_& module)
{
    define(
        module, "half_space", "half_space((0, 0, 0), (0, 0, 1))",
        [](const Vec3d& point, const Vec3d& normal) {
            return Shape(makeHalfSpace(point, normal), "half-space");
        },
        "point"_a, "normal"_a,
        "All that lies behind a plane through point; normal points out. Without bounds: intersect "
        "it, or take it away from something.");
    define(
        module, "gyroid", "gyroid(1, 0.2)",
        [](double period, double thickness) {
            return Shape(makeGyroid(period, thickness), "gyroid");
        },
        "period"_a, "thickness"_a,
        "The wall of thickness along the gyroid that repeats after period; world units. Without "
        "bounds: intersect it with something.");
    define(
        module, "solid", "solid('sphere(1)')",
        [](const std::string& description) { return solidShape(description, "solid"); },
        "description"_a,
        ("A solid by a description such as 'difference(box(2,2,1), cylinder(0.4,3))':\n\n" +
         solidHelp())
            .c_str());
    define(
        module, "function", "function(lambda p: p[:, 2], ((-1, -1, -1), (1, 1, 1)), steepness=1)",
        [](const py::object& function, const Corners& bounds, double steepness) {
            const PointsCallable values(function, "function");
            return Shape(
                makeFunctionField(
                    [values](const std::vector<Vec3d>& points, std::vector<double>& result) {
                        values.values(points, result);
                    },
                    boxBetween(bounds.first, bounds.second),
                    positive("function: steepness", steepness)),
                "function");
        },
        "function"_a, "bounds"_a, "steepness"_a,
        "Wherever a function of your own is negative within bounds (low, high): what would leave "
        "them is cut off at their faces.\n\n"
        "function(points) gets an array (n, 3), which reaches some voxels beyond the bounds, and "
        "gives back n values. It is called from several threads, one at a time. steepness is the "
        "largest length of its gradient: with less, parts may be missed; with much more, the "
        "cut's edges and what touches the bounds are less exact.");
}

} // namespace

void bindPrimitives(py::module_& module)
{
    bindRound(module);
    bindBoxes(module);
    bindOthers(module);
}

} // namespace mpuvdb::python
