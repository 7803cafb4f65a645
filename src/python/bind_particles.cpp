// Particles to a level set.
#include "arguments.h"
#include "arrays.h"
#include "bindings.h"
#include "run.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/memory.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/particles.h>

#include <fmt/format.h>

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

py::dict reportOf(const ParticleReport& made)
{
    return py::dict("particles"_a = made.particles, "dropped"_a = made.dropped,
                    "lost"_a = made.lost, "findings"_a = made.findings,
                    "smallest_radius"_a = made.smallestRadius,
                    "median_radius"_a = made.medianRadius, "largest_radius"_a = made.largestRadius,
                    "spacing"_a = made.spacing, "voxel_size"_a = made.voxelSize,
                    "half_width"_a = made.halfWidth, "blocks"_a = made.blocks,
                    "notes"_a = made.notes, "warnings"_a = made.warnings);
}

Mesh meshWithAttributes(const ParticleResult& made, Interrupter& progress)
{
    Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
    for (const auto& grid : made.beside)
        if (grid->getName() != kVelocityName) addAttribute(mesh, *grid, &progress);
    return mesh;
}

void bindResult(py::module_& module)
{
    using R = ParticleResult;
    py::class_<R>(module, "ParticleSurface", "What particles() gives.")
        .def_property_readonly(
            "level_set", [](const R& r) { return r.levelSet(); }, "The level set.")
        .def_property_readonly(
            "report", [](const R& r) { return reportOf(r.report); },
            "What was found and used: particles, dropped (reason to count), lost (balls that the "
            "surface does not reach), findings (what is not shown, with the cure), "
            "smallest_radius, "
            "median_radius, largest_radius, spacing (None where radii were given), voxel_size ... "
            "Lengths are world units.")
        .def_property_readonly(
            "grids",
            [](const R& r) {
                std::vector<std::string> names;
                for (const auto& grid : r.beside) names.push_back(grid->getName());
                return names;
            },
            "Names of the grids beside the level set.")
        .def(
            "voxels",
            [](const R& r, const std::string& name) {
                for (const auto& grid : r.beside)
                    if (grid->getName() == name) return activeVoxelsOf(*grid);
                throw UsageError(fmt::format("grid: there is no '{}'. Give the particles "
                                             "velocities for 'v', colors for 'Cd', or scalars",
                                             name));
            },
            "grid"_a,
            "(indices, values) of the active voxels of the grid called that: (n, 3) of int32, and "
            "(n,) or (n, 3) of float32; 'v' is in world units per second, 'Cd' linear.")
        .def(
            "to_mesh",
            [](const R& r, const py::object& progress) {
                return run(progress, [&](Interrupter& p) { return meshWithAttributes(r, p); });
            },
            "progress"_a = py::none(),
            "The mesh of the level set, with colors and scalars." MPUVDB_PROGRESS_DOC)
        .def(
            "write",
            [](const R& r, const std::filesystem::path& file,
               const std::map<std::string, std::string>& metadata, const py::object& progress) {
                runWork(progress, [&](Interrupter& p) {
                    writeLevelSet(file, r.levelSet(), metadata, {r.beside.begin(), r.beside.end()},
                                  &p);
                });
            },
            "file"_a, "metadata"_a = std::map<std::string, std::string>(),
            "progress"_a = py::none(),
            "Write a .vdb file with the level set and all grids beside it." MPUVDB_PROGRESS_DOC)
        .def("__repr__", [](const R& r) {
            return fmt::format("<mpuvdb.ParticleSurface: {} particles, voxel size {:.6g}, {} "
                               "active voxels>",
                               r.report.particles, r.report.voxelSize, r.grid->activeVoxelCount());
        });
}

/// Arrays of numpy as particles, read where they are.
struct ArrayParticles {
    ParticleView view;
    std::vector<py::array> holders; ///< what the view looks at

    void add(NumberView& to, const py::object& array, py::ssize_t columns, const char* what)
    {
        if (array.is_none()) return;
        ArrayView found = arrayViewOf(array, columns, what);
        holders.push_back(std::move(found.holder));
        to = found.numbers;
    }
};

/// Whether @a radius is one for all particles.
bool isLength(const py::object& radius)
{
    return py::isinstance<py::str>(radius) || py::isinstance<py::float_>(radius) ||
           py::isinstance<py::int_>(radius);
}

ArrayParticles arraysOf(const py::object& source, const py::object& radius,
                        const py::object& velocities, const py::object& colors,
                        const py::object& scalars)
{
    ArrayParticles arrays;
    arrays.add(arrays.view.positions, source, 3, "particles");
    if (!isLength(radius)) arrays.add(arrays.view.radii, radius, 1, "radius");
    arrays.add(arrays.view.velocities, velocities, 3, "velocities");
    arrays.add(arrays.view.colors, colors, 3, "colors");
    if (!scalars.is_none())
        for (const auto& [name, values] : scalars.cast<py::dict>()) {
            NumberView numbers;
            arrays.add(numbers, py::reinterpret_borrow<py::object>(values), 1,
                       std::string(py::str(name)).c_str());
            arrays.view.scalars.emplace_back(py::str(name), numbers);
        }
    return arrays;
}

