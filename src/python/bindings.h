// The parts of the module; each adds its functions and classes.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/shape.h>

#include <pybind11/pybind11.h>

#include <filesystem>
#include <map>
#include <memory>
#include <string>

namespace mpuvdb::python
{

using MeshClass = pybind11::class_<Mesh, std::shared_ptr<Mesh>>;
using LevelSetClass = pybind11::class_<LevelSet>;
using ShapeClass = pybind11::class_<Shape>;

void bindReports(pybind11::module_& module);
void bindMesh(MeshClass& meshes);
void bindLevelSet(LevelSetClass& levelSets);
void bindLevelSetOperations(LevelSetClass& levelSets);
void bindShape(ShapeClass& shapes, LevelSetClass& levelSets);
void bindDeformations(ShapeClass& shapes);
/// Questions to level sets and shapes; adds the class that keeps what they need.
void bindQueries(pybind11::module_& module, LevelSetClass& levelSets, ShapeClass& shapes);
void bindBooleans(pybind11::module_& module);
void bindPrimitives(pybind11::module_& module);
void bindParticles(pybind11::module_& module);
void bindReconstruction(pybind11::module_& module);
void bindSources(pybind11::module_& module);

/// Write a level set, or the mesh of it, as the extension says.
/// @param field  what the level set was sampled from, or null.
void writeAny(const std::filesystem::path& file, const LevelSet& levelSet, const Field* field,
              const std::map<std::string, std::string>& metadata, Interrupter& progress);

/// A note for the user if @a made has no voxels.
void noteIfEmpty(const LevelSet& made, Interrupter& progress);

/// Whether writeAny() knows the extension. @throws UsageError
void demandWritable(const std::filesystem::path& file);

/// Said of every long function.
#define MPUVDB_PROGRESS_DOC                                                                        \
    "\n\nprogress(stage: str, fraction: float) is called from time to time, if given; returning "  \
    "False or raising stops the work."

} // namespace mpuvdb::python
