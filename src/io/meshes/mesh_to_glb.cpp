// Meshes to binary glTF 2.0.
#include "files/text_scan.h"
#include "mesh_formats.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The header, and the types of chunks, components and buffers. [derived: glTF 2.0]
constexpr std::uint32_t kMagic = 0x46546c67, kVersion = 2; // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4e4f534a, kBinaryChunk = 0x004e4942;
constexpr std::uint64_t kHeadBytes = 12, kChunkHeadBytes = 8;
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kVertices = 34962, kIndices = 34963;

/// The buffer views and accessors of a GLB file.
class Description
{
public:
    /// Appends a part of the binary. @param accessor  its members: "count", "type" and so on.
    /// @return its index.
    int add(std::uint64_t bytes, int target, const std::string& accessor)
    {
        const char* const comma = mCount == 0 ? "" : ",";
        mViews += fmt::format(R"({}{{"buffer":0,"byteOffset":{},"byteLength":{},"target":{}}})",
                              comma, mBytes, bytes, target);
        mAccessors += fmt::format(R"({}{{"bufferView":{},{}}})", comma, mCount, accessor);
        mBytes += bytes;
        return mCount++;
    }

    std::uint64_t bytes() const { return mBytes; }
    const std::string& views() const { return mViews; }
    const std::string& accessors() const { return mAccessors; }

private:
    std::string mViews, mAccessors;
    std::uint64_t mBytes = 0;
    int mCount = 0;
};

std::string boundsText(const Mesh& mesh)
{
    Eigen::AlignedBox3f box;
    for (const Vec3f& p : mesh.positions) box.extend(p);
    const Vec3f &a = box.min(), &b = box.max();
    return fmt::format(R"("min":[{},{},{}],"max":[{},{},{}])", a[0], a[1], a[2], b[0], b[1], b[2]);
}

/// The transform of the mesh's own coordinates to a world of meters with Y up.
std::string placement(const Mesh& mesh, const SceneSettings& scene)
{
    const bool turned = scene.up == UpAxis::Z;
    const Vec3d& f = mesh.frame;
    const Vec3d at = scene.metersPerUnit * (turned ? Vec3d(f[0], f[2], -f[1]) : f);
    std::string text = fmt::format(R"("translation":[{},{},{}])", at[0], at[1], at[2]);
    if (turned) text += fmt::format(R"(,"rotation":[{},0,0,{}])", -std::sqrt(0.5), std::sqrt(0.5));
    if (scene.metersPerUnit != 1)
        text += fmt::format(R"(,"scale":[{0},{0},{0}])", scene.metersPerUnit);
    return text;
}

std::string describe(const Mesh& mesh, const SceneSettings& scene, std::uint64_t& binary)
{
    std::string json = R"({"asset":{"version":"2.0","generator":"mpuvdb"},"scene":0,)"
                       R"("scenes":[{"nodes":[0]}],)";
    binary = 0;
    if (mesh.triangles.empty()) // glTF has no empty arrays
        return json + R"("nodes":[{"name":"surface"}]})";
    const std::size_t vertices = mesh.positions.size();
    const GlbSizes sizes(mesh.triangles.size(), vertices);
    Description parts;
    const auto attribute = [&](std::uint64_t bytes, int component, const char* more) {
        return parts.add(
            bytes, kVertices,
            fmt::format(R"("componentType":{},"count":{},{})", component, vertices, more));
    };
    const int indices = parts.add(sizes.indices, kIndices,
                                  fmt::format(R"("componentType":{},"count":{},"type":"SCALAR")",
                                              kUnsignedInt, 3 * mesh.triangles.size()));
    const std::string bounds = R"("type":"VEC3",)" + boundsText(mesh);
    std::string attributes =
        fmt::format(R"("POSITION":{})", attribute(sizes.positions, kFloat, bounds.c_str()));
    if (!mesh.colors.empty())
        attributes +=
            fmt::format(R"(,"COLOR_0":{})", attribute(sizes.colors, kUnsignedShort,
                                                      R"("type":"VEC4","normalized":true)"));
    for (const NamedScalars& scalars : mesh.scalars)
        attributes += fmt::format(R"(,"_{}":{})", identifier(scalars.name),
                                  attribute(sizes.scalars, kFloat, R"("type":"SCALAR")"));
    binary = parts.bytes();
    return json +
           fmt::format(R"("nodes":[{{"name":"surface","mesh":0,{}}}],)"
                       R"("meshes":[{{"name":"surface","primitives":[{{"attributes":{{{}}},)"
                       R"("indices":{},"material":0}}]}}],)"
                       R"("materials":[{{"pbrMetallicRoughness":{{"metallicFactor":0}}}}],)"
                       R"("buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}})",
                       placement(mesh, scene), attributes, indices, binary, parts.views(),
                       parts.accessors());
}

void writeBinary(const MeshJob& job, OutputBuffer& out)
{
    const Mesh& mesh = job.mesh;
    forEachItem(mesh.triangles.size(), out, job.progress, [&](std::size_t i) {
        out.append(mesh.triangles[i].data(), sizeof(Mesh::Triangle));
    });
    forEachItem(mesh.positions.size(), out, job.progress,
                [&](std::size_t i) { out.append(mesh.positions[i].data(), 3 * sizeof(float)); });
    forEachItem(mesh.colors.size(), out, job.progress, [&](std::size_t i) {
        for (int c = 0; c < 3; ++c)
            out.value(std::uint16_t(65535 * std::clamp(mesh.colors[i][c], 0.0f, 1.0f) + 0.5f));
        out.value(std::uint16_t(65535));
    });
    for (const NamedScalars& scalars : mesh.scalars)
        forEachItem(scalars.values.size(), out, job.progress,
                    [&](std::size_t i) { out.value(scalars.values[i]); });
}

} // namespace

GlbSizes::GlbSizes(std::uint64_t triangles, std::uint64_t vertices)
    : indices(sizeof(Mesh::Triangle) * triangles), positions(3 * sizeof(float) * vertices),
      colors(4 * sizeof(std::uint16_t) * vertices), scalars(sizeof(float) * vertices)
{
}

void requireGlbFits(std::uint64_t binary, std::uint64_t json, const std::string& name)
{
    const std::uint64_t all = kHeadBytes + 2 * kChunkHeadBytes + binary + json;
    if (all > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("{}: the mesh takes {:.2f} GiB, and a .glb file holds less "
                                     "than 4. Write a .ply file, or use larger voxels.",
                                     name, double(all) / double(1 << 30)));
}

void writeGlb(const MeshJob& job, OutputBuffer& out)
{
    std::uint64_t binary = 0;
    std::string json = describe(job.mesh, job.scene, binary);
    json.resize((json.size() + 3) / 4 * 4, ' ');
    requireGlbFits(binary, json.size(), job.name);
    const std::uint64_t chunk = binary > 0 ? kChunkHeadBytes + binary : 0;
    out.value(kMagic);
    out.value(kVersion);
    out.value(std::uint32_t(kHeadBytes + kChunkHeadBytes + json.size() + chunk));
    out.value(std::uint32_t(json.size()));
    out.value(kJsonChunk);
    out.text(json);
    if (binary == 0) return;
    out.value(std::uint32_t(binary));
    out.value(kBinaryChunk);
    writeBinary(job, out);
}

} // namespace mpuvdb
