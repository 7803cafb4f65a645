// Shapes from data: points, meshes, level sets.
#include "arguments.h"
#include "arrays.h"
#include "bindings.h"
#include "run.h"

#include <mpuvdb/block_under.h>
#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/sampling.h>

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

/// What Python's points() and reconstruct() both take.
struct PointsArguments {
    py::object source, normals, confidence, colors, scalars, viewpoint;
    ReconstructOptions options;
};

void warn(const std::string& text)
{
    if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 1) != 0) throw py::error_already_set();
}

/// Notes go where Python's programs expect them; what is likely wrong is a warning.
void tell(const ReconstructReport& made)
{
    const py::object log = py::module_::import("logging").attr("getLogger")("mpuvdb");
    const auto note = [&](const std::string& text) { log.attr("info")("%s", text); };
    for (const std::string& text : made.notes) note(text);
    const CleanReport& cleaned = made.cleaned;
    for (const auto& [reason, count] : made.dropped)
        if (reason != "outlier") note(fmt::format("{} points left out: {}", count, reason));
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
    if (const std::string thin = cleaned.tooThin(); !thin.empty()) warn(thin);
    if (cleaned.guessesOutside())
        warn(fmt::format("which side is outside is a guess, as {:.0f} % of the points are not of a "
                         "closed solid: say from where they were seen with viewpoint, or give "
                         "normals",
                         100 * cleaned.unclosed));
    if (cleaned.inward)
        warn("the normals point inward, so that inside and outside are exchanged; "
             "flip_normals=True turns them, unless it did so already");
    for (const std::string& finding : made.explained.findings) warn(finding);
}

std::vector<Vec3d> placesOf(const py::object& viewpoint)
{
    if (viewpoint.is_none()) return {};
    py::detail::make_caster<Vec3d> one;
    if (one.load(viewpoint, true)) return {py::detail::cast_op<Vec3d>(one)};
    return rowsOf(viewpoint, "viewpoint");
}

/// The names among @a names that are scalars.
std::vector<std::string> scalarsAmong(const std::vector<std::string>& names)
{
    std::vector<std::string> scalars;
    for (const std::string& name : names)
        if (name != kColorName && name != "confidence") scalars.push_back(name);
    return scalars;
}

/// Arrays of numpy as points, read where they are.
struct ArrayPoints {
    PointView view;
    std::vector<py::array> holders; ///< what the view looks at

    explicit ArrayPoints(const PointsArguments& a)
    {
        const auto add = [&](NumberView& to, const py::object& array, py::ssize_t columns,
                             const char* what) {
            if (array.is_none()) return;
            ArrayView found = arrayViewOf(array, columns, what);
            holders.push_back(std::move(found.holder));
            to = found.numbers;
        };
        add(view.positions, a.source, 3, "points");
        add(view.normals, a.normals, 3, "normals");
        add(view.confidences, a.confidence, 1, "confidence");
        add(view.colors, a.colors, 3, "colors");
        if (!a.scalars.is_none())
            for (const auto& [name, values] : a.scalars.cast<py::dict>()) {
                view.scalars.emplace_back(py::str(name), NumberView());
                add(view.scalars.back().second, py::reinterpret_borrow<py::object>(values), 1,
                    view.scalars.back().first.c_str());
            }
        view.viewpoints = placesOf(a.viewpoint);
        if (view.viewpoints.size() > 1)
            throw UsageError("viewpoint: an array of points has one, or none");
    }
};

/// Read what @a arguments name, and give it to @a work(PointInput, interrupter), apart from Python.
template <class Work>
auto withPoints(const PointsArguments& arguments, const py::object& progress, const Work& work)
{
    const ReconstructOptions& options = arguments.options;
    if (const auto paths = pathsOf(arguments.source)) {
        for (const py::object* const array :
             {&arguments.normals, &arguments.confidence, &arguments.colors, &arguments.scalars})
            if (!array->is_none())
                throw UsageError("normals, confidence, colors and scalars go with an array of "
                                 "points: files bring their own");
        const std::vector<Vec3d> viewpoints = placesOf(arguments.viewpoint);
        return run(progress, [&](Interrupter& p) {
            return work(readPoints(*paths, options.badPoints, viewpoints,
                                   scalarsAmong(options.attributes), &p),
                        p);
        });
    }
    const ArrayPoints points(arguments);
    return run(progress, [&](Interrupter& p) {
        return work(importPoints(points.view, "points", options.badPoints, &p), p);
    });
}

