// Meshes to binary STL.
#include "mesh_formats.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <limits>

namespace mpuvdb
{

namespace
{

/// Whether a triangle with three corners has fewer as floats.
bool collapses(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3f* rounded)
{
    const bool isWhole = a != b && b != c && c != a;
    return isWhole &&
           (rounded[0] == rounded[1] || rounded[1] == rounded[2] || rounded[2] == rounded[0]);
}

} // namespace

void writeStl(const MeshJob& job, OutputBuffer& out)
{
    /// Largest share of the triangles that floats may collapse. [derived: slivers, of which meshes
    /// have fewer]
    constexpr double kMaxCollapsed = 0.01;
    const Mesh& mesh = job.mesh;
    if (mesh.triangles.size() > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("{}: {} triangles are more than an STL file can hold. Write a "
                                     ".ply file.",
                                     job.name, mesh.triangles.size()));
    std::string header = "binary STL"; // must not begin with "solid"
    header.resize(80, ' ');
    out.text(header);
    out.value(std::uint32_t(mesh.triangles.size()));
    std::size_t collapsed = 0;
    forEachItem(mesh.triangles.size(), out, job.progress, [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const Vec3d normal = (b - a).cross(c - a);
        const double length = normal.norm();
        const Vec3f rounded[4] = {length > 0 ? Vec3f((normal / length).cast<float>())
                                             : Vec3f(Vec3f::Zero()),
                                  a.cast<float>(), b.cast<float>(), c.cast<float>()};
        collapsed += collapses(a, b, c, rounded + 1);
        for (const Vec3f& v : rounded) out.append(v.data(), sizeof(float) * 3);
        out.value(std::uint16_t(0));
    });
    if (double(collapsed) > kMaxCollapsed * double(mesh.triangles.size()))
        throw InputError(
            fmt::format("{}: {} of {} triangles collapse in the floats of an STL file, "
                        "so far are they from the origin. Write a .ply or .obj file, "
                        "or move the mesh",
                        job.name, collapsed, mesh.triangles.size()));
}

} // namespace mpuvdb
