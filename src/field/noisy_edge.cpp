// Edges and corners among noise.
#include "fit_quality.h"
#include "local_fit.h"
#include "sharp_faces.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Faces turn from each other by this many standard deviations of their normals, and by the
/// paper's angle [Ohtake03 eq. 14].
constexpr double kTellingTurn = 3;
constexpr double kLeastTurn = 0.45; // radians

/// How much nearer to its points an edge has to be than a smooth fit, in squared standard
/// deviations, and a curved face than a flat one.
constexpr double kNearer = 10, kNearerPerPoint = 0.8, kCurvedNearer = 8;

constexpr std::size_t kFewestOfFace = 8, kMostFaces = 3;

/// What a point may count at most, squared standard deviations: it may be no point of the surface.
constexpr double kMost = 9;

/// How many points the weights leave.
double effectiveCount(const CellPoints& points)
{
    double total = 0, squares = 0;
    for (const double weight : points.weight) {
        total += weight;
        squares += weight * weight;
    }
    return squares > 0 ? total * total / squares : 0;
}

/// Mean over the points of the squares of residuals and of turns of normals, in standard
/// deviations: about 3 for a fit that is right.
double misfit(const LocalFit& fit, const CellPoints& points, const FitSettings& settings)
{
    double sum = 0, total = 0;
    for (std::size_t i = 0; i < points.count; ++i) {
        const double weight = points.weight[i];
        if (!(weight > 0)) continue;
        const Vec3d p = points.position(i);
        const Quadric& q = fit.ruling(p);
        const Vec3d gradient = q.gradient(p);
        const double slope = std::max(gradient.norm(), 1e-12);
        const double off = q.value(p) / slope / settings.noise;
        const double turn = 2 * (1 - gradient.dot(points.normal(i)) / slope) /
                            (settings.normalNoise * settings.normalNoise);
        sum += weight * (std::min(off * off, kMost) + std::min(turn, kMost));
        total += weight;
    }
    return total > 0 ? sum / total : 0;
}

/// Move each axis to the mean of the normals nearest to it, a few times.
NormalClusters settled(const CellPoints& points, NormalClusters clusters, CellPoints& scratch)
{
    constexpr int kRounds = 3;
    std::vector<std::uint32_t> all(points.count);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = std::uint32_t(i);
    for (int round = 0; round < kRounds; ++round) {
        std::vector<Vec3d> axes;
        for (const auto& cluster : clusters) {
            scratch.assignSubset(points, cluster);
            axes.push_back(meanNormal(scratch));
        }
        clusters = clusterNormals(points, all, axes);
    }
    return clusters;
}

} // namespace

std::optional<LocalFit> fitNoisyEdge(const CellPoints& points, const LocalFit& smooth,
                                     const FitSettings& settings, CellPoints& scratch)
{
    NormalClusters clusters = featureClusters(points);
    if (clusters.size() < 2 || clusters.size() > kMostFaces) return std::nullopt;
    clusters = settled(points, std::move(clusters), scratch);
    if (clusters.size() < 2) return std::nullopt;
    const double apart = std::cos(std::max(kLeastTurn, kTellingTurn * settings.normalNoise));
    LocalFit fit;
    fit.count = int(clusters.size());
    std::vector<Vec3d> normals;
    for (std::size_t a = 0; a < clusters.size(); ++a) {
        if (clusters[a].size() < kFewestOfFace) return std::nullopt;
        scratch.assignSubset(points, clusters[a]);
        normals.push_back(meanNormal(scratch));
        for (std::size_t b = 0; b < a; ++b)
            if (normals[a].dot(normals[b]) > apart) return std::nullopt;
        LocalFit flat, curved;
        flat.pieces[0] = fitBivariate(scratch, normals[a], scratch.count + 1);
        curved.pieces[0] = fitBivariate(scratch, normals[a], kFewestOfFace, settings.lever);
        const bool isCurved =
            misfit(curved, scratch, settings) + kCurvedNearer < misfit(flat, scratch, settings);
        fit.pieces[a] = (isCurved ? curved : flat).pieces[0];
    }
    combineFaces(fit,
                 [&](const LocalFit& candidate) { return misfit(candidate, points, settings); });
    const double gain = misfit(smooth, points, settings) - misfit(fit, points, settings);
    if (!(gain > std::max(kNearerPerPoint, kNearer / effectiveCount(points)))) return std::nullopt;
    return fit;
}

} // namespace mpuvdb
