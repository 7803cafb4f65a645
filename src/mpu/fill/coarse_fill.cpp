#include "coarse_fill.h"

#include <mpuvdb/vec.h>

#include <algorithm>
#include <cmath>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Harmonic value on the grid's box, node steps. Above 0, so that every surface closes inside; low,
/// so that caps over openings bulge outwards: over a hole in a sphere a higher one is flat.
/// [tuned: unseen_bench]
constexpr float kBorderValue = 0.7f;
/// Share of a distance in the fill; the rest is harmonic. A harmonic function alone saturates, and
/// makes too much of an object of which half is unseen. [tuned: unseen_bench]
constexpr float kDistanceShare = 0.05f;
/// Weight of the curvature of concave data beyond their rims: a harmonic function makes a chord of
/// the unseen wall of a bore. Above 1 because the curvature fades with distance; more dents convex
/// parts beside a fold. [tuned: unseen_bench, coarse_sign_test]
constexpr float kConcaveWeight = 3.5f;
/// Distance over which normals and curvature of data fade, node steps. [tuned: unseen_bench]
constexpr float kFadeDistance = 10;
/// Largest sum of principal curvatures, per node step: at edges it has no bound.
/// [tuned: unseen_bench]
constexpr float kMaxCurvature = 0.3f;

/// Call f(node) for the interior nodes, in parallel.
template <typename F>
void forEachInterior(const NodeGrid& grid, F f)
{
    tbb::parallel_for(1, grid.n[0] - 1, [&](int i) {
        for (int j = 1; j < grid.n[1] - 1; ++j)
            for (int k = 1; k < grid.n[2] - 1; ++k) f(grid.index(i, j, k));
    });
}

/// Index offset to the next node on each axis.
std::array<std::size_t, 3> strides(const NodeGrid& grid)
{
    return {std::size_t(grid.n[1]) * std::size_t(grid.n[2]), std::size_t(grid.n[2]), 1};
}

float divergence(const std::array<std::vector<float>, 3>& v, std::size_t n,
                 const std::array<std::size_t, 3>& stride)
{
    float sum = 0;
    for (std::size_t c = 0; c < 3; ++c) sum += v[c][n + stride[c]] - v[c][n - stride[c]];
    return 0.5f * sum;
}

std::vector<float> faded(std::vector<float> weight)
{
    for (float& w : weight) w += 1 / (kFadeDistance * kFadeDistance);
    return weight;
}

/// The data's normals, extended to unit vectors at all nodes.
std::array<std::vector<float>, 3> spreadNormals(const NodeGrid& grid, const NodeData& data,
                                                Interrupter& progress)
{
    std::array<std::vector<float>, 3> spread;
    ScreenedPoisson solver(grid, faded(data.weight), progress);
    std::vector<float> rightHand(grid.size());
    for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t n = 0; n < grid.size(); ++n)
            rightHand[n] = -data.weight[n] * data.normal[c][n];
        spread[c] = solver.solve(rightHand, 0, 0);
    }
    forEachInterior(grid, [&](std::size_t n) {
        const Vec3f normal(spread[0][n], spread[1][n], spread[2][n]);
        const float length = normal.norm();
        for (auto& s : spread) s[n] = length > 0 ? s[n] / length : 0.0f;
    });
    return spread;
}

/// Whether there are data at the node @a other, and not of a sheet that faces the one at @a n
/// across a gap: between two walls differences of normals are no curvature.
bool isOnOneSheet(const NodeData& data, std::size_t n, std::size_t other)
{
    constexpr float kMinSheetCosine = -0.3f; ///< least cosine in one sheet [tuned: unseen_bench]
    float cosine = 0;
    for (const auto& normal : data.normal) cosine += normal[n] * normal[other];
    return data.weight[other] > 0 && cosine >= kMinSheetCosine;
}

} // namespace

NodeData::NodeData(const NodeGrid& grid, bool withNormals)
    : weight(grid.size(), 0.0f), distance(grid.size(), 0.0f)
{
    if (withNormals) normal = {distance, distance, distance};
}

NodeGrid halved(const NodeGrid& grid)
{
    return {{grid.n[0] / 2 + 1, grid.n[1] / 2 + 1, grid.n[2] / 2 + 1}};
}

std::vector<float> spreadConcavity(const NodeGrid& grid, const NodeData& data,
                                   const std::vector<float>& border, Interrupter& progress)
{
    // It spreads through the air that the data face; nodes behind data hold it at 0, or dents would
    // open a cavity in the solid beneath them.
    const auto stride = strides(grid);
    std::vector<float> weight(grid.size(), 0.0f), rightHand(grid.size(), 0.0f);
    forEachInterior(grid, [&](std::size_t n) {
        if (!(data.weight[n] > 0)) return;
        const bool inAir = data.distance[n] > 0;
        for (const std::size_t s : stride)
            if (inAir && !(isOnOneSheet(data, n, n - s) && isOnOneSheet(data, n, n + s))) return;
        weight[n] = data.weight[n];
        if (!inAir) return;
        const float bend = divergence(data.normal, n, stride);
        rightHand[n] = -weight[n] * std::clamp(bend, -kMaxCurvature, kMaxCurvature);
    });
    ScreenedPoisson solver(grid, faded(std::move(weight)), progress);
    std::vector<float> spread = solver.solve(std::move(rightHand), border, 0);
    for (float& s : spread) s = std::min(s, 0.0f);
    return spread;
}

std::vector<float> spreadDivergence(const NodeGrid& grid, const NodeData& data,
                                    Interrupter& progress)
{
    const std::array<std::vector<float>, 3> normals = spreadNormals(grid, data, progress);
    std::vector<float> spread(grid.size(), 0.0f);
    const auto stride = strides(grid);
    forEachInterior(grid, [&](std::size_t n) { spread[n] = divergence(normals, n, stride); });
    return spread;
}

std::vector<float> outsideBorder(std::vector<float> distance)
{
    for (float& b : distance) b = (1 - kDistanceShare) * kBorderValue + kDistanceShare * b;
    return distance;
}

std::vector<float> fillBetween(const NodeGrid& grid, NodeData data, const Curvature& curvature,
                               const std::vector<float>& border, Interrupter& progress)
{
    const NodeGrid half = halved(grid);
    std::vector<float> bend(half.size());
    for (std::size_t n = 0; n < bend.size(); ++n)
        bend[n] = kConcaveWeight * curvature.concave[n] + kDistanceShare * curvature.divergence[n];
    std::vector<float>& rightHand = data.distance; // not used any more
    tbb::parallel_for(1, grid.n[0] - 1, [&](int i) {
        for (int j = 1; j < grid.n[1] - 1; ++j)
            for (int k = 1; k < grid.n[2] - 1; ++k) {
                float sum = 0;
                for (int c = 0; c < 8; ++c)
                    sum += bend[half.index((i + (c >> 2)) / 2, (j + (c >> 1 & 1)) / 2,
                                           (k + (c & 1)) / 2)];
                const std::size_t n = grid.index(i, j, k);
                rightHand[n] = 0.5f * sum / 8 - data.weight[n] * rightHand[n];
            }
    });
    ScreenedPoisson solver(grid, std::move(data.weight), progress);
    return solver.solve(std::move(rightHand), border, 2);
}

} // namespace mpuvdb
