#include "vertex_mesh.h"

#include "core/even_places.h"
#include "core/union_find.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace mpuvdb
{
namespace
{

/// Places at which a result is looked at. [derived: a share of one in a hundred is then known to a
/// seventh of itself]
constexpr std::size_t kPlaces = 4096;

using Triangle = std::array<std::uint32_t, 3>;

/// A number whose bits all depend on all of @a key's.
std::uint64_t mixed(std::uint64_t key)
{
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15u;
    key = (key ^ key >> 29) * 0xd6e8feb86659fd93u;
    return key ^ key >> 32;
}

/// A number of a position, the same for equal ones.
std::uint64_t numberOf(const Vec3d& p)
{
    std::uint64_t number = 0;
    for (const double x : {p[0], p[1], p[2]}) {
        std::uint64_t bits;
        const double unsignedZero = x + 0.0;
        std::memcpy(&bits, &unsignedZero, sizeof bits);
        number = mixed(number ^ bits);
    }
    return number;
}

/// Of each vertex the first at the same position; of those that are not finite, themselves.
std::vector<std::uint32_t> firstVertices(const std::vector<Vec3d>& positions)
{
    constexpr std::uint32_t kFree = 0xffffffffu; // [derived: no vertex has this number]
    std::size_t slots = 16;
    while (slots < 2 * positions.size()) slots *= 2;
    std::vector<std::uint32_t> table(slots, kFree), first(positions.size());
    for (std::uint32_t v = 0; v < positions.size(); ++v) {
        first[v] = v;
        if (!positions[v].allFinite()) continue; // equal to none
        std::size_t slot = numberOf(positions[v]) & (slots - 1);
        while (table[slot] != kFree && positions[table[slot]] != positions[v])
            slot = (slot + 1) & (slots - 1);
        if (table[slot] == kFree) table[slot] = v;
        first[v] = table[slot];
    }
    return first;
}

/// Whether all edges cancel: edges that run from p to q and from q to p add nothing to the sum.
/// [derived: sums of random 64-bit numbers are 0 by chance once in 10^19]
/// @param first  of each vertex, that at its position.
bool isClosed(const std::vector<std::uint32_t>& first, const std::vector<Triangle>& triangles)
{
    std::uint64_t sum = 0;
    for (const Triangle& t : triangles)
        for (std::size_t side = 0; side < 3; ++side) {
            const std::uint32_t from = first[t[side]], to = first[t[(side + 1) % 3]];
            const std::uint64_t edge =
                mixed(std::uint64_t(std::min(from, to)) << 32 | std::max(from, to));
            sum += from < to ? edge : from > to ? ~edge + 1 : 0;
        }
    return sum == 0;
}

} // namespace

std::shared_ptr<const VertexMesh> vertexMesh(const std::vector<Vec3d>& positions,
                                             const std::vector<Triangle>& triangles)
{
    if (triangles.empty()) return nullptr;
    const Vec3d middle = positions[triangles.front()[0]]; // volumes lose little to it
    const auto corners = [&](std::size_t n) {
        const Triangle& t = triangles[n];
        return std::array<Vec3d, 3>{positions[t[0]], positions[t[1]], positions[t[2]]};
    };
    auto mesh = std::make_shared<VertexMesh>();
    const std::vector<std::uint32_t> first = firstVertices(positions);
    mesh->isClosed = isClosed(first, triangles);
    UnionFind joined(positions.size());
    for (std::uint32_t v = 0; v < first.size(); ++v) joined.join(v, first[v]);
    for (const Triangle& t : triangles) joined.join(t[0], t[1]), joined.join(t[0], t[2]);
    const std::vector<std::uint32_t>& roots = joined.roots();
    std::vector<double> volumes(positions.size());
    for (std::size_t n = 0; n < triangles.size(); ++n) {
        const std::array<Vec3d, 3> c = corners(n);
        const Vec3d normal = (c[1] - c[0]).cross(c[2] - c[0]);
        volumes[roots[triangles[n][0]]] += (c[0] - middle).dot(normal) / 6;
        mesh->area += normal.norm() / 2;
    }
    if (!(mesh->area > 0)) return nullptr;
    std::vector<bool> isUsed(positions.size());
    for (const Triangle& t : triangles) isUsed[roots[t[0]]] = true;
    for (std::uint32_t v = 0; v < volumes.size(); ++v) {
        if (!isUsed[v]) continue;
        mesh->volume += mesh->isClosed ? volumes[v] : 0;
        const bool isCavity = mesh->isClosed && volumes[v] < 0;
        mesh->cavities += isCavity;
        mesh->parts += !isCavity;
    }
    if (mesh->volume < 0) {
        mesh->insideOut = true;
        mesh->volume = -mesh->volume;
        std::swap(mesh->parts, mesh->cavities);
    }
    std::vector<double> edges; // the longest at each place
    for (const TrianglePlace& place : placesOn(triangles.size(), kPlaces, corners)) {
        const std::array<Vec3d, 3> c = corners(place.triangle);
        edges.push_back(
            std::max({(c[1] - c[0]).norm(), (c[2] - c[1]).norm(), (c[0] - c[2]).norm()}));
        mesh->places.push_back(place.position);
    }
    const auto middleEdge = edges.begin() + std::ptrdiff_t(edges.size() / 2);
    std::nth_element(edges.begin(), middleEdge, edges.end());
    mesh->edge = *middleEdge;
    return mesh;
}

} // namespace mpuvdb
