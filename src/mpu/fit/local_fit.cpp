#include "local_fit.h"

#include "bivariate_system.h"
#include "core/clones.h"
#include "fit_quality.h"
#include "ridged_solver.h"
#include "spatial/point_group.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

namespace mpuvdb
{
namespace
{

Vec3d weightedCentroid(const CellPoints& points, double& totalWeight)
{
    Group sw{}, sx{}, sy{}, sz{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group w = load(points.weight, i);
        sw += w;
        sx += w * load(points.x, i);
        sy += w * load(points.y, i);
        sz += w * load(points.z, i);
    }
    totalWeight = sum(sw);
    if (!(totalWeight > 0)) return points.count ? points.position(0) : Vec3d::Zero();
    return Vec3d(sum(sx), sum(sy), sum(sz)) / totalWeight;
}

Quadric planeThrough(const Vec3d& point, const Vec3d& normal)
{
    return {Eigen::Matrix3d::Zero(), normal, -normal.dot(point)};
}

/// Least points of a bivariate quadratic. [derived: its coefficients]
constexpr std::size_t kMinQuadraticPoints = 6;
/// Cosine to the mean normal below which a feature is possible. [derived: half the angle of eq. 14]
constexpr double kSpreadCosine = 0.974;
/// Nearest points at an auxiliary point. [paper: Ohtake03 §4a]
constexpr std::size_t kAuxNeighbors = 6;

MPUVDB_WIDE_CLONES
void squaredDistances(const CellPoints& points, const Vec3d& at, std::vector<double>& out)
{
    out.resize(points.paddedCount());
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group dx = load(points.x, i) - at[0], dy = load(points.y, i) - at[1],
                    dz = load(points.z, i) - at[2];
        const Group d2 = dx * dx + dy * dy + dz * dz;
        std::memcpy(&out[i], &d2, sizeof d2);
    }
}

/// Find the indices of the least @a found.size() of the first @a n values, in order. @return their
/// number.
std::size_t leastOf(const std::vector<double>& values, std::size_t n,
                    std::array<std::uint32_t, kAuxNeighbors>& found)
{
    std::array<double, kAuxNeighbors + 1> least;
    least.fill(std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < n; ++i) {
        if (!(values[i] < least[kAuxNeighbors - 1])) continue;
        std::size_t k = kAuxNeighbors - 1;
        for (; k > 0 && values[i] < least[k - 1]; --k) {
            least[k] = least[k - 1];
            found[k] = found[k - 1];
        }
        least[k] = values[i];
        found[k] = std::uint32_t(i);
    }
    return std::min(n, kAuxNeighbors);
}

/// The cell's corners and center, where their nearest points agree on a side [Ohtake03 eq. 9, 10].
void auxiliaryPoints(const CellPoints& points, double cellSize, std::vector<Vec3d>& q,
                     std::vector<double>& d)
{
    std::vector<double> distance2;
    std::array<std::uint32_t, kAuxNeighbors> nearest;
    for (int corner = 0; corner < 9; ++corner) {
        const Vec3d at =
            corner == 8
                ? Vec3d(0, 0, 0)
                : Vec3d(Vec3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1) *
                        (cellSize / 2));
        squaredDistances(points, at, distance2);
        const std::size_t near = leastOf(distance2, points.count, nearest);
        double total = 0, mean = 0;
        std::size_t positive = 0;
        for (std::size_t k = 0; k < near; ++k) {
            const std::uint32_t i = nearest[k];
            const double side = points.normal(i).dot(at - points.position(i));
            positive += side > 0;
            mean += points.confidence[i] * side;
            total += points.confidence[i];
        }
        if ((positive != 0 && positive != near) || !(total > 0)) continue;
        q.push_back(at);
        d.push_back(mean / total);
    }
}

} // namespace

namespace
{

/// solveRidged() for several instruction sets.
MPUVDB_WIDE_CLONES
Eigen::Matrix<double, 6, 1> solveBivariate(const BivariateSystem& system)
{
    Eigen::Matrix<double, 6, 1> ridge;
    ridge << 1e-5, 1e-5, 1e-5, 1e-6, 1e-6, 1e-14;
    return solveRidged<6>(system.M, system.r, ridge);
}

} // namespace

Quadric fitBivariate(const CellPoints& points, const Vec3d& normal, std::size_t minQuadratic,
                     double lever)
{
    double totalWeight = 0;
    const Vec3d origin = weightedCentroid(points, totalWeight);
    if (points.count < minQuadratic || !(totalWeight > 0)) return planeThrough(origin, normal);
    const Frame frame(normal);
    BivariateSystem system = bivariateSystem(points, frame, origin, totalWeight);
    if (!(system.scale > 0)) return planeThrough(origin, normal);
    if (lever > 0) addSlopes(points, frame, origin, totalWeight, lever, system);
    const Eigen::Matrix<double, 6, 1> k = solveBivariate(system);
    Quadric q = heightAbove(frame, k.head<5>(), system.scale);
    q.c = -k[5] / system.scale;
    return q.shifted(-origin); // from the centroid to the center
}

