#include "callables.h"

#include "run.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;

} // namespace

PointsCallable::PointsCallable(const py::object& function, const char* name) : mName(name)
{
    if (!PyCallable_Check(function.ptr()))
        throw UsageError(fmt::format("{}: cannot be called. Give a function of an array (n, 3) of "
                                     "points",
                                     name));
    mFunction = std::shared_ptr<const py::object>(new py::object(function), [](py::object* held) {
        const py::gil_scoped_acquire acquire;
        delete held;
    });
}

void PointsCallable::values(const std::vector<Vec3d>& points, std::vector<double>& values) const
{
    checkWork();
    const py::gil_scoped_acquire acquire;
    const py::array_t<double> result = call(points, 0);
    values.assign(result.data(), result.data() + points.size());
}

void PointsCallable::places(const std::vector<Vec3d>& points, std::vector<Vec3d>& places) const
{
    checkWork();
    const py::gil_scoped_acquire acquire;
    const py::array_t<double> result = call(points, 3);
    places.resize(points.size());
    std::copy_n(result.data(), 3 * points.size(), places.front().data());
}

py::array_t<double> PointsCallable::call(const std::vector<Vec3d>& points,
                                         py::ssize_t columns) const
{
    const auto count = py::ssize_t(points.size());
    // A copy: the function may keep it.
    const py::array_t<double> in({count, py::ssize_t(3)}, points.front().data());
    const py::object out = (*mFunction)(in);
    DoubleArray result = DoubleArray::ensure(out);
    if (!result) throw py::error_already_set();
    const bool fits = result.ndim() == (columns > 0 ? 2 : 1) && result.shape(0) == count &&
                      (columns == 0 || result.shape(1) == columns);
    if (!fits)
        throw InputError(fmt::format("{}: gave back an array of shape {} for {} points; it must be "
                                     "{}. It gets an array (n, 3): points[:, 0] are the x of all",
                                     mName, py::str(result.attr("shape")).cast<std::string>(),
                                     count, columns > 0 ? "(n, 3)" : "(n,)"));
    return std::move(result);
}

} // namespace mpuvdb::python
