// Shapes from data: points, meshes, level sets.
#include "arguments.h"
#include "arrays.h"
#include "bindings.h"
#include "run.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

using Path = std::filesystem::path;
using PathOrPaths = std::variant<Path, std::vector<Path>>;

/// How points are read and fitted.
struct PointsRequest {
    BadPoints badPoints = BadPoints::Drop;
    CleanSettings clean;
    ReconstructSettings fit;
};

/// What came of them.
struct FittedPoints {
    FieldPtr field;
    std::vector<std::string> notes, warnings;
    CleanReport cleaned;
};

FittedPoints fit(PointInput input, PointsRequest request, Interrupter& progress)
{
    FittedPoints made;
    made.notes = std::move(input.notes);
    made.warnings = std::move(input.warnings);
    for (const auto& [reason, count] : input.dropped)
        made.notes.push_back(fmt::format("{} points left out: {}", count, reason));
    made.cleaned = clean(input.cloud, request.clean, &progress);
    request.fit.points = made.cleaned.statistics;
    const ResolvedSettings settings = resolve(input.cloud, request.fit, &progress);
    made.field = std::make_shared<MpuField>(std::move(input.cloud), settings.fit, &progress);
    return made;
}

void warn(const std::string& text)
{
    if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 1) != 0) throw py::error_already_set();
}

/// Notes go where Python's programs expect them; what is likely wrong is a warning.
void tell(const FittedPoints& made)
{
    const py::object log = py::module_::import("logging").attr("getLogger")("mpuvdb");
    const auto note = [&](const std::string& text) { log.attr("info")("%s", text); };
    for (const std::string& text : made.notes) note(text);
    const CleanReport& cleaned = made.cleaned;
    if (cleaned.outliers > 0) note(fmt::format("{} outliers left out", cleaned.outliers));
    if (cleaned.estimateNeighbors)
        note(fmt::format("normals estimated from {} neighbors each", *cleaned.estimateNeighbors));
    if (cleaned.flipped > 0)
        note(fmt::format("{} normals looked the wrong way and were turned", cleaned.flipped));
    for (const std::string& warning : made.warnings) warn(warning);
    if (cleaned.turned > 0)
        note(fmt::format("{} normals looked inward and were turned; orient='keep' leaves them",
                         cleaned.turned));
    if (cleaned.guessesNormals())
        warn(fmt::format("{:.0f} % of the points have neighbors on one line only, which tell no "
                         "plane: their normals are guessed; give normals, or lines that lie closer",
                         100 * cleaned.onLines));
    if (cleaned.inward)
        warn("the normals point inward, so that inside and outside are exchanged; "
             "flip_normals=True turns them, unless it did so already");
}

PointArrays arraysOf(const py::object& points, const py::object& normals,
                     const py::object& confidence, const std::vector<Vec3d>& viewpoints)
{
    PointArrays arrays;
    arrays.positions = rowsOf(points, "points");
    if (!normals.is_none()) arrays.normals = floatRowsOf(normals, "normals");
    if (!confidence.is_none()) arrays.confidence = columnOf(confidence, "confidence");
    if (viewpoints.size() > 1) throw UsageError("viewpoint: an array of points has one, or none");
    if (!viewpoints.empty()) arrays.viewpoint = viewpoints.front();
    return arrays;
}

std::optional<PathOrPaths> pathsOf(const py::object& source)
{
    py::detail::make_caster<PathOrPaths> caster;
    if (py::isinstance<py::array>(source) || !caster.load(source, true)) return std::nullopt;
    return py::detail::cast_op<PathOrPaths>(caster);
}

std::vector<Vec3d> placesOf(const py::object& viewpoint)
{
    if (viewpoint.is_none()) return {};
    py::detail::make_caster<Vec3d> one;
    if (one.load(viewpoint, true)) return {py::detail::cast_op<Vec3d>(one)};
    return rowsOf(viewpoint, "viewpoint");
}

FittedPoints fittedPoints(const py::object& source, const py::object& normals,
                          const py::object& confidence, const py::object& viewpoint,
                          const PointsRequest& request, const py::object& progress)
{
    const std::vector<Vec3d> viewpoints = placesOf(viewpoint);
    if (const auto paths = pathsOf(source)) {
        if (!normals.is_none() || !confidence.is_none())
            throw UsageError("normals and confidence go with an array of points: files bring "
                             "their own");
        const auto* one = std::get_if<Path>(&*paths);
        const std::vector<Path> files =
            one ? std::vector<Path>{*one} : std::get<std::vector<Path>>(*paths);
        return run(progress, [&](Interrupter& p) {
            return fit(readPoints(files, request.badPoints, viewpoints, {}, &p), request, p);
        });
    }
    PointArrays arrays = arraysOf(source, normals, confidence, viewpoints);
    return run(progress, [&](Interrupter& p) {
        return fit(importPoints(std::move(arrays), "points", request.badPoints, &p), request, p);
    });
}