/// The options that points() and reconstruct() share.
ReconstructOptions optionsOf(const std::optional<LengthArgument>& tolerance,
                             const std::optional<LengthArgument>& voxelSize,
                             const std::string& orient, const std::string& outliers,
                             bool flipNormals, const std::string& badPoints,
                             std::optional<double> alpha, std::optional<int> minPoints, bool sharp,
                             bool interpolate)
{
    ReconstructOptions options;
    options.badPoints = choose<BadPoints>(badPoints, "bad_points",
                                          {{"drop", BadPoints::Drop}, {"fail", BadPoints::Fail}});
    options.clean->normals = choose<NormalsFrom>(orient, "orient",
                                                 {{"auto", NormalsFrom::Auto},
                                                  {"keep", NormalsFrom::Keep},
                                                  {"estimate", NormalsFrom::Estimate}});
    options.clean->dropOutliers =
        choose<bool>(outliers, "outliers", {{"drop", true}, {"keep", false}});
    options.clean->flipNormals = flipNormals;
    if (tolerance) options.tolerance = lengthOf(*tolerance);
    if (voxelSize) options.voxelSize = lengthOf(*voxelSize);
    options.alpha = alpha;
    options.minPoints = minPoints;
    options.sharp = sharp;
    options.interpolate = interpolate;
    return options;
}

#define MPUVDB_POINTS_DOC                                                                          \
    "source: a file, a list of files, or an array (n, 3) of float32 or float64, read in place, "   \
    "world units; to it normals (n, 3), outward, and confidence (n,).\n"                           \
    "tolerance: largest distance of a local fit from its points, world units, '0.1%' of the "      \
    "points' diagonal or '0.2vx'; None: from their spacing and measured noise.\n"                  \
    "viewpoint: where the scanner stood, (3,), or (n, 3) for n files, world units.\n"              \
    "orient: 'auto' turns normals that are flipped among the others, or all those of a closed "    \
    "solid, and estimates where there are none; 'keep' leaves them; 'estimate' always "            \
    "estimates.\n"                                                                                 \
    "outliers: 'drop' or 'keep'. bad_points: 'drop' or 'fail' at the first that is not finite, "   \
    "has no normal, or is a hundred times as far away as 95 % of all are from each other. "        \
    "flip_normals: they point inward.\n"                                                           \
    "alpha, min_points, sharp, interpolate: as the command's options of reconstruct.\n"

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
            const PointsArguments arguments{source,
                                            normals,
                                            confidence,
                                            py::none(),
                                            py::none(),
                                            viewpoint,
                                            optionsOf(tolerance, voxelSize, orient, outliers,
                                                      flipNormals, badPoints, alpha, minPoints,
                                                      sharp, interpolate)};
            const FittedPoints made =
                withPoints(arguments, progress, [&](PointInput&& input, Interrupter& p) {
                    return fitPoints(preparePoints(std::move(input), arguments.options, &p), &p);
                });
            tell(made.report);
            return Shape(made.field, "points");
        },
        "source"_a, "normals"_a = py::none(), py::kw_only(), "confidence"_a = py::none(),
        "tolerance"_a = py::none(), "voxel_size"_a = py::none(), "viewpoint"_a = py::none(),
        "orient"_a = "auto", "outliers"_a = "drop", "flip_normals"_a = false,
        "bad_points"_a = "drop", "alpha"_a = py::none(), "min_points"_a = py::none(),
        "sharp"_a = true, "interpolate"_a = false, "progress"_a = py::none(),
        "The solid that points on its surface bound: read, cleaned and fitted at "
        "once.\n\n" MPUVDB_POINTS_DOC
        "voxel_size: the finest that the fit is for; None: the measured spacing.\n\n"
        "What was found is logged to the logger 'mpuvdb'; inward normals are a "
        "UserWarning." MPUVDB_PROGRESS_DOC);
}

