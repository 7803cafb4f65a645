#include "core/union_find.h"
#include <mpuvdb/mesh.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// A triangle's side, in the triangle's direction.
struct HalfEdge {
    std::uint32_t from, to;

    std::uint32_t lower() const { return std::min(from, to); }
    std::uint64_t key() const { return std::uint64_t(lower()) << 32 | std::max(from, to); }
    bool forward() const { return from < to; }
};

/// All sides, sorted by their lower vertex and then by the other: those of one edge are together.
std::vector<HalfEdge> sortedHalfEdges(const Mesh& mesh)
{
    std::vector<std::size_t> first(mesh.positions.size() + 1, 0); // of each lower vertex
    const auto forEachSide = [&](const auto& visit) {
        for (const Mesh::Triangle& v : mesh.triangles)
            for (std::size_t side = 0; side < 3; ++side)
                visit(HalfEdge{v[side], v[(side + 1) % 3]});
    };
    forEachSide([&](const HalfEdge& edge) { ++first[edge.lower() + 1]; });
    std::partial_sum(first.begin(), first.end(), first.begin());
    std::vector<HalfEdge> edges(3 * mesh.triangles.size());
    // Placing moves each start to that of the next vertex.
    forEachSide([&](const HalfEdge& edge) { edges[first[edge.lower()]++] = edge; });
    tbb::parallel_for(std::size_t(0), mesh.positions.size(), [&](std::size_t v) {
        std::sort(edges.begin() + std::ptrdiff_t(v > 0 ? first[v - 1] : 0),
                  edges.begin() + std::ptrdiff_t(first[v]),
                  [](const HalfEdge& a, const HalfEdge& b) { return a.key() < b.key(); });
    });
    return edges;
}

/// The number of connected parts of @a edges.
std::uint64_t countLoops(const std::vector<HalfEdge>& edges)
{
    std::unordered_map<std::uint32_t, std::uint32_t> placeOf; // of a vertex among those here
    for (const HalfEdge& edge : edges)
        for (const std::uint32_t v : {edge.from, edge.to})
            placeOf.try_emplace(v, std::uint32_t(placeOf.size()));
    UnionFind parts(placeOf.size());
    std::uint64_t loops = placeOf.size();
    for (const HalfEdge& edge : edges)
        loops -= parts.join(placeOf.at(edge.from), placeOf.at(edge.to));
    return loops;
}

/// Counts edges by kind. @return the number of edges.
std::uint64_t countEdges(const std::vector<HalfEdge>& edges, MeshReport& report)
{
    std::uint64_t distinct = 0;
    std::vector<HalfEdge> boundary;
    for (std::size_t i = 0; i < edges.size(); ++distinct) {
        std::size_t uses = 0, forward = 0;
        for (const std::uint64_t key = edges[i].key(); i < edges.size() && edges[i].key() == key;
             ++i) {
            ++uses;
            forward += edges[i].forward();
        }
        if (uses == 1)
            boundary.push_back(edges[i - 1]);
        else if (uses > 2 || forward != 1)
            ++report.nonManifoldEdges;
    }
    report.boundaryEdges = boundary.size();
    report.boundaryLoops = countLoops(boundary);
    return distinct;
}

/// Counts the vertices that triangles use, and their connected components.
void countVertices(const Mesh& mesh, std::uint64_t& used, std::uint64_t& components)
{
    UnionFind parts(mesh.positions.size());
    std::vector<bool> isUsed(mesh.positions.size());
    std::uint64_t joined = 0;
    for (const Mesh::Triangle& triangle : mesh.triangles) {
        for (const std::uint32_t v : triangle) isUsed[v] = true;
        for (const std::size_t corner : {1, 2}) joined += parts.join(triangle[0], triangle[corner]);
    }
    used = std::uint64_t(std::count(isUsed.begin(), isUsed.end(), true));
    components = used - joined;
}

/// Twice the area and six times the volume; the same for any number of threads.
Eigen::Array2d sumTriangles(const Mesh& mesh)
{
    return tbb::parallel_deterministic_reduce(
        tbb::blocked_range<std::size_t>(0, mesh.triangles.size(), 4096),
        Eigen::Array2d(Eigen::Array2d::Zero()),
        [&](const tbb::blocked_range<std::size_t>& range, Eigen::Array2d sums) {
            for (std::size_t t = range.begin(); t != range.end(); ++t) {
                const Mesh::Triangle& v = mesh.triangles[t];
                const Vec3d a = mesh.positions[v[0]].cast<double>();
                const Vec3d b = mesh.positions[v[1]].cast<double>();
                const Vec3d c = mesh.positions[v[2]].cast<double>();
                const Vec3d normal = (b - a).cross(c - a);
                sums += Eigen::Array2d(normal.norm(), a.dot(normal));
            }
            return sums;
        },
        [](const Eigen::Array2d& a, const Eigen::Array2d& b) { return Eigen::Array2d(a + b); });
}

/// The sine of a triangle's smallest angle, which is opposite its shortest side.
float smallestSine(const Vec3f& a, const Vec3f& b, const Vec3f& c)
{
    const Vec3d u = (b - a).cast<double>(), v = (c - a).cast<double>();
    const double sides[3] = {u.squaredNorm(), v.squaredNorm(), (v - u).squaredNorm()};
    const double others = sides[0] * sides[1] * sides[2] / *std::min_element(sides, sides + 3);
    return others > 0 ? float(u.cross(v).norm() / std::sqrt(others)) : 0;
}

void measureAngles(const Mesh& mesh, MeshReport& report)
{
    constexpr std::size_t kHundred = 100; // [derived: one in a hundred is the first percentile]
    if (mesh.triangles.empty()) return;
    std::vector<float> sines(mesh.triangles.size());
    tbb::parallel_for(std::size_t(0), sines.size(), [&](std::size_t t) {
        const Mesh::Triangle& v = mesh.triangles[t];
        sines[t] = smallestSine(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]);
    });
    const auto degrees = [](float sine) {
        return std::asin(std::min(double(sine), 1.0)) * 180 / M_PI;
    };
    const auto hundredth = sines.begin() + std::ptrdiff_t(sines.size() / kHundred);
    std::nth_element(sines.begin(), hundredth, sines.end());
    report.firstPercentileAngle = degrees(*hundredth);
    report.smallestAngle = degrees(*std::min_element(sines.begin(), hundredth + 1));
}

} // namespace

MeshReport measure(const Mesh& mesh)
{
    MeshReport report;
    report.vertices = mesh.positions.size();
    report.triangles = mesh.triangles.size();
    const std::uint64_t edges = countEdges(sortedHalfEdges(mesh), report);
    std::uint64_t used = 0;
    countVertices(mesh, used, report.components);
    report.eulerCharacteristic =
        std::int64_t(used) - std::int64_t(edges) + std::int64_t(mesh.triangles.size());
    report.genus = double(report.components) -
                   double(report.eulerCharacteristic + std::int64_t(report.boundaryLoops)) / 2;
    measureAngles(mesh, report);
    const Eigen::Array2d sums = sumTriangles(mesh);
    report.area = sums[0] / 2;
    report.volume = sums[1] / 6;
    return report;
}

} // namespace mpuvdb
