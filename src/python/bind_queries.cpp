// Questions to level sets and shapes at arrays of places.
#include "arrays.h"
#include "bindings.h"
#include "evaluation.h"
#include "run.h"

#include <mpuvdb/queries.h>

#include <pybind11/stl.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

using QueriesPtr = std::shared_ptr<const Queries>;
/// What answers, made while the interpreter's lock is free.
using MakeQueries = std::function<QueriesPtr(Interrupter&)>;

/// The attribute of a solid that keeps what answered the last question, and its voxel size.
constexpr const char* kKept = "_queries";

/// Of @a self, what was kept, or what is made now.
class Source
{
public:
    Source(py::object self, double voxelSize, MakeQueries make)
        : mSelf(std::move(self)), mVoxelSize(voxelSize), mMake(std::move(make))
    {
        if (!py::hasattr(mSelf, kKept)) return;
        const auto kept = mSelf.attr(kKept).cast<QueriesPtr>();
        if (kept->levelSet().voxelSize() == mVoxelSize) mQueries = kept;
    }

    /// Does @a ask(queries, interrupter) on another thread, and keeps what answered.
    template <class Ask>
    void run(const py::object& progress, const Ask& ask)
    {
        runWork(progress, [&](Interrupter& p) {
            if (!mQueries) mQueries = mMake(p);
            ask(*mQueries, p);
        });
        mSelf.attr(kKept) = py::cast(std::const_pointer_cast<Queries>(mQueries));
    }

private:
    py::object mSelf;
    double mVoxelSize;
    MakeQueries mMake;
    QueriesPtr mQueries;
};

Source sourceOf(const py::object& self, const LevelSet& levelSet)
{
    return {self, levelSet.voxelSize(),
            [&levelSet](Interrupter&) { return std::make_shared<Queries>(levelSet); }};
}

Source sourceOf(const py::object& self, const Shape& shape, const VoxelSize& voxelSize)
{
    const ShapeSettings settings = settingsToWork(shape, voxelSize, 3, {});
    return {self, settings.voxelSize, [&shape, settings](Interrupter& p) {
                return std::make_shared<Queries>(evaluated(shape, settings, p), shape.field());
            }};
}

/// Rows of three numbers for @a count places, to be filled.
struct Rows {
    py::array_t<double> array;
    Vec3d* first;

    explicit Rows(std::size_t count)
        : array({py::ssize_t(count), py::ssize_t(3)}),
          first(reinterpret_cast<Vec3d*>(array.mutable_data()))
    {
    }
};

py::object distances(Source source, const py::object& points, const py::object& progress)
{
    const ArrayView view = arrayViewOf(points, 3, "points");
    py::array_t<double> result{py::ssize_t(view.numbers.rows)};
    double* const to = result.mutable_data();
    source.run(progress,
               [&](const Queries& q, Interrupter& p) { q.distances(view.numbers, to, &p); });
    return std::move(result);
}

py::object gradients(Source source, const py::object& points, const py::object& progress)
{
    const ArrayView view = arrayViewOf(points, 3, "points");
    const Rows rows(view.numbers.rows);
    std::vector<double> unused(view.numbers.rows);
    source.run(progress, [&](const Queries& q, Interrupter& p) {
        q.distances(view.numbers, unused.data(), rows.first, &p);
    });
    return rows.array;
}

py::object closestPoints(Source source, const py::object& points, const py::object& progress)
{
    const ArrayView view = arrayViewOf(points, 3, "points");
    const Rows rows(view.numbers.rows);
    source.run(progress, [&](const Queries& q, Interrupter& p) {
        q.closestPoints(view.numbers, rows.first, &p);
    });
    return rows.array;
}

py::object contains(Source source, const py::object& points, const py::object& progress)
{
    const ArrayView view = arrayViewOf(points, 3, "points");
    py::array_t<bool> result{py::ssize_t(view.numbers.rows)};
    auto* const to = reinterpret_cast<std::uint8_t*>(result.mutable_data());
    source.run(progress,
               [&](const Queries& q, Interrupter& p) { q.contains(view.numbers, to, &p); });
    return std::move(result);
}

py::object raycast(Source source, const py::object& origins, const py::object& directions,
                   const py::object& progress)
{
    const ArrayView from = arrayViewOf(origins, 3, "origins");
    const ArrayView along = arrayViewOf(directions, 3, "directions");
    py::array_t<double> hits{py::ssize_t(from.numbers.rows)};
    double* const to = hits.mutable_data();
    const Rows normals(from.numbers.rows);
    source.run(progress, [&](const Queries& q, Interrupter& p) {
        q.raycast(from.numbers, along.numbers, to, normals.first, &p);
    });
    return py::make_tuple(hits, normals.array);
}

