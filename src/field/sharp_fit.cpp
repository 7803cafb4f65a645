// Edges and corners [Ohtake03 §4c].
#include "fit_quality.h"
#include "local_fit.h"
#include "sharp_faces.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Indices of the two normals of widest angle, and the cosine between them.
struct WidestPair {
    std::size_t first = 0, second = 0;
    double cosine = 1;
};

WidestPair widestNormals(const CellPoints& points, const std::vector<std::uint32_t>& members)
{
    WidestPair widest;
    for (std::size_t a = 0; a < members.size(); ++a) {
        const Vec3d n = points.normal(members[a]);
        for (std::size_t b = a + 1; b < members.size(); ++b) {
            const double cosine = n.dot(points.normal(members[b]));
            if (cosine < widest.cosine) widest = {members[a], members[b], cosine};
        }
    }
    return widest;
}

constexpr double kFeatureCosine = 0.9; // [Ohtake03 eq. 14]
constexpr double kCornerCosine = 0.7;  // [Ohtake03 eq. 15]
// A dull fold turns normals by two degrees or more; its faces by an eighth of that.
constexpr double kDullestCosine = 0.9994;
constexpr double kFlat = 1.0 / 64; // 1 - cosine grows with the square of the angle
// Points that a face needs for curvature: with fewer a quadric swings out between them.
constexpr std::size_t kQuadraticFace = 12;

} // namespace

NormalClusters clusterNormals(const CellPoints& points, const std::vector<std::uint32_t>& members,
                              const std::vector<Vec3d>& axes)
{
    NormalClusters clusters(axes.size());
    for (const std::uint32_t i : members) {
        std::size_t best = 0;
        double bestCosine = -2;
        for (std::size_t a = 0; a < axes.size(); ++a) {
            const double cosine = axes[a].dot(points.normal(i));
            if (cosine > bestCosine) {
                bestCosine = cosine;
                best = a;
            }
        }
        clusters[best].push_back(i);
    }
    clusters.erase(
        std::remove_if(clusters.begin(), clusters.end(), [](const auto& c) { return c.empty(); }),
        clusters.end());
    return clusters;
}

namespace
{

/// The two clusters of a dull fold, if it is one of flat faces: then normals turn at it alone.
NormalClusters flatFaces(const CellPoints& points, const std::vector<std::uint32_t>& members,
                         const WidestPair& widest)
{
    if (widest.cosine > kDullestCosine) return {};
    NormalClusters faces = clusterNormals(
        points, members, {points.normal(widest.first), points.normal(widest.second)});
    const auto isFlat = [&](const std::vector<std::uint32_t>& face) {
        return 1 - widestNormals(points, face).cosine <= kFlat * (1 - widest.cosine);
    };
    return std::all_of(faces.begin(), faces.end(), isFlat) ? std::move(faces) : NormalClusters();
}

/// The paper's clusters: two for an edge, three or four for a corner; fewer than two: no feature.
/// Below the paper's angle those of flat faces.
NormalClusters featureClusters(const CellPoints& points)
{
    std::vector<std::uint32_t> all(points.count);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = std::uint32_t(i);
    const WidestPair widest = widestNormals(points, all);
    const Vec3d n1 = points.normal(widest.first), n2 = points.normal(widest.second);
    if (!(widest.cosine < kFeatureCosine)) return flatFaces(points, all, widest);
    const Vec3d axis = n1.cross(n2);
    if (axis.norm() < 1e-6) return clusterNormals(points, all, {n1, n2});
    const Vec3d n3 = axis.normalized();
    double extreme = 0;
    for (std::size_t i = 0; i < points.count; ++i) {
        const double cosine = n3.dot(points.normal(i));
        if (std::abs(cosine) > std::abs(extreme)) extreme = cosine;
    }
    if (!(std::abs(extreme) > kCornerCosine)) return clusterNormals(points, all, {n1, n2});
    NormalClusters clusters = clusterNormals(points, all, {n1, n2, extreme > 0 ? n3 : Vec3d(-n3)});
    if (clusters.size() < 3) return clusters;
    const WidestPair inThird = widestNormals(points, clusters[2]);
    if (inThird.cosine < kFeatureCosine) {
        const std::vector<std::uint32_t> third = std::move(clusters[2]);
        clusters.pop_back();
        for (auto& half : clusterNormals(
                 points, third, {points.normal(inThird.first), points.normal(inThird.second)}))
            clusters.push_back(std::move(half));
    }
    return clusters;
}

} // namespace

std::optional<LocalFit> fitSharp(const CellPoints& points, CellPoints& scratch)
{
    const NormalClusters clusters = featureClusters(points);
    if (clusters.size() < 2) return std::nullopt;
    LocalFit fit;
    fit.count = int(clusters.size());
    for (std::size_t a = 0; a < clusters.size(); ++a) {
        scratch.assignSubset(points, clusters[a]);
        fit.pieces[a] = fitBivariate(scratch, meanNormal(scratch), kQuadraticFace);
    }
    combineFaces(fit, [&](const LocalFit& candidate) {
        return taubinError(candidate, points, points.radius);
    });
    return fit;
}

} // namespace mpuvdb
