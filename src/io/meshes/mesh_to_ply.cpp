// Meshes to binary PLY.
#include "files/text_scan.h"
#include "mesh_formats.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <limits>

namespace mpuvdb
{
namespace
{

std::string header(const Mesh& mesh, const char* type)
{
    std::string text = fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {0}\n"
                                   "property {1} x\nproperty {1} y\nproperty {1} z\n",
                                   mesh.positions.size(), type);
    if (!mesh.colors.empty())
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    for (const NamedScalars& scalars : mesh.scalars)
        text += fmt::format("property float {}\n", identifier(scalars.name));
    return text + fmt::format("element face {}\nproperty list uchar int vertex_indices\n"
                              "end_header\n",
                              mesh.triangles.size());
}

} // namespace

void writePly(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    if (mesh.positions.size() > std::size_t(std::numeric_limits<std::int32_t>::max()))
        throw LimitError(fmt::format("{}: {} vertices are more than the indices of PLY files can "
                                     "number. Use larger voxels, or write parts.",
                                     job.name, mesh.positions.size()));
    const bool doubles = needsDoubles(mesh);
    out.text(header(mesh, doubles ? "double" : "float"));
    forEachItem(mesh.positions.size(), out, job.progress, [&](std::size_t i) {
        const Vec3d p = mesh.world(i);
        const Vec3f rounded = p.cast<float>();
        if (doubles)
            out.append(p.data(), sizeof(double) * 3);
        else
            out.append(rounded.data(), sizeof(float) * 3);
        if (!mesh.colors.empty()) out.append(srgbColor(mesh.colors[i]).data(), sizeof(Rgb));
        for (const NamedScalars& scalars : mesh.scalars) out.value(scalars.values[i]);
    });
    forEachItem(mesh.triangles.size(), out, job.progress, [&](std::size_t i) {
        out.value(std::uint8_t(3));
        out.append(mesh.triangles[i].data(), sizeof(Mesh::Triangle));
    });
}

} // namespace mpuvdb
