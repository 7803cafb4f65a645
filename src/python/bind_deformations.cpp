// Shapes moved and deformed.
#include "arguments.h"
#include "bindings.h"
#include "callables.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <pybind11/stl.h>

#include <cmath>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

constexpr double kRadians = M_PI / 180;

#define MPUVDB_AXIS_DOC                                                                            \
    " axis is 'x', 'y', 'z', '-x' and so on, or a vector; it passes through origin, (0, 0, 0) "    \
    "unless given."

/// @a motion about @a origin.
Eigen::Affine3d about(const Vec3d& origin, const Eigen::Matrix3d& motion)
{
    return Eigen::Translation3d(origin) * motion * Eigen::Translation3d(-origin);
}

/// Where along @a axis a deformation begins and ends: as told, else as far as the shape's box goes.
std::pair<double, double> span(const char* what, const Shape& shape, const Axis& axis,
                               std::optional<double> start, std::optional<double> end)
{
    const Box3d box = shape.bounds();
    double low = 0, high = 0;
    if (!box.isEmpty()) {
        const Vec3d along = axis.direction.normalized();
        const double middle = along.dot(box.center() - axis.origin);
        const double half = along.cwiseAbs().dot(box.sizes()) / 2;
        low = middle - half;
        high = middle + half;
    }
    if (!std::isfinite(low) && !(start && end))
        throw UsageError(fmt::format("{}: the shape has no bounds along the axis: give start and "
                                     "end",
                                     what));
    const auto result = std::make_pair(start.value_or(low), end.value_or(high));
    if (!(result.first < result.second) || !std::isfinite(result.first) ||
        !std::isfinite(result.second))
        throw UsageError(
            fmt::format("{}: start is {} and end is {}; start must be the smaller, and "
                        "both finite",
                        what, result.first, result.second));
    return result;
}

/// May call Python functions from other threads.
Shape warped(const Shape& shape, const std::shared_ptr<const Warp>& warp, const char* name)
{
    const py::gil_scoped_release release;
    return shape.warped(warp, name);
}

Shape moved(const Shape& shape, const Eigen::Affine3d& motion)
{
    const py::gil_scoped_release release;
    return shape.moved(motion);
}

void bindMotions(ShapeClass& shapes)
{
    shapes
        .def(
            "translate",
            [](const Shape& shape, const Vec3d& by) {
                return moved(shape,
                             Eigen::Affine3d(Eigen::Translation3d(finite("translate: by", by))));
            },
            "by"_a, "Moved by a vector, world units.")
        .def(
            "rotate",
            [](const Shape& shape, double degrees, const AxisArgument& axis, const Vec3d& origin) {
                const Vec3d along = directionOf(axis, "rotate: axis").normalized();
                const double angle = finite("rotate: degrees", degrees) * kRadians;
                return moved(shape, about(finite("rotate: origin", origin),
                                          Eigen::AngleAxisd(angle, along).toRotationMatrix()));
            },
            "degrees"_a, "axis"_a = "z", "origin"_a = kZero,
            "Turned by degrees, counter-clockwise seen against the axis." MPUVDB_AXIS_DOC)
        .def(
            "scale",
            [](const Shape& shape, const std::variant<double, Vec3d>& factor, const Vec3d& origin) {
                const auto* one = std::get_if<double>(&factor);
                const Vec3d factors = one ? Vec3d::Constant(*one) : std::get<Vec3d>(factor);
                if (!factors.allFinite() || !(factors.cwiseAbs().minCoeff() > 0))
                    throw UsageError(fmt::format("scale: factor is ({}, {}, {}); it must be finite "
                                                 "and not 0 along any axis",
                                                 factors[0], factors[1], factors[2]));
                return moved(shape, about(finite("scale: origin", origin),
                                          factors.asDiagonal().toDenseMatrix()));
            },
            "factor"_a, "origin"_a = kZero,
            "Scaled about origin by a number, or by one for each axis.")
        .def(
            "transform",
            [](const Shape& shape, const Eigen::Matrix4d& matrix) {
                if (matrix.row(3) != Eigen::RowVector4d(0, 0, 0, 1))
                    throw UsageError("matrix: its last row must be 0 0 0 1: translations stand in "
                                     "the last column");
                return moved(shape, Eigen::Affine3d(matrix));
            },
            "matrix"_a, "Moved by an affine 4 x 4 matrix, of column vectors.");
}

