// Meshes to OBJ and OFF: lines of vertices, lines of faces.
#include "mesh_formats.h"

#include <fmt/format.h>

#include <iterator>

namespace mpuvdb
{
namespace
{

/// Writes the shortest decimals that give a position back, as doubles or floats.
void formatPosition(const Vec3d& p, bool doubles, std::vector<char>& bytes)
{
    const auto to = std::back_inserter(bytes);
    if (doubles)
        fmt::format_to(to, "{} {} {}", p[0], p[1], p[2]);
    else
        fmt::format_to(to, "{} {} {}", float(p[0]), float(p[1]), float(p[2]));
}

} // namespace

// Colors follow the position, in [0,1] and the sRGB curve, as other programs write and read them.
void writeObj(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    const bool doubles = needsDoubles(mesh);
    const auto to = std::back_inserter(out.bytes());
    forEachItem(mesh.positions.size(), out, job.progress, [&](std::size_t i) {
        out.text("v ");
        formatPosition(mesh.world(i), doubles, out.bytes());
        if (!mesh.colors.empty()) {
            const Rgb rgb = srgbColor(mesh.colors[i]);
            fmt::format_to(to, " {:.4f} {:.4f} {:.4f}", rgb[0] / 255.0, rgb[1] / 255.0,
                           rgb[2] / 255.0);
        }
        out.text("\n");
    });
    forEachItem(mesh.triangles.size(), out, job.progress, [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        fmt::format_to(to, "f {} {} {}\n", std::uint64_t(t[0]) + 1, std::uint64_t(t[1]) + 1,
                       std::uint64_t(t[2]) + 1);
    });
}

void writeOff(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    const bool doubles = needsDoubles(mesh);
    const auto to = std::back_inserter(out.bytes());
    fmt::format_to(to, "{}OFF\n{} {} 0\n", mesh.colors.empty() ? "" : "C", mesh.positions.size(),
                   mesh.triangles.size());
    forEachItem(mesh.positions.size(), out, job.progress, [&](std::size_t i) {
        formatPosition(mesh.world(i), doubles, out.bytes());
        if (!mesh.colors.empty()) {
            const Rgb rgb = srgbColor(mesh.colors[i]);
            fmt::format_to(to, " {} {} {} 255", rgb[0], rgb[1], rgb[2]);
        }
        out.text("\n");
    });
    forEachItem(mesh.triangles.size(), out, job.progress, [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        fmt::format_to(to, "3 {} {} {}\n", t[0], t[1], t[2]);
    });
}

} // namespace mpuvdb