#define MPUVDB_PLACES_DOC " points: (n, 3), world units, floats or doubles of any strides."
#define MPUVDB_DISTANCE_DOC                                                                        \
    "Signed distances (n,) from points to the surface, world units, negative inside: anywhere in " \
    "space, creases and ridges included. In the band, smooth surfaces of radius r > 7 voxels are " \
    "exact to about 0.02 / r^2 voxels. NaN for a point that is not finite; infinite if there is "  \
    "no surface." MPUVDB_PLACES_DOC
#define MPUVDB_GRADIENT_DOC                                                                        \
    "Gradients (n, 3) of the signed distance at points: unit vectors from the nearest place of "   \
    "the surface outside, to it inside; on the surface its normals." MPUVDB_PLACES_DOC
#define MPUVDB_CLOSEST_DOC                                                                         \
    "The places (n, 3) of the surface that are nearest to points, world units. NaN for a point "   \
    "that is not finite, or if there is no surface." MPUVDB_PLACES_DOC
#define MPUVDB_CONTAINS_DOC "Whether points are inside: bool (n,)." MPUVDB_PLACES_DOC
#define MPUVDB_RAYCAST_DOC                                                                         \
    "(hits, normals) of rays from origins (n, 3) along directions (n, 3) of any length: they "     \
    "first meet the surface, from either side, at origins + hits * directions; hits (n,) is "      \
    "infinite where they miss. normals (n, 3) are outward unit vectors there, NaN where they "     \
    "miss."
#define MPUVDB_KEPT_DOC                                                                            \
    "\n\nWhat the first question needed is kept with the object for the next ones."
#define MPUVDB_VOXELS_DOC                                                                          \
    " The shape is sampled first; voxel_size is that of level_set()." MPUVDB_KEPT_DOC

void bindToLevelSet(LevelSetClass& levelSets)
{
    const auto def = [&](const char* name, auto answer, const std::string& doc) {
        levelSets.def(
            name,
            [answer](const py::object& self, const py::object& points, const py::object& progress) {
                return answer(sourceOf(self, self.cast<const LevelSet&>()), points, progress);
            },
            "points"_a, "progress"_a = py::none(),
            (doc + MPUVDB_KEPT_DOC MPUVDB_PROGRESS_DOC).c_str());
    };
    def("distance", distances, MPUVDB_DISTANCE_DOC);
    def("gradient", gradients, MPUVDB_GRADIENT_DOC);
    def("closest_points", closestPoints, MPUVDB_CLOSEST_DOC);
    def("contains", contains, MPUVDB_CONTAINS_DOC);
    levelSets.def(
        "raycast",
        [](const py::object& self, const py::object& origins, const py::object& directions,
           const py::object& progress) {
            return raycast(sourceOf(self, self.cast<const LevelSet&>()), origins, directions,
                           progress);
        },
        "origins"_a, "directions"_a, "progress"_a = py::none(),
        MPUVDB_RAYCAST_DOC MPUVDB_KEPT_DOC MPUVDB_PROGRESS_DOC);
}

void bindToShape(ShapeClass& shapes)
{
    const auto def = [&](const char* name, auto answer, const std::string& doc) {
        shapes.def(
            name,
            [answer](const py::object& self, const py::object& points, const VoxelSize& voxelSize,
                     const py::object& progress) {
                return answer(sourceOf(self, self.cast<const Shape&>(), voxelSize), points,
                              progress);
            },
            "points"_a, "voxel_size"_a = py::none(), "progress"_a = py::none(),
            (doc + MPUVDB_VOXELS_DOC MPUVDB_PROGRESS_DOC).c_str());
    };
    def("distance", distances, MPUVDB_DISTANCE_DOC);
    def("gradient", gradients, MPUVDB_GRADIENT_DOC);
    def("closest_points", closestPoints, MPUVDB_CLOSEST_DOC);
    def("contains", contains, MPUVDB_CONTAINS_DOC);
    shapes.def(
        "raycast",
        [](const py::object& self, const py::object& origins, const py::object& directions,
           const VoxelSize& voxelSize, const py::object& progress) {
            return raycast(sourceOf(self, self.cast<const Shape&>(), voxelSize), origins,
                           directions, progress);
        },
        "origins"_a, "directions"_a, "voxel_size"_a = py::none(), "progress"_a = py::none(),
        MPUVDB_RAYCAST_DOC MPUVDB_VOXELS_DOC MPUVDB_PROGRESS_DOC);
}

} // namespace

void bindQueries(py::module_& module, LevelSetClass& levelSets, ShapeClass& shapes)
{
    const py::class_<Queries, std::shared_ptr<Queries>> kept(module, "_Queries");
    bindToLevelSet(levelSets);
    bindToShape(shapes);
}

} // namespace mpuvdb::python
