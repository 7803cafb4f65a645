#include "noise_bias.h"

#include <algorithm>
#include <tbb/parallel_for.h>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

/// Of curvature times noise: a surface that turns faster is none, to the noise.
constexpr double kMostTurn = 0.2;

/// Where a fit's zero set is nearest to the origin of its coordinates, to first order.
Vec3d foot(const Quadric& q)
{
    return -q.c / std::max(q.b.squaredNorm(), 1e-12) * q.b;
}

/// Sum of the principal curvatures of a level set at @a y; positive where it is convex.
double curvature(const Quadric& q, const Vec3d& y)
{
    const Vec3d gradient = q.gradient(y);
    const double slope = std::max(gradient.norm(), 1e-6);
    const Vec3d normal = gradient / slope;
    return 2 * (q.A.trace() - normal.dot(q.A * normal)) / slope;
}

/// Sums over points: offset times curvature, and curvature squared.
struct Sums {
    double offset = 0, square = 0;
};

void addLeaf(const LocalFit& fit, const Vec3d& centre, const SortedPoints& points,
             const SortedPoints::Range& range, double noise, Sums& sums)
{
    const Quadric& q = fit.pieces[0];
    const double k = curvature(q, foot(q));
    if (!(std::abs(k) * noise < kMostTurn)) return;
    const PointBatch& p = points.points();
    for (std::size_t n = range.begin; n < range.end; ++n) {
        const Vec3d y = Vec3d(p.x[n], p.y[n], p.z[n]) - centre;
        sums.offset += k * q.value(y) / std::max(q.gradient(y).norm(), 1e-6);
        sums.square += k * k;
    }
}

} // namespace

void removeNoiseBias(Octree& tree, const SortedPoints& points, double noise)
{
    constexpr std::size_t kChunk = 256; // leaves
    std::vector<std::pair<std::uint32_t, OctreeCell>> leaves;
    tree.forEachLeaf([&](const OctreeNode& node, const OctreeCell& cell) {
        if (tree.fits[node.index].count == 1) leaves.push_back({node.index, cell});
    });
    std::vector<Sums> sums((leaves.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), sums.size(), [&](std::size_t c) {
        const std::size_t end = std::min((c + 1) * kChunk, leaves.size());
        for (std::size_t n = c * kChunk; n < end; ++n) {
            const auto& [index, cell] = leaves[n];
            const SortedPoints::Range range = points.cellRange(cell);
            if (range.begin == range.end) continue;
            const Vec3d centre = tree.root.centre(cell);
            addLeaf(tree.fitAbout(tree.fits[index], centre), centre, points, range, noise, sums[c]);
        }
    });
    Sums all;
    for (const Sums& s : sums) all.offset += s.offset, all.square += s.square;
    if (!(all.square > 0)) return;
    const double perCurvature = std::clamp(all.offset / all.square, 0.0, 2 * noise * noise);
    tbb::parallel_for(std::size_t(0), tree.fits.size(), [&](std::size_t n) {
        const StoredFit& stored = tree.fits[n];
        if (stored.count != 1) return;
        const Quadric q = tree.fitAbout(stored, stored.origin.cast<double>()).pieces[0];
        const Vec3d y = foot(q);
        const double k = std::clamp(curvature(q, y), -kMostTurn / noise, kMostTurn / noise);
        tree.quadrics[stored.firstQuadric][0] -= float(perCurvature * k * q.gradient(y).norm());
    });
}

} // namespace mpuvdb