void bindWarps(ShapeClass& shapes)
{
    shapes
        .def(
            "twist",
            [](const Shape& shape, double degrees, const AxisArgument& axis, const Vec3d& origin) {
                const Axis about{finite("twist: origin", origin), directionOf(axis, "twist: axis")};
                const double angle = finite("twist: degrees_per_unit", degrees) * kRadians;
                return warped(shape, makeTwist(about, angle), "twist");
            },
            "degrees_per_unit"_a, "axis"_a = "z", "origin"_a = kZero,
            "Turned about an axis by degrees per world unit along it." MPUVDB_AXIS_DOC)
        .def(
            "bend",
            [](const Shape& shape, double degrees, const AxisArgument& axis,
               const AxisArgument& side, std::optional<double> start, std::optional<double> end,
               const Vec3d& origin) {
                const Axis along{finite("bend: origin", origin), directionOf(axis, "bend: axis")};
                const auto [from, to] = span("bend", shape, along, start, end);
                const double most = 360 / (to - from);
                if (!(std::abs(degrees) <= most))
                    throw UsageError(fmt::format("bend: degrees_per_unit is {}; over a length of "
                                                 "{} it must be within {} to {}, a full circle",
                                                 degrees, to - from, -most, most));
                const Vec3d towards = directionOf(side, "bend: side");
                return warped(shape, makeBend(along, towards, degrees * kRadians, from, to),
                              "bend");
            },
            "degrees_per_unit"_a, "axis"_a = "z", "side"_a = "x", "start"_a = py::none(),
            "end"_a = py::none(), "origin"_a = kZero,
            "What lies along the axis bent into a circle towards side, by degrees per world unit, "
            "between start and end (world units along the axis from origin; the shape's bounds "
            "unless given); beyond it goes on straight." MPUVDB_AXIS_DOC)
        .def(
            "taper",
            [](const Shape& shape, double startFactor, double endFactor, const AxisArgument& axis,
               std::optional<double> start, std::optional<double> end, const Vec3d& origin) {
                const Axis along{finite("taper: origin", origin), directionOf(axis, "taper: axis")};
                const auto [from, to] = span("taper", shape, along, start, end);
                positive("taper: start_factor", startFactor);
                positive("taper: end_factor", endFactor);
                return warped(shape, makeTaper(along, from, to, startFactor, endFactor), "taper");
            },
            "start_factor"_a, "end_factor"_a, "axis"_a = "z", "start"_a = py::none(),
            "end"_a = py::none(), "origin"_a = kZero,
            "Scaled across the axis by a factor that goes from start_factor to end_factor between "
            "start and end (world units along the axis from origin; the shape's bounds unless "
            "given)." MPUVDB_AXIS_DOC)
        .def(
            "warp",
            [](const Shape& shape, const py::object& inverse, const Corners& bounds,
               double stretch) {
                const PointsCallable function(inverse, "inverse");
                const Box3d image = boxBetween(bounds.first, bounds.second);
                positive("warp: stretch", stretch);
                return warped(
                    shape,
                    makeWarp(
                        [function](const std::vector<Vec3d>& points, std::vector<Vec3d>& from) {
                            function.places(points, from);
                        },
                        [image](const Box3d&) { return image; }, stretch),
                    "warp");
            },
            "inverse"_a, "bounds"_a, "stretch"_a,
            "Deformed by a function of your own: inverse(points) gets an array (n, 3) of places "
            "and gives back, as (n, 3), the places that they come from. bounds (low, high) is a "
            "box around the result: it does not cut, and what reaches beyond it may be lost. "
            "stretch is the largest factor by which inverse stretches a length, anywhere in it. "
            "Called from several threads, one at a time.");
}

} // namespace

void bindDeformations(ShapeClass& shapes)
{
    bindMotions(shapes);
    bindWarps(shapes);
}

} // namespace mpuvdb::python
