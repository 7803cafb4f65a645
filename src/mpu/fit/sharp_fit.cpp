// Edges and corners [Ohtake03 §4c].
#include "core/clones.h"
#include "fit_quality.h"
#include "local_fit.h"
#include "sharp_faces.h"
#include "spatial/point_group.h"

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

/// Indices of the two normals of widest angle, and the cosine between them.
struct WidestPair {
    std::size_t first = 0, second = 0;
    double cosine = 1;
};

/// Cosines between @a normal and four normals from the @a i th on.
[[gnu::always_inline]] inline Group cosinesTo(const Vec3d& normal, const CellPoints& points,
                                              std::size_t i)
{
    return load(points.nx, i) * normal[0] +
           (load(points.ny, i) * normal[1] + load(points.nz, i) * normal[2]);
}

/// The pair of widest angle; the first of several.
MPUVDB_WIDE_CLONES
WidestPair widestNormals(const CellPoints& points)
{
    constexpr std::size_t kGroup =
        CellPoints::kGroup; ///< points of a group [derived: as CellPoints]
    WidestPair widest;
    for (std::size_t a = 0; a + 1 < points.count; ++a) {
        const Vec3d normal = points.normal(a);
        // Pairs with normals before it are compared already; its own square is not exactly 1.
        const std::size_t begin = a / kGroup * kGroup;
        Group lowest = cosinesTo(normal, points, begin);
        lowest[a % kGroup] = 1;
        for (std::size_t i = begin + kGroup; i < points.paddedCount(); i += kGroup) {
            const Group cosines = cosinesTo(normal, points, i);
            lowest = cosines < lowest ? cosines : lowest;
        }
        const double cosine = smallest(lowest);
        if (!(cosine < widest.cosine)) continue;
        std::size_t b = a + 1;
        while (cosinesTo(normal, points, b / kGroup * kGroup)[b % kGroup] != cosine) ++b;
        widest = {a, b, cosine};
    }
    return widest;
}

/// Cosine of the widest normals below which there is a feature. [paper: Ohtake03 eq. 14]
constexpr double kFeatureCosine = 0.9;
/// Largest cosine across a dull fold of flat faces, of two degrees. [tuned: local_fit_test]
constexpr double kMaxFoldCosine = 0.9994;
/// Largest 1 - cosine within its faces, in that across it: the square of an eighth of the angle.
/// [tuned: local_fit_test]
constexpr double kFlatnessRatio = 1.0 / 64;
constexpr double kRounding = 1e-12; ///< rounding of cosines [derived: of doubles]
/// Least points of a curved face: with fewer a quadric oscillates between them.
/// [tuned: local_fit_test]
constexpr std::size_t kMinQuadraticFacePoints = 12;

} // namespace

NormalClusters clusterNormals(const CellPoints& points, const std::vector<std::uint32_t>& members,
                              const std::vector<Vec3d>& axes)
{
    NormalClusters clusters(axes.size());
    for (auto& cluster : clusters) cluster.reserve(members.size());
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

/// The two clusters of a dull fold of flat faces, where normals turn only across it; else none.
NormalClusters flatFaces(const CellPoints& points, const std::vector<std::uint32_t>& members,
                         const WidestPair& widest, CellPoints& scratch)
{
    if (widest.cosine > kMaxFoldCosine) return {};
    const std::vector<Vec3d> axes = {points.normal(widest.first), points.normal(widest.second)};
    NormalClusters faces = clusterNormals(points, members, axes);
    const double flat = 1 - kFlatnessRatio * (1 - widest.cosine);
    for (std::size_t f = 0; f < faces.size(); ++f) {
        // One of the face's normals is its axis, so that most faces that are not flat are rejected
        // here.
        const bool mayBeFlat = std::all_of(faces[f].begin(), faces[f].end(), [&](std::uint32_t i) {
            return axes[f].dot(points.normal(i)) >= flat - kRounding;
        });
        if (!mayBeFlat) return {};
        scratch.assignSubset(points, faces[f]);
        if (widestNormals(scratch).cosine < flat) return {};
    }
    return faces;
}

/// The paper's clusters: two for an edge, three or four for a corner; fewer than two: no feature.
/// Below the paper's angle those of flat faces.
NormalClusters featureClusters(const CellPoints& points, CellPoints& scratch)
{
    std::vector<std::uint32_t> all(points.count);
    std::iota(all.begin(), all.end(), 0u);
    const WidestPair widest = widestNormals(points);
    const Vec3d n1 = points.normal(widest.first), n2 = points.normal(widest.second);
    if (!(widest.cosine < kFeatureCosine)) return flatFaces(points, all, widest, scratch);
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
    scratch.assignSubset(points, clusters[2]);
    const WidestPair inThird = widestNormals(scratch);
    if (inThird.cosine < kFeatureCosine) {
        const std::vector<std::uint32_t> third = std::move(clusters[2]);
        clusters.pop_back();
        for (auto& half : clusterNormals(
                 points, third, {scratch.normal(inThird.first), scratch.normal(inThird.second)}))
            clusters.push_back(std::move(half));
    }
    return clusters;
}

} // namespace

std::optional<LocalFit> fitSharp(const CellPoints& points, CellPoints& scratch)
{
    const NormalClusters clusters = featureClusters(points, scratch);
    if (clusters.size() < 2) return std::nullopt;
    LocalFit fit;
    fit.count = int(clusters.size());
    for (std::size_t a = 0; a < clusters.size(); ++a) {
        scratch.assignSubset(points, clusters[a]);
        fit.pieces[a] = fitBivariate(scratch, meanNormal(scratch), kMinQuadraticFacePoints);
    }
    combineFaces(fit, [&](const LocalFit& candidate) {
        return taubinError(candidate, points, points.radius);
    });
    return fit;
}

} // namespace mpuvdb