void bindPoints(py::module_& module)
{
    module.def(
        "points",
        [](const py::object& source, const py::object& normals, const py::object& confidence,
           const std::optional<LengthArgument>& tolerance,
           const std::optional<LengthArgument>& voxelSize, const py::object& viewpoint,
           const std::string& orient, const std::string& outliers, bool flipNormals,
           const std::string& badPoints, std::optional<double> alpha, std::optional<int> minPoints,
           bool sharp, bool interpolate, const py::object& progress) {
            PointsRequest request;
            request.badPoints = choose<BadPoints>(
                badPoints, "bad_points", {{"drop", BadPoints::Drop}, {"fail", BadPoints::Fail}});
            request.clean.normals = choose<NormalsFrom>(orient, "orient",
                                                        {{"auto", NormalsFrom::Auto},
                                                         {"keep", NormalsFrom::Keep},
                                                         {"estimate", NormalsFrom::Estimate}});
            request.clean.dropOutliers =
                choose<bool>(outliers, "outliers", {{"drop", true}, {"keep", false}});
            request.clean.flipNormals = flipNormals;
            if (tolerance) request.fit.tolerance = lengthOf(*tolerance);
            if (voxelSize) request.fit.voxelSize = lengthOf(*voxelSize);
            request.fit.alpha = alpha;
            request.fit.minPoints = minPoints;
            request.fit.sharp = sharp;
            request.fit.interpolate = interpolate;
            const FittedPoints made =
                fittedPoints(source, normals, confidence, viewpoint, request, progress);
            tell(made);
            return Shape(made.field, "points");
        },
        "source"_a, "normals"_a = py::none(), py::kw_only(), "confidence"_a = py::none(),
        "tolerance"_a = py::none(), "voxel_size"_a = py::none(), "viewpoint"_a = py::none(),
        "orient"_a = "auto", "outliers"_a = "drop", "flip_normals"_a = false,
        "bad_points"_a = "drop", "alpha"_a = py::none(), "min_points"_a = py::none(),
        "sharp"_a = true, "interpolate"_a = false, "progress"_a = py::none(),
        "The solid that points on its surface bound: read, cleaned and fitted at once.\n\n"
        "source: a file, a list of files, or an array (n, 3) of float32 or float64, read in place, "
        "world units; to it normals (n, 3), outward, and confidence (n,).\n"
        "tolerance: largest distance of a local fit from its points, world units, '0.1%' of the "
        "points' diagonal or '0.2vx'; None: from their spacing and measured noise.\n"
        "voxel_size: the finest that the fit is for; None: the measured spacing.\n"
        "viewpoint: where the scanner stood, (3,), or (n, 3) for n files, world units.\n"
        "orient: 'auto' turns normals that are flipped among the others, or all those of a closed "
        "solid, and estimates where there are none; 'keep' leaves them; 'estimate' always "
        "estimates.\n"
        "outliers: 'drop' or 'keep'. bad_points: 'drop' or 'fail' at the first that is not finite "
        "or has no normal. flip_normals: they point inward.\n"
        "alpha, min_points, sharp, interpolate: as the command's options of reconstruct.\n\n"
        "What was found is logged to the logger 'mpuvdb'; inward normals are a UserWarning."
        "" MPUVDB_PROGRESS_DOC);
}

void bindMeshes(py::module_& module)
{
    module.def(
        "mesh",
        [](const py::object& source, const py::object& faces, const py::object& progress) {
            if (!faces.is_none()) return Shape(std::make_shared<const Mesh>(meshOf(source, faces)));
            if (py::isinstance<Mesh>(source))
                return Shape(std::shared_ptr<const Mesh>(source.cast<std::shared_ptr<Mesh>>()));
            py::detail::make_caster<Path> caster;
            if (!caster.load(source, true)) {
                PyErr_Clear();
                throw UsageError("mesh: give a file, a Mesh, or vertices (n, 3) and with them "
                                 "faces (m, 3)");
            }
            const auto file = py::detail::cast_op<Path>(caster);
            return run(progress, [&](Interrupter& p) {
                return Shape(std::make_shared<const Mesh>(readMesh(file, &p)));
            });
        },
        "source"_a, "faces"_a = py::none(), "progress"_a = py::none(),
        "The solid inside a closed triangle mesh: a file, a Mesh, or vertices (n, 3) in world "
        "units with faces (m, 3), counter-clockwise seen from outside." MPUVDB_PROGRESS_DOC);
}

void bindGrids(py::module_& module)
{
    module.def(
        "load",
        [](const Path& file, const std::optional<std::string>& grid) {
            return run(py::none(), [&](Interrupter& p) {
                return Shape(readLevelSet(file, grid.value_or(""), 0, Validation::Distances, &p),
                             file.filename().string());
            });
        },
        "file"_a, "grid"_a = py::none(),
        "The solid of the level set called grid in a .vdb file; None: 'surface', or the only "
        "one.");
}

} // namespace

void bindSources(py::module_& module)
{
    bindPoints(module);
    bindMeshes(module);
    bindGrids(module);
}

} // namespace mpuvdb::python
