// What reconstruct() gives.
#include "arrays.h"
#include "bindings.h"
#include "run.h"

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

std::vector<openvdb::GridBase::Ptr> besides(const ReconstructResult& made)
{
    std::vector<openvdb::GridBase::Ptr> grids = made.attributes;
    if (made.coverage) grids.insert(grids.begin(), made.coverage);
    return grids;
}

py::dict reportOf(const ReconstructReport& made)
{
    const ResolvedSettings& s = made.settings;
    const CleanReport& cleaned = made.cleaned;
    return py::dict("points"_a = made.points, "dropped"_a = made.dropped,
                    "normals_turned"_a = cleaned.flipped + cleaned.turned,
                    "spacing"_a = s.points.spacing, "noise"_a = s.points.noise,
                    "normal_noise"_a = s.points.normalNoise * 180 / M_PI, "diagonal"_a = s.diagonal,
                    "voxel_size"_a = s.grid.lattice.voxelSize, "half_width"_a = s.grid.halfWidth,
                    "tolerance"_a = s.fit.tolerance, "leaves"_a = made.fit.leaves,
                    "sharp_fits"_a = made.fit.sharpFits, "max_error"_a = made.fit.maxError,
                    "coverage_spacing"_a = made.coverageSpacing, "notes"_a = made.notes,
                    "warnings"_a = made.warnings);
}

Mesh extractedMesh(const ReconstructResult& made, Interrupter& progress)
{
    ExtractSettings settings;
    settings.field = made.field.get();
    Mesh mesh = extractMesh(made.levelSet(), settings, &progress);
    std::vector<std::string> names;
    for (const auto& grid : made.attributes) names.push_back(grid->getName());
    if (!names.empty()) addAttributes(mesh, *made.field->attributes(names, &progress), &progress);
    return mesh;
}

} // namespace

void bindReconstruction(py::module_& module)
{
    using R = ReconstructResult;
    py::class_<R>(module, "Reconstruction", "What reconstruct() gives.")
        .def_property_readonly(
            "level_set", [](const R& r) { return r.levelSet(); }, "The level set.")
        .def_property_readonly(
            "shape", [](const R& r) { return Shape(r.field, "points"); },
            "The field that it was sampled from, as a shape.")
        .def_property_readonly(
            "report", [](const R& r) { return reportOf(r.report); },
            "What was found and used: points, dropped (reason to count), spacing, noise, "
            "voxel_size, tolerance ... Lengths are world units, angles degrees.")
        .def_property_readonly(
            "grids",
            [](const R& r) {
                std::vector<std::string> names;
                for (const auto& grid : besides(r)) names.push_back(grid->getName());
                return names;
            },
            "Names of the grids beside the level set.")
        .def(
            "voxels",
            [](const R& r, const std::string& name) {
                for (const auto& grid : besides(r))
                    if (grid->getName() == name) return activeVoxelsOf(*grid);
                throw UsageError(fmt::format("grid: there is no '{}'. Ask for it when the points "
                                             "are reconstructed: coverage=True, attributes=[...]",
                                             name));
            },
            "grid"_a,
            "(indices, values) of the active voxels of the grid called that: (n, 3) of int32, and "
            "(n,) or (n, 3) of float32; 'coverage' is in [0, 1], 'Cd' linear.")
        .def(
            "to_mesh",
            [](const R& r, const py::object& progress) {
                return run(progress, [&](Interrupter& p) { return extractedMesh(r, p); });
            },
            "progress"_a = py::none(),
            "The mesh of the level set, with the attributes that were asked "
            "for." MPUVDB_PROGRESS_DOC)
        .def(
            "write",
            [](const R& r, const std::filesystem::path& file,
               const std::map<std::string, std::string>& metadata, const py::object& progress) {
                const auto grids = besides(r);
                std::map<std::string, std::string> all = metadataOf(r.report);
                for (const auto& [name, text] : metadata) all[name] = text;
                runWork(progress, [&](Interrupter& p) {
                    writeLevelSet(file, r.levelSet(), all, {grids.begin(), grids.end()}, &p);
                });
            },
            "file"_a, "metadata"_a = std::map<std::string, std::string>(),
            "progress"_a = py::none(),
            "Write a .vdb file with the level set and all grids beside it. What the report says of "
            "points and settings, and metadata (names to texts), go on the level set's "
            "grid." MPUVDB_PROGRESS_DOC)
        .def("__repr__", [](const R& r) {
            return fmt::format("<mpuvdb.Reconstruction: {} points, voxel size {:.6g}, {} active "
                               "voxels>",
                               r.report.points, r.report.settings.grid.lattice.voxelSize,
                               r.grid->activeVoxelCount());
        });
}

} // namespace mpuvdb::python
