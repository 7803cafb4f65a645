// Meshes to PLY, OBJ and STL.
#include "output_stream.h"
#include "text_scan.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kItemsAtOnce = 1 << 12;

// Calls f(i) for i < count, and progress now and then.
template <class F>
void forEachItem(std::size_t count, OutputBuffer& out, Progress& progress, const F& f)
{
    for (std::size_t i = 0; i < count; ++i) {
        f(i);
        if (i % kItemsAtOnce == kItemsAtOnce - 1) {
            out.flushIfFull();
            progress.advance(kItemsAtOnce);
        }
    }
}

// Whether floats of world coordinates would lose more than three bits of the mesh's own.
bool needsDoubles(const Mesh& mesh)
{
    Box3d box;
    for (const Vec3f& p : mesh.positions) box.extend(p.cast<double>());
    return !box.isEmpty() && mesh.frame.cwiseAbs().maxCoeff() > 8 * box.sizes().maxCoeff();
}

void writePly(const Mesh& mesh, OutputBuffer& out, Progress& progress)
{
    const bool doubles = needsDoubles(mesh);
    const char* type = doubles ? "double" : "float";
    out.text(fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {0}\n"
                         "property {1} x\nproperty {1} y\nproperty {1} z\nelement face {2}\n"
                         "property list uchar int vertex_indices\nend_header\n",
                         mesh.positions.size(), type, mesh.triangles.size()));
    forEachItem(mesh.positions.size(), out, progress, [&](std::size_t i) {
        const Vec3d p = mesh.world(i);
        const Vec3f rounded = p.cast<float>();
        if (doubles)
            out.append(p.data(), sizeof(double) * 3);
        else
            out.append(rounded.data(), sizeof(float) * 3);
    });
    forEachItem(mesh.triangles.size(), out, progress, [&](std::size_t i) {
        out.value(std::uint8_t(3));
        out.append(mesh.triangles[i].data(), sizeof(Mesh::Triangle));
    });
}

void writeObj(const Mesh& mesh, OutputBuffer& out, Progress& progress)
{
    const bool doubles = needsDoubles(mesh);
    forEachItem(mesh.positions.size(), out, progress, [&](std::size_t i) {
        const Vec3d p = mesh.world(i);
        const auto to = std::back_inserter(out.bytes());
        if (doubles)
            fmt::format_to(to, "v {} {} {}\n", p[0], p[1], p[2]);
        else
            fmt::format_to(to, "v {} {} {}\n", float(p[0]), float(p[1]), float(p[2]));
    });
    forEachItem(mesh.triangles.size(), out, progress, [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        fmt::format_to(std::back_inserter(out.bytes()), "f {} {} {}\n", std::uint64_t(t[0]) + 1,
                       std::uint64_t(t[1]) + 1, std::uint64_t(t[2]) + 1);
    });
}

void writeStl(const Mesh& mesh, OutputBuffer& out, Progress& progress)
{
    std::string header = "binary STL"; // must not begin with "solid"
    header.resize(80, ' ');
    out.text(header);
    out.value(std::uint32_t(mesh.triangles.size()));
    forEachItem(mesh.triangles.size(), out, progress, [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const Vec3d normal = (b - a).cross(c - a);
        const double length = normal.norm();
        const Vec3f rounded[4] = {length > 0 ? Vec3f((normal / length).cast<float>())
                                             : Vec3f(Vec3f::Zero()),
                                  a.cast<float>(), b.cast<float>(), c.cast<float>()};
        for (const Vec3f& v : rounded) out.append(v.data(), sizeof(float) * 3);
        out.value(std::uint16_t(0));
    });
}

} // namespace

void writeMesh(const std::filesystem::path& file, const Mesh& mesh, Progress& progress)
{
    const std::string extension = lowerCase(file.extension().string());
    void (*write)(const Mesh&, OutputBuffer&, Progress&) = nullptr;
    if (extension == ".ply") write = writePly;
    if (extension == ".obj") write = writeObj;
    if (extension == ".stl") write = writeStl;
    if (!write)
        throw UsageError(fmt::format("{}: meshes are written as .ply, .obj or .stl, not '{}'",
                                     file.string(), extension));
    if (extension == ".stl" && mesh.triangles.size() > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("{}: {} triangles are more than an STL file can hold. Write a "
                                     ".ply file.",
                                     file.string(), mesh.triangles.size()));
    progress.beginStage("write mesh", double(mesh.positions.size() + mesh.triangles.size()));
    writeStream(file, [&](OutputBuffer& out) { write(mesh, out, progress); });
    progress.endStage();
}

} // namespace mpuvdb
