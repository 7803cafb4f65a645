#include "arrays.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// The active voxels of @a grid: indices (n, 3) and @a channels numbers for each.
template <class Grid>
py::tuple activeVoxels(const Grid& grid, py::ssize_t channels)
{
    const auto count = py::ssize_t(grid.activeVoxelCount());
    py::array_t<std::int32_t> indices({count, py::ssize_t(3)});
    py::array_t<float> values(channels == 1 ? std::vector<py::ssize_t>{count}
                                            : std::vector<py::ssize_t>{count, channels});
    std::int32_t* index = indices.mutable_data();
    float* value = values.mutable_data();
    for (auto voxel = grid.cbeginValueOn(); voxel; ++voxel) {
        const openvdb::Coord at = voxel.getCoord();
        for (int axis = 0; axis < 3; ++axis) *index++ = at[axis];
        if constexpr (std::is_same_v<typename Grid::ValueType, float>)
            *value++ = *voxel;
        else
            for (int channel = 0; channel < 3; ++channel) *value++ = (*voxel)[channel];
    }
    return py::make_tuple(indices, values);
}

constexpr std::size_t kRowsPerTask = 1 << 15;

template <class F>
void forRows(std::size_t rows, F&& f)
{
    const py::gil_scoped_release release;
    tbb::parallel_for(std::size_t(0), (rows + kRowsPerTask - 1) / kRowsPerTask, [&](std::size_t t) {
        const std::size_t end = std::min((t + 1) * kRowsPerTask, rows);
        for (std::size_t i = t * kRowsPerTask; i < end; ++i) f(i);
    });
}

[[noreturn]] void throwShape(const py::array& array, const char* what, const char* wanted)
{
    throw UsageError(fmt::format("{}: an array of shape {}; it must be {}", what,
                                 py::str(array.attr("shape")).cast<std::string>(), wanted));
}

/// Three numbers per row of @a from.
template <class From>
std::vector<Vec3d> convertRows(const py::array& from)
{
    const py::array_t<From> typed(from); // the same memory: it has this type
    const auto in = typed.template unchecked<2>();
    std::vector<Vec3d> rows(std::size_t(in.shape(0)));
    forRows(rows.size(), [&](std::size_t i) {
        const auto at = py::ssize_t(i);
        rows[i] = {double(in(at, 0)), double(in(at, 1)), double(in(at, 2))};
    });
    return rows;
}

py::array asArray(const py::object& object, const char* what)
{
    py::array array = py::array::ensure(object);
    if (!array) {
        PyErr_Clear();
        throw UsageError(fmt::format("{}: is no array of numbers", what));
    }
    return array;
}

/// @a array itself if it has one of our types, else converted.
py::array asNumbers(const py::array& array, const char* what)
{
    if (py::isinstance<py::array_t<float>>(array) || py::isinstance<py::array_t<double>>(array))
        return array;
    py::array numbers = py::array_t<double, py::array::forcecast>::ensure(array);
    if (!numbers) {
        PyErr_Clear();
        throw UsageError(fmt::format("{}: is no array of numbers", what));
    }
    return numbers;
}

std::vector<Mesh::Triangle> trianglesOf(const py::object& object, std::size_t vertices)
{
    const py::array array = asArray(object, "faces");
    if (array.ndim() != 2 || array.shape(1) != 3) throwShape(array, "faces", "(m, 3)");
    const char kind = array.dtype().kind();
    if (kind != 'i' && kind != 'u') throw UsageError("faces: must be an array of integers");
    std::vector<Mesh::Triangle> triangles(std::size_t(array.shape(0)));
    const auto convert = [&](const auto& in) {
        std::atomic<bool> outside{false};
        forRows(triangles.size(), [&](std::size_t i) {
            for (int corner = 0; corner < 3; ++corner) {
                const auto vertex = in(py::ssize_t(i), corner);
                if (vertex < 0 || std::uint64_t(vertex) >= vertices) outside = true;
                triangles[i][std::size_t(corner)] = std::uint32_t(vertex);
            }
        });
        if (outside)
            throw InputError(fmt::format("faces: an index is outside of [0, {}), the vertices that "
                                         "there are",
                                         vertices));
    };
    if (py::isinstance<py::array_t<std::uint32_t>>(array))
        convert(py::array_t<std::uint32_t>(array).unchecked<2>());
    else
        convert(py::array_t<std::int64_t, py::array::forcecast>(array).unchecked<2>());
    return triangles;
}

} // namespace

