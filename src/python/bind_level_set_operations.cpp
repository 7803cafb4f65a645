// What is done to level sets at once, on their own voxels.
#include "bindings.h"
#include "modelling_arguments.h"
#include "run.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <limits>

namespace mpuvdb::python
{
namespace py = pybind11;
using namespace py::literals;
namespace
{

/// What lengths are relative to: the band's box and voxels.
Scale scaleOf(const LevelSet& levelSet)
{
    return {Shape(levelSet).bounds(), levelSet.voxelSize()};
}

/// run() in a stage called @a name.
template <class Work>
auto runStage(const py::object& listener, const char* name, Work&& work)
{
    return run(listener, [&](Interrupter& progress) {
        progress.beginStage(name);
        return work(progress);
    });
}

/// The same for a level set made of @a from, with a note where nothing is left of it.
template <class Work>
LevelSet runOn(const LevelSet& from, const py::object& listener, const char* name, Work&& work)
{
    return runStage(listener, name, [&](Interrupter& progress) {
        LevelSet made = work(progress);
        if (from.grid().activeVoxelCount() > 0) noteIfEmpty(made, progress);
        return made;
    });
}

void bindSurfaceOperations(LevelSetClass& levelSets)
{
    levelSets
        .def(
            "offset",
            [](const LevelSet& levelSet, const LengthArgument& distance,
               const py::object& progress) {
                const double d = worldLength(distance, scaleOf(levelSet));
                return runOn(levelSet, progress, "offset",
                             [&](Interrupter& p) { return offset(levelSet, d, &p); });
            },
            "distance"_a, "progress"_a = py::none(),
            "Grown by distance, or shrunk by a negative one." MPUVDB_PROGRESS_DOC)
        .def(
            "shell",
            [](const LevelSet& levelSet, const LengthArgument& thickness, const std::string& wall,
               const py::object& progress) {
                const double t = worldLength(thickness, scaleOf(levelSet));
                const Wall where = wallOf(wall);
                return runOn(levelSet, progress, "shell",
                             [&](Interrupter& p) { return shell(levelSet, t, where, &p); });
            },
            "thickness"_a, "wall"_a = "inward", "progress"_a = py::none(),
            "The wall along the surface; wall is 'inward', 'outward' or 'centered'. Thinner than "
            "two voxels is a LimitError." MPUVDB_PROGRESS_DOC)
        .def(
            "smooth",
            [](const LevelSet& levelSet, const std::string& filter, int iterations, int width,
               const py::object& mask, const py::object& progress) {
                const SmoothSettings settings = smoothSettings(filter, iterations, width, mask);
                return runOn(levelSet, progress, "smooth",
                             [&](Interrupter& p) { return smooth(levelSet, settings, &p); });
            },
            "filter"_a = "gaussian", "iterations"_a = 1, "width"_a = 1, "mask"_a = py::none(),
            "progress"_a = py::none(), MPUVDB_SMOOTH_DOC MPUVDB_PROGRESS_DOC);
}

void bindLatticeOperations(LevelSetClass& levelSets)
{
    levelSets
        .def(
            "with_half_width",
            [](const LevelSet& levelSet, double halfWidth, const py::object& progress) {
                return runOn(levelSet, progress, "widen", [&](Interrupter& p) {
                    return withHalfWidth(levelSet, halfWidth, &p);
                });
            },
            "half_width"_a, "progress"_a = py::none(),
            "The same surface in a band of half_width voxels, in [1.5, 1000]." MPUVDB_PROGRESS_DOC)
        .def(
            "resample",
            [](const LevelSet& levelSet, const LengthArgument& voxelSize,
               std::optional<double> halfWidth, const py::object& progress) {
                const Scale scale = scaleOf(levelSet);
                const double h = worldLength(voxelSize, scale);
                const double width = halfWidth.value_or(levelSet.halfWidth());
                return runOn(levelSet, progress, "resample", [&](Interrupter& p) {
                    const Lattice lattice =
                        scale.box.isEmpty() ? Lattice{Vec3d::Zero(), h} : latticeFor(scale.box, h);
                    return resample(levelSet, lattice, width, &p);
                });
            },
            "voxel_size"_a, "half_width"_a = py::none(), "progress"_a = py::none(),
            "The same surface on voxels of another size; half_width (voxels) stays unless "
            "given." MPUVDB_PROGRESS_DOC);
}

void bindComponents(LevelSetClass& levelSets)
{
    levelSets
        .def(
            "components",
            [](const LevelSet& levelSet, const py::object& progress) {
                const auto parts = runStage(progress, "components", [&](Interrupter& p) {
                    return components(levelSet, &p);
                });
                py::list result;
                for (const SolidComponent& part : parts)
                    result.append(py::make_tuple(part.levelSet, part.volume));
                return result;
            },
            "progress"_a = py::none(),
            "The connected parts, the largest first: a list of (LevelSet, volume in world units "
            "cubed)." MPUVDB_PROGRESS_DOC)
        .def(
            "keep_components",
            [](const LevelSet& levelSet, double minVolume, std::optional<std::int64_t> count,
               const py::object& progress) {
                if (count && *count < 1)
                    throw UsageError(fmt::format("count {}: must be at least 1", *count));
                const auto most =
                    std::size_t(count.value_or(std::numeric_limits<std::int64_t>::max()));
                return runOn(levelSet, progress, "components", [&](Interrupter& p) {
                    return keepComponents(levelSet, minVolume, most, &p);
                });
            },
            "min_volume"_a = 0.0, "count"_a = py::none(), "progress"_a = py::none(),
            "The parts of at least min_volume (world units cubed), at most count of them (at least "
            "1), the largest first." MPUVDB_PROGRESS_DOC);
}

} // namespace

void bindLevelSetOperations(LevelSetClass& levelSets)
{
    bindSurfaceOperations(levelSets);
    bindLatticeOperations(levelSets);
    bindComponents(levelSets);
}

} // namespace mpuvdb::python
