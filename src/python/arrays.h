// Numpy arrays in and out.
#pragma once
#include <mpuvdb/io.h>
#include <mpuvdb/point_input.h>
#include <mpuvdb/triangle_mesh.h>

#include <openvdb/openvdb.h>
#include <pybind11/numpy.h>

#include <string>
#include <vector>

namespace mpuvdb::python
{

/// Rows of three numbers, read where they are if they are floats or doubles of whatever strides;
/// else as a copy that is converted to doubles. @param what  for messages.
/// @throws UsageError unless @a array has the shape (n, 3).
std::vector<Vec3d> rowsOf(const pybind11::object& array, const char* what);

/// Numbers of an array, where they are if they are floats, doubles or bytes that lie side by side
/// in a row; else a copy as doubles. The array that holds them stays alive with this.
struct ArrayView {
    pybind11::array holder;
    NumberView numbers;
};
/// @param columns  numbers in a row. @throws UsageError unless @a array has the shape (n, columns),
/// or (n,) for one column.
ArrayView arrayViewOf(const pybind11::object& array, pybind11::ssize_t columns, const char* what);

/// A mesh about the middle of its vertices.
/// @throws UsageError unless the shapes are (n, 3) and (m, 3), with integers for the faces;
/// InputError for a vertex that is not finite, unless it is kept, or an index that is out of range.
Mesh meshOf(const pybind11::object& vertices, const pybind11::object& faces,
            BadVertices bad = BadVertices::Refuse);

/// What lies in @a data as an array of that shape which cannot be written to, without a copy;
/// @a owner keeps it alive.
template <class T>
pybind11::array viewOf(const T* data, const std::vector<pybind11::ssize_t>& shape,
                       const pybind11::handle& owner)
{
    pybind11::array_t<T> view(shape, data, owner);
    view.attr("flags").attr("writeable") = false;
    return std::move(view);
}

/// The active voxels of a float or Vec3f grid: indices (n, 3), and values (n,) or (n, 3).
pybind11::tuple activeVoxelsOf(const openvdb::GridBase& grid);

/// World positions of a mesh's vertices, (n, 3).
pybind11::array_t<double> worldVertices(const Mesh& mesh);

/// @a v as (3,).
pybind11::array_t<double> arrayOf(const Vec3d& v);

} // namespace mpuvdb::python