std::vector<Vec3d> rowsOf(const py::object& array, const char* what)
{
    const py::array numbers = asNumbers(asArray(array, what), what);
    if (numbers.ndim() != 2 || numbers.shape(1) != 3) throwShape(numbers, what, "(n, 3)");
    return py::isinstance<py::array_t<float>>(numbers) ? convertRows<float>(numbers)
                                                       : convertRows<double>(numbers);
}

ArrayView arrayViewOf(const py::object& object, py::ssize_t columns, const char* what)
{
    py::array array = asArray(object, what);
    const bool isBytes = py::isinstance<py::array_t<std::uint8_t>>(array);
    if (!isBytes) array = asNumbers(array, what);
    const bool isTable = array.ndim() == 2 && array.shape(1) == columns;
    const bool isColumn = array.ndim() == 1 && columns == 1;
    if (!isTable && !isColumn)
        throwShape(array, what, columns == 1 ? "(n,)" : fmt::format("(n, {})", columns).c_str());
    const bool isFloat = py::isinstance<py::array_t<float>>(array);
    const bool sideBySide = isColumn || array.strides(1) == array.itemsize();
    if (!sideBySide || array.strides(0) < 0) array = py::array(array.attr("copy")("C"));
    const auto rows = std::size_t(array.shape(0)), stride = std::size_t(array.strides(0));
    const auto width = std::size_t(columns);
    const void* const data = array.data();
    NumberView numbers;
    if (rows > 0)
        numbers = isBytes ? NumberView(static_cast<const std::uint8_t*>(data), rows, width, stride)
                  : isFloat ? NumberView(static_cast<const float*>(data), rows, width, stride)
                            : NumberView(static_cast<const double*>(data), rows, width, stride);
    return {std::move(array), numbers};
}

Mesh meshOf(const py::object& vertices, const py::object& faces, BadVertices bad)
{
    const std::vector<Vec3d> places = rowsOf(vertices, "vertices");
    Box3d box;
    for (const Vec3d& p : places) {
        if (p.allFinite())
            box.extend(p);
        else if (bad == BadVertices::Refuse)
            throw InputError("vertices: one of them is not finite. Remove it, or repair the mesh: "
                             "repair=True leaves out its triangles");
    }
    Mesh mesh;
    if (!box.isEmpty()) mesh.frame = box.center();
    mesh.positions.resize(places.size());
    forRows(places.size(),
            [&](std::size_t i) { mesh.positions[i] = (places[i] - mesh.frame).cast<float>(); });
    mesh.triangles = trianglesOf(faces, places.size());
    return mesh;
}

py::array_t<double> worldVertices(const Mesh& mesh)
{
    py::array_t<double> vertices({py::ssize_t(mesh.positions.size()), py::ssize_t(3)});
    double* const out = vertices.mutable_data();
    forRows(mesh.positions.size(),
            [&](std::size_t i) { Eigen::Map<Vec3d>(out + 3 * i) = mesh.world(i); });
    return vertices;
}

py::array_t<double> arrayOf(const Vec3d& v)
{
    return py::array_t<double>(3, v.data());
}

py::tuple activeVoxelsOf(const openvdb::GridBase& grid)
{
    if (const auto* const colors = dynamic_cast<const openvdb::Vec3SGrid*>(&grid))
        return activeVoxels(*colors, 3);
    return activeVoxels(dynamic_cast<const openvdb::FloatGrid&>(grid), 1);
}

} // namespace mpuvdb::python
