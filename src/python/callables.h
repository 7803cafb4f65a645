// Python functions that the library calls, from any of its threads.
#pragma once
#include <mpuvdb/vec.h>

#include <pybind11/numpy.h>

#include <memory>
#include <vector>

namespace mpuvdb::python
{

/// A Python function of points, an array (n, 3) of doubles, n > 0. Copies may be called and
/// destroyed without the interpreter's lock.
class PointsCallable
{
public:
    /// @param name  for messages. @throws UsageError unless @a function can be called.
    PointsCallable(const pybind11::object& function, const char* name);

    /// Its values, (n,). @throws InputError for another shape; what the function raises.
    void values(const std::vector<Vec3d>& points, std::vector<double>& values) const;
    /// Its places, (n, 3).
    void places(const std::vector<Vec3d>& points, std::vector<Vec3d>& places) const;

private:
    /// What it gives back, as doubles of the shape (n, columns), or (n,) for no column.
    pybind11::array_t<double> call(const std::vector<Vec3d>& points,
                                   pybind11::ssize_t columns) const;

    std::shared_ptr<const pybind11::object> mFunction;
    const char* mName;
};

} // namespace mpuvdb::python