Quadric fitBivariateThroughOrigin(const CellPoints& points, const Vec3d& normal)
{
    const Frame frame(normal);
    double total = 0;
    for (const double w : points.weight) total += w;
    if (!(total > 0)) return planeThrough(Vec3d::Zero(), normal);
    const BivariateSystem system = bivariateSystem(points, frame, Vec3d::Zero(), total);
    if (!(system.scale > 0)) return planeThrough(Vec3d::Zero(), normal);
    Eigen::Matrix<double, 5, 1> ridge;
    ridge << 1e-5, 1e-5, 1e-5, 1e-6, 1e-6;
    return heightAbove(frame,
                       solveRidged<5>(system.M.topLeftCorner<5, 5>(), system.r.head<5>(), ridge),
                       system.scale);
}

namespace
{

constexpr std::size_t kTerms = 10; ///< coefficients [derived: x^2 y^2 z^2 xy yz zx x y z 1]

template <typename T>
std::array<T, kTerms> quadraticTerms(const T& x, const T& y, const T& z)
{
    return {x * x, y * y, z * z, x * y, y * z, z * x, x, y, z, x * 0 + 1};
}

/// Weighted mean over the points of the products of the terms, in radii.
MPUVDB_WIDE_CLONES
void meanProducts(const CellPoints& points, Eigen::Matrix<double, kTerms, kTerms>& M)
{
    Group sums[kTerms * (kTerms + 1) / 2] = {}, total{};
    const double scale = 1 / points.radius;
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group weight = load(points.weight, i);
        const std::array<Group, kTerms> phi = quadraticTerms<Group>(
            scale * load(points.x, i), scale * load(points.y, i), scale * load(points.z, i));
        std::size_t n = 0;
        for (std::size_t row = 0; row < kTerms; ++row) {
            const Group weighted = weight * phi[row];
            for (std::size_t column = 0; column <= row; ++column)
                sums[n++] += weighted * phi[column];
        }
        total += weight;
    }
    const double totalWeight = sum(total), share = totalWeight > 0 ? 1 / totalWeight : 1;
    std::size_t n = 0;
    for (std::size_t row = 0; row < kTerms; ++row)
        for (std::size_t column = 0; column <= row; ++column)
            M(row, column) = M(column, row) = share * sum(sums[n++]);
}

} // namespace

Quadric fitGeneral(const CellPoints& points, const std::vector<Vec3d>& auxPoints,
                   const std::vector<double>& auxValues)
{
    using Vector = Eigen::Matrix<double, kTerms, 1>;
    const double scale = 1 / points.radius; // unit ball, so that all columns are O(1)
    Eigen::Matrix<double, kTerms, kTerms> M;
    meanProducts(points, M);
    Vector r = Vector::Zero();
    const double share = 1.0 / double(auxPoints.size());
    for (std::size_t j = 0; j < auxPoints.size(); ++j) {
        const Vec3d y = auxPoints[j] * scale;
        const std::array<double, kTerms> terms = quadraticTerms(y[0], y[1], y[2]);
        const Vector phi = Eigen::Map<const Vector>(terms.data());
        M.noalias() += (share * phi) * phi.transpose();
        r += share * scale * auxValues[j] * phi;
    }
    const Vector k = solveRidged<kTerms>(M, r, Vector::Constant(1e-7));

    Quadric q; // the unit ball's Q, times its radius
    q.A << k[0], k[3] / 2, k[5] / 2, k[3] / 2, k[1], k[4] / 2, k[5] / 2, k[4] / 2, k[2];
    q.A *= scale;
    q.b = k.segment<3>(6);
    q.c = k[9] / scale;
    return q;
}

namespace
{

/// Fit (a) with the paper's auxiliary points; false if none is usable.
bool fitGeneralAbout(const CellPoints& points, double cellSize, Quadric& q)
{
    std::vector<Vec3d> auxPoints;
    std::vector<double> auxValues;
    auxiliaryPoints(points, cellSize, auxPoints, auxValues);
    if (auxPoints.empty()) return false;
    q = fitGeneral(points, auxPoints, auxValues);
    return true;
}

/// Replace @a result by the fit of a feature if its error is smaller, and much smaller if the
/// smooth fit is accepted: a fillet may pass test (14) for an edge.
void trySharp(FitResult& result, const CellPoints& points, double cellSize, double testRadius,
              CellPoints& scratch)
{
    /// Largest ratio of a sharp fit's error to that of an accepted one. [tuned: sharp_mesh_test]
    constexpr double kSharpErrorRatio = 0.3;
    const double most = (result.accepted ? kSharpErrorRatio : 1) * result.error;
    const std::optional<LocalFit> sharp = fitSharp(points, scratch);
    if (!sharp) return;
    const auto offer = [&](const LocalFit& fit) {
        const double error = sidedError(fit, points, testRadius);
        if (!(error < std::min(most, result.error))) return;
        result.fit = fit;
        result.error = error;
    };
    offer(*sharp);
    LocalFit general; // for four faces that are neither convex nor concave
    if (sharp->count == 4 && fitGeneralAbout(points, cellSize, general.pieces[0])) offer(general);
}

/// Least error of a fit for which a feature is tried, in tolerances: below, none is visible.
/// [tuned: edge_bench]
constexpr double kMinSharpError = 0.125;

/// Points that are too few to show a pattern among noise. [tuned: noise_bench]
constexpr std::size_t kFewPoints = 120;

bool isAccepted(const FitResult& result, const CellPoints& points, double testRadius,
                const FitSettings& settings)
{
    if (result.error <= settings.tolerance) return true;
    if (!(settings.noise > 0) || !std::isfinite(result.error)) return false;
    if (points.count <= kFewPoints) return result.error <= kMaxNoiseDistance * settings.noise;
    return residualsAreNoise(result.fit, points, testRadius, settings.noise);
}

} // namespace

