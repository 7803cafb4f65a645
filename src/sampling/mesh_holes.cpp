#include "mesh_holes.h"

#include "spatial/nearest_place.h"
#include "spatial/triangle_tree.h"
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// Volume between a triangle and the origin.
double volumeOf(const Vec3d& a, const Vec3d& b, const Vec3d& c)
{
    return a.dot(b.cross(c)) / 6;
}

} // namespace

MeshHoles::MeshHoles(const OrientedTriangles& triangles, const std::vector<std::uint8_t>& bounds,
                     double width, Interrupter& progress)
    : mTriangles(triangles)
{
    for (std::uint32_t n = 0; n < triangles.neighbors.size(); ++n)
        for (std::size_t k = 0; k < 3; ++k) {
            if (!bounds[n] || triangles.neighbors[n][k] != kNoTriangle) continue;
            const Mesh::Triangle& t = triangles.mesh.triangles[n];
            const double times = triangles.multiplicity.empty() ? 1 : triangles.multiplicity[n];
            mEdges.push_back({n, t[k], t[(k + 1) % 3], times});
        }
    if (mEdges.empty()) return;
    UnionFind rims(triangles.mesh.positions.size());
    for (const Edge& edge : mEdges) rims.join(edge.from, edge.to);
    mRims = rims.roots();
    findGaps(width, progress);
}

void MeshHoles::findGaps(double width, Interrupter& progress)
{
    Mesh segments; // triangles without an area
    segments.positions = mTriangles.mesh.positions;
    for (const Edge& edge : mEdges) segments.triangles.push_back({edge.from, edge.to, edge.to});
    const TriangleTree tree(segments, progress);
    const auto within = [&](const Edge& edge, double reach) {
        const Vec3d p = middle(edge);
        std::optional<Across> nearest;
        double least = reach * reach;
        tree.forEachNear(p, reach, [&](std::size_t slot) {
            const std::uint32_t n = tree.triangle(slot);
            if (mRims[mEdges[n].from] == mRims[edge.from]) return;
            const Vec3d a = place(mEdges[n].from), b = place(mEdges[n].to);
            const Vec3d at = NearestPlace(p, {a, b, b}).place;
            const double square = (at - p).squaredNorm();
            if (square > least || (nearest && square == least && n > nearest->edge)) return;
            least = square;
            nearest = Across{at - p, n};
        });
        return nearest;
    };
    // Gaps are narrow, and within their largest width may be very many edges.
    const auto across = [&](const Edge& edge) {
        std::optional<Across> found;
        for (double reach = width / 64; !found && reach <= width; reach *= 2)
            found = within(edge, reach);
        return found;
    };
    mAcross.resize(mEdges.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mEdges.size(), 64),
                      [&](const auto& range) {
                          progress.check();
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              mAcross[n] = across(mEdges[n]);
                      });
}

double MeshHoles::volume(const Vec3d& from) const
{
    struct Middle {
        Vec3d sum = Vec3d::Zero();
        double length = 0;
    };
    std::unordered_map<std::uint32_t, Middle> middles; // of holes, by rim
    for (std::size_t n = 0; n < mEdges.size(); ++n) {
        if (mAcross[n]) continue;
        const double length = (place(mEdges[n].to) - place(mEdges[n].from)).norm();
        Middle& hole = middles[mRims[mEdges[n].from]];
        hole.sum += length * middle(mEdges[n]);
        hole.length += length;
    }
    double volume = 0;
    for (std::size_t n = 0; n < mEdges.size(); ++n) {
        const Vec3d a = place(mEdges[n].from) - from, b = place(mEdges[n].to) - from;
        if (mAcross[n]) {
            const Vec3d half = mAcross[n]->offset / 2;
            volume +=
                mEdges[n].times * (volumeOf(b, a, a + half) + volumeOf(b, a + half, b + half));
            continue;
        }
        const Middle& hole = middles[mRims[mEdges[n].from]];
        if (hole.length > 0)
            volume += mEdges[n].times * volumeOf(hole.sum / hole.length - from, b, a);
    }
    return volume;
}

} // namespace mpuvdb
