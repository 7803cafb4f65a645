#include "arguments.h"

#include "arrays.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cmath>

namespace mpuvdb::python
{
namespace py = pybind11;

Length lengthOf(const LengthArgument& argument)
{
    if (const auto* text = std::get_if<std::string>(&argument)) return Length::parse(*text);
    return Length{std::get<double>(argument), Length::Unit::World};
}

namespace
{

std::string textOf(const Vec3d& v)
{
    return fmt::format("({}, {}, {})", v[0], v[1], v[2]);
}

} // namespace

double finite(const std::string& what, double value)
{
    if (!std::isfinite(value))
        throw UsageError(fmt::format("{} is {}; it must be finite", what, value));
    return value;
}

Vec3d finite(const std::string& what, const Vec3d& value)
{
    if (!value.allFinite())
        throw UsageError(fmt::format("{} is {}; all three must be finite", what, textOf(value)));
    return value;
}

double positive(const std::string& what, double value)
{
    if (!(value > 0) || !std::isfinite(value))
        throw UsageError(fmt::format("{} is {}; it must be above 0 and finite", what, value));
    return value;
}

Vec3d positive(const std::string& what, const Vec3d& value)
{
    if (!(value.minCoeff() > 0) || !value.allFinite())
        throw UsageError(
            fmt::format("{} is {}; all three must be above 0 and finite", what, textOf(value)));
    return value;
}

double worldLength(const LengthArgument& argument, const Scale& scale)
{
    const Length length = lengthOf(argument);
    if (length.unit == Length::Unit::Voxels && !(scale.voxelSize > 0))
        throw UsageError(fmt::format("'{}': a shape has no voxels before it is evaluated. Give "
                                     "world units or a part of the diagonal (0.1%), or work on a "
                                     "LevelSet",
                                     length.text()));
    const bool bounded =
        !scale.box.isEmpty() && scale.box.min().allFinite() && scale.box.max().allFinite();
    if (length.unit == Length::Unit::Percent && !bounded)
        throw UsageError(fmt::format("'{}': this has no bounds whose diagonal it could be a part "
                                     "of. Give world units",
                                     length.text()));
    return length.resolve(scale.voxelSize, bounded ? scale.box.diagonal().norm() : 0);
}

Vec3d directionOf(const AxisArgument& argument, const char* what)
{
    if (const auto* name = std::get_if<std::string>(&argument))
        return choose<Vec3d>(*name, what,
                             {{"x", Vec3d::UnitX()},
                              {"y", Vec3d::UnitY()},
                              {"z", Vec3d::UnitZ()},
                              {"-x", -Vec3d::UnitX()},
                              {"-y", -Vec3d::UnitY()},
                              {"-z", -Vec3d::UnitZ()}});
    const Vec3d& direction = std::get<Vec3d>(argument);
    if (!direction.allFinite() || direction.isZero(0))
        throw UsageError(fmt::format("{} is {}; a direction must be finite and not zero", what,
                                     textOf(direction)));
    return direction;
}

void throwChoice(const std::string& word, const char* what, const std::string& words)
{
    throw UsageError(fmt::format("{}: '{}' is none of: {}", what, word, words));
}

Box3d boxBetween(const Vec3d& low, const Vec3d& high)
{
    if (!(low.array() < high.array()).all() || !low.allFinite() || !high.allFinite())
        throw UsageError(fmt::format("a box from {} to {} holds nothing, or has no end: low must "
                                     "be below high on each axis, and both finite",
                                     textOf(low), textOf(high)));
    return {low, high};
}

py::object cornersOf(const Box3d& box)
{
    if (box.isEmpty()) return py::none();
    return py::make_tuple(arrayOf(box.min()), arrayOf(box.max()));
}

std::optional<std::vector<std::filesystem::path>> pathsOf(const py::object& source)
{
    using Path = std::filesystem::path;
    py::detail::make_caster<std::variant<Path, std::vector<Path>>> caster;
    if (py::isinstance<py::array>(source) || !caster.load(source, true)) return std::nullopt;
    const auto named = py::detail::cast_op<std::variant<Path, std::vector<Path>>>(caster);
    if (const auto* const one = std::get_if<Path>(&named)) return std::vector<Path>{*one};
    return std::get<std::vector<Path>>(named);
}

} // namespace mpuvdb::python