namespace
{

/// Lowest cosine between @a normal and the points' normals; at most 1.
MPUVDB_WIDE_CLONES
double lowestCosine(const CellPoints& points, const Vec3d& normal)
{
    Group lowest = Group{} + 1;
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group cosine = load(points.nx, i) * normal[0] + load(points.ny, i) * normal[1] +
                             load(points.nz, i) * normal[2];
        lowest = cosine < lowest ? cosine : lowest;
    }
    return smallest(lowest);
}

/// Whether a normal turns by pi/2 or more from @a normal; with noise, more than a share of
/// outliers.
bool areOpposed(const CellPoints& points, const Vec3d& normal, double lowest, double noise)
{
    if (!(noise > 0) || lowest > 0) return lowest <= 0;
    std::size_t opposed = 0;
    for (std::size_t i = 0; i < points.count; ++i) opposed += points.normal(i).dot(normal) <= 0;
    return double(opposed) > kMaxAwayShare * double(points.count);
}

/// Weighted mean of 1 - cosine of the angles between the points' normals and those of @a q.
MPUVDB_WIDE_CLONES
double meanTurn(const Quadric& q, const CellPoints& points)
{
    const auto& A = q.A;
    Group turned{}, total{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = 2 * load(points.x, i), y = 2 * load(points.y, i), z = 2 * load(points.z, i);
        const Group gx = A(0, 0) * x + A(0, 1) * y + A(0, 2) * z + q.b[0],
                    gy = A(1, 0) * x + A(1, 1) * y + A(1, 2) * z + q.b[1],
                    gz = A(2, 0) * x + A(2, 1) * y + A(2, 2) * z + q.b[2];
        const Group slope = squareRoot(gx * gx + gy * gy + gz * gz + 1e-30);
        const Group along =
            load(points.nx, i) * gx + load(points.ny, i) * gy + load(points.nz, i) * gz;
        const Group weight = load(points.weight, i);
        turned += weight * (1 - along / slope);
        total += weight;
    }
    const double weight = sum(total);
    return weight > 0 ? sum(turned) / weight : 0;
}

/// Whether the points are exact, and their normals differ from a fit near them: they are of several
/// flat faces, which its zero set rounds.
bool normalsTurnAway(const Quadric& q, const CellPoints& points, const FitSettings& settings)
{
    /// Largest root mean square of the turns of exact normals, and so of their noise, radians.
    /// [tuned: local_fit_test, sharp_mesh_test]
    constexpr double kMaxExactTurn = 0.017;
    return settings.noise <= 0 && settings.normalNoise < kMaxExactTurn &&
           2 * meanTurn(q, points) > kMaxExactTurn * kMaxExactTurn;
}

} // namespace

FitResult fitCell(const CellPoints& points, double cellSize, double testRadius,
                  const FitSettings& settings, CellPoints& scratch)
{
    FitResult result;
    const Vec3d normal = meanNormal(points);
    const double lowest = lowestCosine(points, normal);
    result.opposedNormals = areOpposed(points, normal, lowest, settings.noise);
    result.spreadNormals = lowest < kSpreadCosine;

    const bool general =
        result.opposedNormals && points.count > 2 * std::size_t(settings.minPoints);
    if (general) {
        result.needsSplit = !fitGeneralAbout(points, cellSize, result.fit.pieces[0]);
        if (result.needsSplit)
            result.fit.pieces[0] = fitBivariate(points, normal, points.count + 1);
    } else {
        result.fit.pieces[0] = fitBivariate(points, normal, kMinQuadraticPoints, settings.lever);
    }
    result.error = general ? sidedError(result.fit, points, testRadius)
                           : heightError(result.fit.pieces[0], points, testRadius);
    result.accepted = isAccepted(result, points, testRadius, settings);
    const bool turnsAway =
        !general && result.accepted && normalsTurnAway(result.fit.pieces[0], points, settings);
    const bool isSmall = points.count <= settings.maxSharpPoints;
    result.turnsAway = turnsAway && !isSmall;
    const bool mayBeSharp =
        turnsAway || (result.spreadNormals && result.error > kMinSharpError * settings.tolerance);
    const bool isClear = result.error > kMaxNoiseDistance * settings.noise;
    if (isSmall && (!result.accepted || (mayBeSharp && isClear))) {
        trySharp(result, points, cellSize, testRadius, scratch);
        result.accepted = isAccepted(result, points, testRadius, settings);
    }
    return result;
}

} // namespace mpuvdb
