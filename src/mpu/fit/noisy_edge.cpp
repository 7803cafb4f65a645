// Edges and corners among noise.
#include "fit_quality.h"
#include "local_fit.h"
#include "sharp_faces.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Least turn between faces, in standard deviations of their normals. [tuned: noise_bench]
constexpr double kMinTurnNoises = 3;
constexpr double kMinTurn = 0.45; ///< least turn between faces, radians [paper: Ohtake03 eq. 14]

/// Least gain of an edge over a smooth fit, in squared standard deviations: in all, and per point;
/// and of a curved face over a flat one. [tuned: noise_bench]
constexpr double kMinGain = 10, kMinGainPerPoint = 0.8, kMinCurvedGain = 8;

/// Largest noisyMisfit() of most right fits. [tuned: noise_bench]
constexpr double kMaxRightMisfit = 3.6;

constexpr std::size_t kMinFacePoints = 8; ///< least points of a face [tuned: noise_bench]

/// Effective number of points by their weights.
double effectiveCount(const CellPoints& points)
{
    double total = 0, squares = 0;
    for (const double weight : points.weight) {
        total += weight;
        squares += weight * weight;
    }
    return squares > 0 ? total * total / squares : 0;
}

double misfit(const LocalFit& fit, const CellPoints& points, const FitSettings& settings)
{
    return noisyMisfit(fit, points, settings.noise, settings.normalNoise);
}

Vec3d farthestFrom(const Vec3d& axis, const CellPoints& points)
{
    Vec3d farthest = axis;
    double least = 1;
    for (std::size_t i = 0; i < points.count; ++i) {
        const double cosine = axis.dot(points.normal(i));
        if (cosine >= least) continue;
        least = cosine;
        farthest = points.normal(i);
    }
    return farthest;
}

/// The points nearest to each axis, after a few rounds of moving the axes to the means of theirs.
NormalClusters settle(const CellPoints& points, std::vector<Vec3d>& axes, CellPoints& scratch)
{
    constexpr int kSettleRounds = 2; ///< rounds of clustering [tuned: noise_bench]
    std::vector<std::uint32_t> all(points.count);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = std::uint32_t(i);
    NormalClusters clusters;
    for (int round = 0; round < kSettleRounds; ++round) {
        clusters = clusterNormals(points, all, axes);
        axes.clear();
        for (const auto& cluster : clusters) {
            scratch.assignSubset(points, cluster);
            axes.push_back(meanNormal(scratch));
        }
    }
    return clusters;
}

/// The mean of the normals across both axes [Ohtake03 eq. 15] if they are enough; else zero.
Vec3d thirdFace(const CellPoints& points, const std::vector<Vec3d>& axes)
{
    const Vec3d across = axes[0].cross(axes[1]).normalized();
    std::array<Vec3d, 2> sums = {Vec3d::Zero(), Vec3d::Zero()};
    std::array<std::size_t, 2> counts{};
    for (std::size_t i = 0; i < points.count; ++i) {
        const double cosine = across.dot(points.normal(i));
        if (std::abs(cosine) < kCornerCosine) continue;
        sums[cosine < 0] += points.normal(i);
        ++counts[cosine < 0];
    }
    const std::size_t side = counts[1] > counts[0];
    return counts[side] >= kMinFacePoints ? Vec3d(sums[side].normalized()) : Vec3d(Vec3d::Zero());
}

/// The points of two faces or three.
NormalClusters facesOf(const CellPoints& points, CellPoints& scratch)
{
    const Vec3d first = farthestFrom(meanNormal(points), points);
    std::vector<Vec3d> axes = {first, farthestFrom(first, points)};
    NormalClusters clusters = settle(points, axes, scratch);
    if (clusters.size() < 2) return clusters;
    if (const Vec3d third = thirdFace(points, axes); third != Vec3d::Zero()) {
        axes.push_back(third);
        clusters = settle(points, axes, scratch);
    }
    return clusters;
}

} // namespace

std::optional<LocalFit> fitNoisyEdge(const CellPoints& points, const LocalFit& smooth,
                                     const FitSettings& settings, CellPoints& scratch)
{
    const double smoothMisfit = misfit(smooth, points, settings);
    if (smoothMisfit < kMaxRightMisfit + kMinGainPerPoint) return std::nullopt;
    const NormalClusters clusters = facesOf(points, scratch);
    if (clusters.size() < 2) return std::nullopt;
    const double apart = std::cos(std::max(kMinTurn, kMinTurnNoises * settings.normalNoise));
    LocalFit fit;
    fit.count = int(clusters.size());
    std::vector<Vec3d> normals;
    for (std::size_t a = 0; a < clusters.size(); ++a) {
        if (clusters[a].size() < kMinFacePoints) return std::nullopt;
        scratch.assignSubset(points, clusters[a]);
        normals.push_back(meanNormal(scratch));
        for (std::size_t b = 0; b < a; ++b)
            if (normals[a].dot(normals[b]) > apart) return std::nullopt;
        LocalFit flat, curved;
        flat.pieces[0] = fitBivariate(scratch, normals[a], scratch.count + 1);
        curved.pieces[0] = fitBivariate(scratch, normals[a], kMinFacePoints, settings.lever);
        const bool isCurved =
            misfit(curved, scratch, settings) + kMinCurvedGain < misfit(flat, scratch, settings);
        fit.pieces[a] = (isCurved ? curved : flat).pieces[0];
    }
    combineFaces(fit,
                 [&](const LocalFit& candidate) { return misfit(candidate, points, settings); });
    const double gain = smoothMisfit - misfit(fit, points, settings);
    if (!(gain > std::max(kMinGainPerPoint, kMinGain / effectiveCount(points))))
        return std::nullopt;
    return fit;
}

} // namespace mpuvdb