/// Leave out colors and scalars that @a names does not have; without any, all stay.
/// @throws UsageError for a name that is none of them.
void keepNamed(ArrayParticles& arrays, const std::vector<std::string>& names)
{
    if (names.empty()) return;
    auto& scalars = arrays.view.scalars;
    const auto isNamed = [&](const std::string& name) {
        return std::find(names.begin(), names.end(), name) != names.end();
    };
    for (const std::string& name : names) {
        const bool isThere =
            name == kColorName
                ? arrays.view.colors.rows > 0
                : std::any_of(scalars.begin(), scalars.end(),
                              [&](const auto& scalar) { return scalar.first == name; });
        if (!isThere)
            throw UsageError(fmt::format("attributes: the particles have no '{}'. Give it as {}",
                                         name, name == kColorName ? "colors" : "one of scalars"));
    }
    if (!isNamed(kColorName)) arrays.view.colors = {};
    scalars.erase(std::remove_if(scalars.begin(), scalars.end(),
                                 [&](const auto& scalar) { return !isNamed(scalar.first); }),
                  scalars.end());
}

ParticleResult surfaceOf(Particles&& particles, const ParticleOptions& options, Interrupter& p)
{
    ParticleResult made = particlesToLevelSet(std::move(particles), options, &p);
    for (const std::string& warning : made.report.warnings) p.note(warning);
    for (const std::string& finding : made.report.findings) p.note(finding);
    return made;
}

} // namespace

void bindParticles(py::module_& module)
{
    bindResult(module);
    module.def(
        "particles",
        [](const py::object& source, const py::object& radius, const py::object& velocities,
           const std::string& surface, const std::optional<LengthArgument>& voxelSize,
           double radiusScale, double halfWidth, const py::object& colors,
           const py::object& scalars, const std::vector<std::string>& attributes, bool velocity,
           std::optional<std::uint64_t> maxBytes, const py::object& progress) {
            ParticleOptions options;
            options.surface = choose<ParticleSurface>(
                surface, "surface",
                {{"smooth", ParticleSurface::Smooth}, {"spheres", ParticleSurface::Spheres}});
            if (!radius.is_none() && isLength(radius))
                options.radius = lengthOf(radius.cast<LengthArgument>());
            options.radiusScale = radiusScale;
            if (voxelSize) options.voxelSize = lengthOf(*voxelSize);
            options.halfWidth = halfWidth;
            options.velocity = velocity;
            options.maxBytes = maxBytes.value_or(defaultMemoryLimit());
            if (const auto files = pathsOf(source)) {
                if (!velocities.is_none() || !colors.is_none() || !scalars.is_none() ||
                    (!radius.is_none() && !isLength(radius)))
                    throw UsageError("arrays of radius, velocities, colors and scalars go with an "
                                     "array of particles: files bring their own");
                return run(progress, [&](Interrupter& p) {
                    std::vector<std::string> names = attributes;
                    const auto color = std::find(names.begin(), names.end(), kColorName);
                    const bool wantsColors = color != names.end();
                    if (wantsColors) names.erase(color);
                    Particles read = readParticles(*files, names, maxBytes.value_or(0), &p);
                    if (!wantsColors) read.colors.clear();
                    return surfaceOf(std::move(read), options, p);
                });
            }
            ArrayParticles arrays = arraysOf(source, radius, velocities, colors, scalars);
            keepNamed(arrays, attributes);
            return run(progress, [&](Interrupter& p) {
                return surfaceOf(importParticles(arrays.view, &p), options, p);
            });
        },
        "source"_a, "radius"_a = py::none(), "velocities"_a = py::none(), py::kw_only(),
        "surface"_a = "smooth", "voxel_size"_a = py::none(), "radius_scale"_a = 1.0,
        "half_width"_a = 3.0, "colors"_a = py::none(), "scalars"_a = py::none(),
        "attributes"_a = std::vector<std::string>(), "velocity"_a = true,
        "max_bytes"_a = py::none(), "progress"_a = py::none(),
        "The level set about particles of a liquid, or points that fill a solid, as the command's "
        "particles makes it.\n\n"
        "source: an array (n, 3) of float32 or float64, read in place, world units; or a file, or "
        "a list of files (.vdb point grids too), whose radii (pscale, radius, half of width, "
        "widths or diameter) and "
        "velocities (vx vy vz, v_x ...) are read by their names.\n"
        "radius: (n,), or one for all: world units, or '0.1%' of the particles' diagonal; None: "
        "the file's, or of a ball of the volume that the measured spacing leaves each particle.\n"
        "velocities: (n, 3), world units per second; with them there is a grid 'v'.\n"
        "surface: 'smooth' keeps sheets, threads and volume [Yu and Turk 2013]; a lone particle "
        "is its ball. 'spheres' is the union of the balls.\n"
        "voxel_size: world units or '%'; None: half the median radius. radius_scale: factor of "
        "all radii. half_width: voxels, in [1.5, 1000].\n"
        "colors: (n, 3), sRGB, uint8, or floats in [0, 1], or up to 255 or 65535. scalars: a dict "
        "of at most 4 names to "
        "(n,). attributes: of these, or of files, 'Cd' and scalars or properties by name; of an "
        "array's none named are all. velocity: whether to make "
        "the grid 'v'. max_bytes: that the work may take.\n\n"
        "Radii that are not above 0 are an InputError." MPUVDB_PROGRESS_DOC);
}

} // namespace mpuvdb::python
