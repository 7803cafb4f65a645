#include "mesh_points.h"

#include "points/vertex_mesh.h"
#include <mpuvdb/error.h>
#include <mpuvdb/normals.h>

#include <fmt/format.h>

#include <utility>

namespace mpuvdb
{
namespace
{

// Positions about the middle of those that are finite.
std::vector<Vec3f> localPositions(const std::vector<Vec3d>& positions)
{
    Box3d box;
    for (const Vec3d& p : positions)
        if (p.allFinite()) box.extend(p);
    const Vec3d middle = box.isEmpty() ? Vec3d(Vec3d::Zero()) : Vec3d(box.center());
    std::vector<Vec3f> local(positions.size());
    for (std::size_t i = 0; i < local.size(); ++i) local[i] = (positions[i] - middle).cast<float>();
    return local;
}

} // namespace

void appendStrips(const std::vector<std::int64_t>& corners, Triangles& triangles)
{
    std::size_t start = 0;
    for (std::size_t i = 0; i < corners.size(); ++i) {
        if (corners[i] < 0) start = i + 1;
        if (i < start + 2) continue;
        const auto a = std::uint32_t(corners[i - 2]), b = std::uint32_t(corners[i - 1]);
        const auto c = std::uint32_t(corners[i]);
        const bool odd = (i - start) % 2 == 1; // every other triangle of a strip turns over
        if (a != b && b != c && c != a)
            triangles.push_back(odd ? std::array{b, a, c} : std::array{a, b, c});
    }
}

const std::int64_t* findBadCorner(const std::vector<std::int64_t>& corners, std::uint64_t vertices,
                                  bool separate)
{
    for (const std::int64_t& corner : corners)
        if (corner < 0 ? !separate : std::uint64_t(corner) >= vertices) return &corner;
    return nullptr;
}

void throwBadCorner(std::int64_t corner, std::uint64_t vertices, const std::string& where)
{
    throw InputError(
        fmt::format("{}: vertex index {} of {} vertices: the file is damaged. Export it "
                    "again.",
                    where, corner, vertices));
}

void addMeshNormals(FilePoints& points)
{
    const Triangles triangles = std::exchange(points.triangles, {});
    points.meshTriangles = triangles.size();
    if (triangles.empty() || points.size() == 0) return;
    PointBlock& block = points.joined();
    Triangles usable;
    usable.reserve(triangles.size());
    std::vector<std::uint8_t> used(block.size(), 0);
    for (const auto& triangle : triangles) {
        bool finite = true; // one bad vertex would spoil its neighbors' normals
        for (const std::uint32_t corner : triangle) {
            finite = finite && block.positions[corner].allFinite();
            used[corner] = 1;
        }
        if (finite) usable.push_back(triangle);
    }
    points.mesh = vertexMesh(block.positions, usable);
    if (points.hasNormals()) return;
    block.normals = vertexNormals(localPositions(block.positions), usable);
    std::uint64_t unused = 0;
    for (const std::uint8_t u : used) unused += u == 0;
    if (unused > 0) {
        block.compact(used);
        points.dropped["unreferenced vertex"] += unused;
    }
    points.notes.push_back(fmt::format("normals computed from its {} triangles", triangles.size()));
}

} // namespace mpuvdb
