// The writer for a mesh's file.
#include "files/text_scan.h"
#include "mesh_formats.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

struct Format {
    const char* extension;
    void (*write)(const MeshJob&, OutputBuffer&);
};

constexpr Format kFormats[] = {{".ply", writePly}, {".obj", writeObj}, {".off", writeOff},
                               {".stl", writeStl}, {".glb", writeGlb}, {".usda", writeUsda}};

void requireAttributes(const Mesh& mesh)
{
    const auto require = [&](std::size_t count, const std::string& what) {
        if (count != mesh.positions.size())
            throw UsageError(fmt::format("mesh: {} values of {} for {} vertices. Give one for "
                                         "each, or none",
                                         count, what, mesh.positions.size()));
    };
    if (!mesh.colors.empty()) require(mesh.colors.size(), "color");
    for (const NamedScalars& scalars : mesh.scalars) require(scalars.values.size(), scalars.name);
}

/// @throws InputError where the place of a vertex is none that floats hold.
void requirePlaces(const Mesh& mesh, const std::string& name)
{
    const double largest = std::numeric_limits<float>::max();
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const Vec3d place = mesh.world(v);
        if (place.cwiseAbs().maxCoeff() <= largest && place.allFinite()) continue;
        throw InputError(fmt::format("{}: vertex {} is at ({:g}, {:g}, {:g}), which floats do not "
                                     "hold. Scale the mesh, or the solid that it is made of",
                                     name, v, place[0], place[1], place[2]));
    }
}

} // namespace

bool needsDoubles(const Mesh& mesh)
{
    Box3d box;
    for (const Vec3f& p : mesh.positions) box.extend(p.cast<double>());
    return !box.isEmpty() && mesh.frame.cwiseAbs().maxCoeff() > 8 * box.sizes().maxCoeff();
}

const std::vector<std::string>& meshExtensions()
{
    static const std::vector<std::string> extensions = [] {
        std::vector<std::string> all;
        for (const Format& format : kFormats) all.emplace_back(format.extension);
        return all;
    }();
    return extensions;
}

void requireScene(const SceneSettings& scene)
{
    if (!(scene.metersPerUnit > 0 && std::isfinite(scene.metersPerUnit)))
        throw UsageError(
            fmt::format("meters per unit are {}; they must be above 0", scene.metersPerUnit));
}

void writeMesh(const std::filesystem::path& file, const Mesh& mesh, const SceneSettings& scene,
               Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const std::string extension = lowerCase(file.extension().string());
    const auto* const format =
        std::find_if(std::begin(kFormats), std::end(kFormats),
                     [&](const Format& f) { return extension == f.extension; });
    if (format == std::end(kFormats))
        throw UsageError(fmt::format("{}: meshes are written as {}, not '{}'", file.string(),
                                     fmt::join(meshExtensions(), ", "), extension));
    requireScene(scene);
    requireAttributes(mesh);
    requirePlaces(mesh, file.string());
    progress.beginStage("write mesh", double(mesh.positions.size() + mesh.triangles.size()));
    const MeshJob job{mesh, scene, file.string(), progress};
    writeStream(file, [&](OutputBuffer& out) { format->write(job, out); });
    progress.endStage();
}

} // namespace mpuvdb
