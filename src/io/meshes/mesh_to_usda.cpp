// Meshes to USD layers in text.
#include "files/text_scan.h"
#include "io/vdb/usda_text.h"
#include "mesh_formats.h"

#include <mpuvdb/error.h>

#include <iterator>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Writes one array: "    TYPE NAME = [item, item, ...]"; format(i) appends item i.
template <class F>
void writeArray(const MeshJob& job, OutputBuffer& out, const std::string& name, std::size_t count,
                const F& format)
{
    constexpr std::size_t kItemsPerLine = 8; // [free: line length]
    out.text("    " + name + " = [");
    forEachItem(count, out, job.progress, [&](std::size_t i) {
        if (i > 0) out.text(i % kItemsPerLine == 0 ? ",\n        " : ", ");
        format(i);
    });
    out.text("]");
}

void formatTriple(const Vec3f& v, OutputBuffer& out)
{
    fmt::format_to(std::back_inserter(out.bytes()), "({}, {}, {})", v[0], v[1], v[2]);
}

void writeAttributes(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    const char* const perVertex = " (\n        interpolation = \"vertex\"\n    )\n";
    if (!mesh.colors.empty()) {
        writeArray(job, out, "color3f[] primvars:displayColor", mesh.colors.size(),
                   [&](std::size_t i) { formatTriple(mesh.colors[i], out); });
        out.text(perVertex);
    }
    for (const NamedScalars& scalars : mesh.scalars) {
        writeArray(job, out, "float[] primvars:" + identifier(scalars.name), scalars.values.size(),
                   [&](std::size_t i) {
                       fmt::format_to(std::back_inserter(out.bytes()), "{}", scalars.values[i]);
                   });
        out.text(perVertex);
    }
}

} // namespace

void writeUsda(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    const auto largest = std::size_t(std::numeric_limits<std::int32_t>::max());
    if (mesh.positions.size() > largest || mesh.triangles.size() > largest / 3)
        throw LimitError(fmt::format("{}: {} vertices and {} triangles are more than the indices "
                                     "of a USD mesh can hold. Use larger voxels, or write parts.",
                                     job.name, mesh.positions.size(), mesh.triangles.size()));
    const auto to = std::back_inserter(out.bytes());
    out.text(usdaHead("surface", job.scene) + "def Mesh \"surface\"\n{\n");
    Eigen::AlignedBox3f box;
    for (const Vec3f& p : mesh.positions) box.extend(p);
    if (!box.isEmpty()) {
        out.text("    float3[] extent = [");
        formatTriple(box.min(), out);
        out.text(", ");
        formatTriple(box.max(), out);
        out.text("]\n");
    }
    writeArray(job, out, "int[] faceVertexCounts", mesh.triangles.size(),
               [&](std::size_t) { out.text("3"); });
    out.text("\n");
    writeArray(job, out, "int[] faceVertexIndices", mesh.triangles.size(), [&](std::size_t i) {
        const Mesh::Triangle& t = mesh.triangles[i];
        fmt::format_to(to, "{}, {}, {}", t[0], t[1], t[2]);
    });
    out.text("\n    uniform token orientation = \"rightHanded\"\n");
    writeArray(job, out, "point3f[] points", mesh.positions.size(),
               [&](std::size_t i) { formatTriple(mesh.positions[i], out); });
    out.text("\n");
    writeAttributes(job, out);
    fmt::format_to(to,
                   "    uniform token subdivisionScheme = \"none\"\n"
                   "    double3 xformOp:translate = ({}, {}, {})\n"
                   "    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}}\n",
                   mesh.frame[0], mesh.frame[1], mesh.frame[2]);
}

} // namespace mpuvdb
