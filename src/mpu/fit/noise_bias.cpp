#include "noise_bias.h"

#include "fit_quality.h"

#include <algorithm>
#include <cmath>
#include <tbb/parallel_for.h>
#include <vector>

namespace mpuvdb
{
namespace
{

/// Largest product of curvature and noise: noise hides a surface with a larger one.
/// [tuned: noise_bench]
constexpr double kMaxCurvatureNoise = 0.5;

/// The place of a fit's zero set nearest to the origin of its coordinates, to first order.
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

/// The fit of the leaf that holds @a p.
const StoredFit& fitAt(const Octree& tree, const Vec3d& p)
{
    std::uint32_t node = 0;
    OctreeCell cell;
    while (!tree.nodes[node].isLeaf()) {
        const Vec3d center = tree.root.center(cell);
        const int octant =
            int(p[0] > center[0]) | int(p[1] > center[1]) << 1 | int(p[2] > center[2]) << 2;
        node = tree.nodes[node].index + std::uint32_t(octant);
        cell = cell.child(octant);
    }
    return tree.fits[tree.nodes[node].index];
}

/// Add the point @a p: its offset from the surface by the fits at its foot, which are not biased
/// towards points as far off as @a p.
void addPoint(const Octree& tree, const Vec3d& p, double noise, Sums& sums)
{
    constexpr int kFootSteps = 3; ///< steps to a foot [tuned: noise_bench]
    Vec3d at = p, step;
    Quadric q; // about the place before the last step
    for (int n = 0; n < kFootSteps; ++n, at += step) {
        const StoredFit& fit = fitAt(tree, at);
        if (fit.count != 1) return;
        q = tree.pieceAbout(fit, 0, at);
        step = foot(q);
        if (!(step.norm() < kMaxNoiseDistance * noise)) return;
    }
    const double k = curvature(q, step);
    if (!(std::abs(k) * noise < kMaxCurvatureNoise)) return;
    const Vec3d offset = p - at;
    sums.offset += k * std::copysign(offset.norm(), offset.dot(q.b));
    sums.square += k * k;
}

} // namespace

void removeNoiseBias(Octree& tree, const SortedPoints& points, double noise)
{
    /// Most points measured. [derived: the surface is off by the noise over the root of their
    /// number]
    constexpr std::size_t kMaxSamples = 1 << 16;
    /// Points of a task. [free: grain; but for roundings of a sum]
    constexpr std::size_t kChunk = 1024;
    const std::size_t stride = (points.size() + kMaxSamples - 1) / kMaxSamples,
                      asked = (points.size() + stride - 1) / stride;
    const PointBatch& p = points.points();
    std::vector<Sums> sums((asked + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), sums.size(), [&](std::size_t c) {
        const std::size_t end = std::min((c + 1) * kChunk, asked);
        for (std::size_t i = c * kChunk; i < end; ++i) {
            const std::size_t n = i * stride;
            addPoint(tree, Vec3d(p.x[n], p.y[n], p.z[n]), noise, sums[c]);
        }
    });
    Sums all;
    for (const Sums& s : sums) all.offset += s.offset, all.square += s.square;
    if (!(all.square > 0)) return;
    const double perCurvature = std::clamp(all.offset / all.square, 0.0, 2 * noise * noise);
    tbb::parallel_for(std::size_t(0), tree.fits.size(), [&](std::size_t n) {
        const StoredFit& stored = tree.fits[n];
        if (stored.count != 1) return;
        const Quadric q = tree.pieceAbout(stored, 0, stored.origin.cast<double>());
        const Vec3d y = foot(q);
        const double k =
            std::clamp(curvature(q, y), -kMaxCurvatureNoise / noise, kMaxCurvatureNoise / noise);
        tree.quadrics[stored.firstQuadric][0] -= float(perCurvature * k * q.gradient(y).norm());
    });
}

} // namespace mpuvdb