void bindReconstruct(py::module_& module)
{
    module.def(
        "reconstruct",
        [](const py::object& source, const py::object& normals, const py::object& confidence,
           const py::object& colors, const py::object& scalars,
           const std::optional<LengthArgument>& tolerance,
           const std::optional<LengthArgument>& voxelSize, std::optional<double> voxels,
           double halfWidth, const py::object& viewpoint, const std::string& orient,
           const std::string& outliers, bool flipNormals, const std::string& badPoints,
           std::optional<double> alpha, std::optional<int> minPoints, bool sharp, bool interpolate,
           bool coverage, const std::optional<std::vector<std::string>>& attributes,
           std::optional<std::uint64_t> maxBytes, const py::object& progress) {
            PointsArguments arguments{source,
                                      normals,
                                      confidence,
                                      colors,
                                      scalars,
                                      viewpoint,
                                      optionsOf(tolerance, voxelSize, orient, outliers, flipNormals,
                                                badPoints, alpha, minPoints, sharp, interpolate)};
            ReconstructOptions& options = arguments.options;
            options.voxels = voxels;
            options.halfWidth = halfWidth;
            options.coverage = coverage;
            options.attributes = attributes.value_or(std::vector<std::string>());
            options.maxBytes = maxBytes;
            ReconstructResult made =
                withPoints(arguments, progress, [&](PointInput&& input, Interrupter& p) {
                    if (!attributes && !input.cloud.colors.empty())
                        options.attributes = {kColorName};
                    return reconstruct(std::move(input), options, &p);
                });
            tell(made.report);
            return made;
        },
        "source"_a, "normals"_a = py::none(), py::kw_only(), "confidence"_a = py::none(),
        "colors"_a = py::none(), "scalars"_a = py::none(), "tolerance"_a = py::none(),
        "voxel_size"_a = py::none(), "voxels"_a = py::none(), "half_width"_a = 3.0,
        "viewpoint"_a = py::none(), "orient"_a = "auto", "outliers"_a = "drop",
        "flip_normals"_a = false, "bad_points"_a = "drop", "alpha"_a = py::none(),
        "min_points"_a = py::none(), "sharp"_a = true, "interpolate"_a = false,
        "coverage"_a = false, "attributes"_a = py::none(), "max_bytes"_a = py::none(),
        "progress"_a = py::none(),
        "Points to a level set at once, as the command's reconstruct does it.\n\n" MPUVDB_POINTS_DOC
        "colors: (n, 3), sRGB, uint8, or floats in [0, 1], or up to 255 or 65535. scalars: a dict "
        "of names to (n,).\n"
        "voxel_size: edge of a voxel; or voxels: their number along the longest side; None: from "
        "the measured spacing. half_width: voxels, in [1.5, 1000].\n"
        "coverage: also say where data support the surface. attributes: grids beside it: 'Cd', "
        "'confidence', scalars by name; None: 'Cd' where there are colors. max_bytes: that the "
        "work may take.\n\n"
        "What was found is in the result's report, and logged to the logger 'mpuvdb'; what is "
        "likely wrong is a UserWarning." MPUVDB_PROGRESS_DOC);
}

double notNegative(const std::string& what, double length)
{
    if (!(length >= 0))
        throw UsageError(fmt::format("{} is {}; it must be at least 0", what, length));
    return length;
}

void bindMeshes(py::module_& module)
{
    module.def(
        "mesh",
        [](const py::object& source, const py::object& faces, const py::object& progress,
           bool repair, std::optional<double> holes, double thicken, std::optional<double> base,
           const Vec3d& up) {
            std::optional<RepairSettings> settings;
            if (repair || holes || thicken != 0 || base) settings.emplace();
            if (holes) settings->holes = notNegative("repair_holes", *holes);
            if (settings) settings->thickness = notNegative("thicken", thicken);
            const BadVertices bad = settings ? BadVertices::Keep : BadVertices::Refuse;
            const auto shapeOf = [&](std::shared_ptr<const Mesh> mesh) {
                if (base) mesh = std::make_shared<const Mesh>(blockUnder(*mesh, up, *base));
                return settings ? Shape(std::move(mesh), *settings) : Shape(std::move(mesh));
            };
            if (!faces.is_none())
                return shapeOf(std::make_shared<const Mesh>(meshOf(source, faces, bad)));
            if (py::isinstance<Mesh>(source)) return shapeOf(source.cast<std::shared_ptr<Mesh>>());
            py::detail::make_caster<Path> caster;
            if (!caster.load(source, true)) {
                PyErr_Clear();
                throw UsageError("mesh: give a file, a Mesh, or vertices (n, 3) and with them "
                                 "faces (m, 3)");
            }
            const auto file = py::detail::cast_op<Path>(caster);
            return run(progress, [&](Interrupter& p) {
                return shapeOf(std::make_shared<const Mesh>(readMesh(file, &p, bad)));
            });
        },
        "source"_a, "faces"_a = py::none(), "progress"_a = py::none(), py::kw_only(),
        "repair"_a = false, "repair_holes"_a = py::none(), "thicken"_a = 0.0, "base"_a = py::none(),
        "up"_a = Vec3d(Vec3d::UnitZ()),
        "The solid inside a triangle mesh: a file, a Mesh, or vertices (n, 3) in world units with "
        "faces (m, 3), counter-clockwise seen from outside.\n\n"
        "The mesh has to be closed, but for what repair=True makes good: inside is then where the "
        "generalized winding number is above one half, so that holes are closed; patches that face "
        "the wrong way are turned, copies of triangles, triangles within the solid and those with "
        "vertices that are not finite left out. LevelSet.explained.repair says what was done.\n"
        "repair_holes: the widest hole that is closed, world units, at least 0; None: any; wider "
        "ones raise InputError when the shape is evaluated. thicken: thickness of the walls made "
        "of "
        "open surfaces that enclose nothing, world units, at least two voxels; 0: none are made. "
        "Either repairs, too.\n"
        "base: a block is made of an open surface that is seen from above, such as a terrain, by "
        "walls down to a flat base this far below its lowest vertex, world units, > 0; its holes "
        "are closed. up: the direction that points up, (3,)." MPUVDB_PROGRESS_DOC);
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
    bindReconstruct(module);
    bindMeshes(module);
    bindGrids(module);
}

} // namespace mpuvdb::python
