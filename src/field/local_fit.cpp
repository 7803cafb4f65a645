#include "local_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Four points at a time; written so that every instruction set gives the same bits.
using Group = double __attribute__((vector_size(32)));

Group load(const std::vector<double>& a, std::size_t i)
{
    return Group{a[i], a[i + 1], a[i + 2], a[i + 3]};
}

double sum(const Group& g)
{
    return (g[0] + g[1]) + (g[2] + g[3]);
}

// Without contraction to FMA every clone computes the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__SANITIZE_THREAD__) &&                   \
    !defined(__SANITIZE_ADDRESS__)
#define MPUVDB_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define MPUVDB_CLONES
#endif

/// Solve the normal equations M x = r, M symmetric semi-definite of O(1) entries, with the ridge
/// @a ridge. Refined against M itself: directions that the points determine lose the ridge's bias
/// (factor ridge / eigenvalue per step), others stay damped.
template <int N>
Eigen::Matrix<double, N, 1> solveRidged(const Eigen::Matrix<double, N, N>& M,
                                        const Eigen::Matrix<double, N, 1>& r,
                                        const Eigen::Matrix<double, N, 1>& ridge)
{
    Eigen::Matrix<double, N, N> damped = M;
    damped.diagonal() += ridge;
    const Eigen::LLT<Eigen::Matrix<double, N, N>> factor(damped);
    Eigen::Matrix<double, N, 1> x = factor.solve(r);
    for (int step = 0; step < 2; ++step) x += factor.solve(r - M * x);
    return x.allFinite() ? x : Eigen::Matrix<double, N, 1>::Zero();
}

struct Frame {
    Vec3d u, v, w;
    explicit Frame(const Vec3d& normal) : w(normal)
    {
        u = w.unitOrthogonal();
        v = w.cross(u);
    }
};

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

/// Moments of points (u, v, w), scaled to unit variance in (u, v), for w ~ quadratic(u, v).
struct BivariateSystem {
    Eigen::Matrix<double, 6, 6> M; ///< basis u^2, uv, v^2, u, v, 1
    Eigen::Matrix<double, 6, 1> r;
    double scale = 0; ///< 1 / length; 0: the points have no extent
};

MPUVDB_CLONES
BivariateSystem bivariateSystem(const CellPoints& points, const Frame& frame, const Vec3d& origin,
                                double totalWeight)
{
    BivariateSystem system;
    Group variance{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group dx = load(points.x, i) - origin[0], dy = load(points.y, i) - origin[1],
                    dz = load(points.z, i) - origin[2];
        const Group u = dx * frame.u[0] + dy * frame.u[1] + dz * frame.u[2];
        const Group v = dx * frame.v[0] + dy * frame.v[1] + dz * frame.v[2];
        variance += load(points.weight, i) * (u * u + v * v);
    }
    const double mean = sum(variance) / totalWeight;
    if (!(mean > 1e-24 * points.radius * points.radius)) return system;
    const double t = system.scale = 1 / std::sqrt(mean);

    Group m[5][5] = {}, s[6] = {}; // m[a][b] = sum weight u^a v^b
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group dx = t * (load(points.x, i) - origin[0]),
                    dy = t * (load(points.y, i) - origin[1]),
                    dz = t * (load(points.z, i) - origin[2]);
        const Group u = dx * frame.u[0] + dy * frame.u[1] + dz * frame.u[2];
        const Group v = dx * frame.v[0] + dy * frame.v[1] + dz * frame.v[2];
        const Group w = dx * frame.w[0] + dy * frame.w[1] + dz * frame.w[2];
        Group ua = load(points.weight, i);
        const Group powers[5] = {ua * 0 + 1, v, v * v, v * v * v, v * v * v * v};
        s[0] += ua * u * u * w;
        s[1] += ua * u * v * w;
        s[2] += ua * v * v * w;
        s[3] += ua * u * w;
        s[4] += ua * v * w;
        s[5] += ua * w;
        for (int a = 0; a < 5; ++a, ua *= u)
            for (int b = 0; a + b < 5; ++b) m[a][b] += ua * powers[b];
    }
    constexpr int ea[6] = {2, 1, 0, 1, 0, 0}, eb[6] = {0, 1, 2, 0, 1, 0};
    for (int i = 0; i < 6; ++i) {
        system.r[i] = sum(s[i]) / totalWeight;
        for (int j = 0; j < 6; ++j)
            system.M(i, j) = sum(m[ea[i] + ea[j]][eb[i] + eb[j]]) / totalWeight;
    }
    return system;
}

constexpr double kSpreadCosine = 0.974; // half the angle of test (14), about the mean normal

/// The cell's corners and centre, where their nearest points agree on a side [Ohtake03 eq. 9, 10].
void auxiliaryPoints(const CellPoints& points, double cellSize, std::vector<Vec3d>& q,
                     std::vector<double>& d)
{
    constexpr std::size_t kNearest = 6;
    std::vector<std::pair<double, std::uint32_t>> order(points.count);
    for (int corner = 0; corner < 9; ++corner) {
        const Vec3d at =
            corner == 8
                ? Vec3d(0, 0, 0)
                : Vec3d(Vec3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1) *
                        (cellSize / 2));
        for (std::size_t i = 0; i < points.count; ++i)
            order[i] = {(points.position(i) - at).squaredNorm(), std::uint32_t(i)};
        const std::size_t near = std::min(kNearest, order.size());
        std::partial_sort(order.begin(), order.begin() + std::ptrdiff_t(near), order.end());
        double total = 0, mean = 0;
        int positive = 0;
        for (std::size_t k = 0; k < near; ++k) {
            const std::uint32_t i = order[k].second;
            const double side = points.normal(i).dot(at - points.position(i));
            positive += side > 0;
            mean += points.confidence[i] * side;
            total += points.confidence[i];
        }
        if ((positive != 0 && positive != int(near)) || !(total > 0)) continue;
        q.push_back(at);
        d.push_back(mean / total);
    }
}

/// Square of a gradient below which a fit counts as flat, its error as huge.
constexpr double kFlat = 1e-200;

/// Largest (confidence Q)^2 / |grad Q|^2 within the radius.
MPUVDB_CLONES
double worstSquared(const Quadric& q, const CellPoints& points, double testRadius)
{
    const auto& A = q.A;
    const double radius2 = testRadius * testRadius;
    Group worst{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
        const Group ax = A(0, 0) * x + A(0, 1) * y + A(0, 2) * z,
                    ay = A(1, 0) * x + A(1, 1) * y + A(1, 2) * z,
                    az = A(2, 0) * x + A(2, 1) * y + A(2, 2) * z;
        const Group value = load(points.confidence, i) *
                            (x * (ax + q.b[0]) + y * (ay + q.b[1]) + z * (az + q.b[2]) + q.c);
        const Group gx = 2 * ax + q.b[0], gy = 2 * ay + q.b[1], gz = 2 * az + q.b[2];
        const Group slope2 = gx * gx + gy * gy + gz * gz;
        const Group flat = Group{} + kFlat;
        const Group error2 = value * value / (slope2 > flat ? slope2 : flat);
        const Group within = x * x + y * y + z * z < radius2 ? error2 : Group{};
        worst = within > worst ? within : worst;
    }
    return std::max(std::max(worst[0], worst[1]), std::max(worst[2], worst[3]));
}

} // namespace

MPUVDB_CLONES
double nearestSquared(const CellPoints& points, const Vec3d& y, double enough)
{
    Group nearest = Group{} + std::numeric_limits<double>::infinity();
    constexpr std::size_t kRun = 4 * CellPoints::kGroup; // between looks at what was found
    const std::size_t whole = points.count / CellPoints::kGroup * CellPoints::kGroup;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t run = 0; run < whole; run += kRun) {
        for (std::size_t i = run; i < std::min(run + kRun, whole); i += CellPoints::kGroup) {
            const Group dx = load(points.x, i) - y[0], dy = load(points.y, i) - y[1],
                        dz = load(points.z, i) - y[2];
            const Group d2 = dx * dx + dy * dy + dz * dz;
            nearest = d2 < nearest ? d2 : nearest;
        }
        least = std::min(std::min(nearest[0], nearest[1]), std::min(nearest[2], nearest[3]));
        if (least <= enough) return least;
    }
    for (std::size_t i = whole; i < points.count; ++i)
        least = std::min(least, (points.position(i) - y).squaredNorm());
    return least;
}

void CellPoints::resize(std::size_t n)
{
    for (auto* a : {&x, &y, &z, &nx, &ny, &nz, &weight, &confidence}) a->assign(n, 0.0);
}

void CellPoints::assign(const PointBatch& batch, const Vec3d& centre, double ballRadius)
{
    count = batch.size();
    radius = ballRadius;
    resize((count + kGroup - 1) / kGroup * kGroup);
    const double scale = 1.5 / ballRadius;
    for (std::size_t i = 0; i < count; ++i) {
        x[i] = batch.x[i] - centre[0];
        y[i] = batch.y[i] - centre[1];
        z[i] = batch.z[i] - centre[2];
        nx[i] = batch.nx[i];
        ny[i] = batch.ny[i];
        nz[i] = batch.nz[i];
        confidence[i] = batch.confidence[i];
    }
    for (std::size_t i = 0; i < count; ++i) {
        const double t = std::sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]) * scale;
        weight[i] = confidence[i] * bsplineWeight(t);
    }
}

void CellPoints::assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members)
{
    count = members.size();
    radius = other.radius;
    resize((count + kGroup - 1) / kGroup * kGroup);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t m = members[i];
        x[i] = other.x[m];
        y[i] = other.y[m];
        z[i] = other.z[m];
        nx[i] = other.nx[m];
        ny[i] = other.ny[m];
        nz[i] = other.nz[m];
        confidence[i] = other.confidence[m];
        weight[i] = other.weight[m];
    }
}

Vec3d meanNormal(const CellPoints& points)
{
    Group sx{}, sy{}, sz{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group w = load(points.weight, i);
        sx += w * load(points.nx, i);
        sy += w * load(points.ny, i);
        sz += w * load(points.nz, i);
    }
    const Vec3d total(sum(sx), sum(sy), sum(sz));
    const double length = total.norm();
    return length > 0 ? Vec3d(total / length) : Vec3d(0, 0, 1);
}

Quadric fitBivariate(const CellPoints& points, const Vec3d& normal, std::size_t minQuadratic)
{
    double totalWeight = 0;
    const Vec3d origin = weightedCentroid(points, totalWeight);
    if (points.count < minQuadratic || !(totalWeight > 0)) return planeThrough(origin, normal);
    const Frame frame(normal);
    const BivariateSystem system = bivariateSystem(points, frame, origin, totalWeight);
    if (!(system.scale > 0)) return planeThrough(origin, normal);
    Eigen::Matrix<double, 6, 1> ridge;
    ridge << 1e-5, 1e-5, 1e-5, 1e-6, 1e-6, 1e-14;
    const Eigen::Matrix<double, 6, 1> k = solveRidged<6>(system.M, system.r, ridge);

    // Q = w - quadratic(u, v), back in world units about the centroid, then about the centre.
    const double t = system.scale;
    Quadric q;
    q.A = -t * (k[0] * frame.u * frame.u.transpose() + k[2] * frame.v * frame.v.transpose() +
                0.5 * k[1] * (frame.u * frame.v.transpose() + frame.v * frame.u.transpose()));
    q.b = frame.w - k[3] * frame.u - k[4] * frame.v;
    q.c = -k[5] / t;
    return q.shifted(-origin);
}

Quadric fitGeneral(const CellPoints& points, const std::vector<Vec3d>& auxPoints,
                   const std::vector<double>& auxValues)
{
    using Vector = Eigen::Matrix<double, 10, 1>;
    using Matrix = Eigen::Matrix<double, 10, 10>;
    const double scale = 1 / points.radius; // unit ball, so that all columns are O(1)
    const auto basis = [&](const Vec3d& p) {
        const Vec3d y = p * scale;
        Vector phi;
        phi << y[0] * y[0], y[1] * y[1], y[2] * y[2], y[0] * y[1], y[1] * y[2], y[2] * y[0], y[0],
            y[1], y[2], 1;
        return phi;
    };
    Matrix M = Matrix::Zero();
    double totalWeight = 0;
    for (std::size_t i = 0; i < points.count; ++i) {
        const Vector phi = basis(points.position(i));
        M.selfadjointView<Eigen::Lower>().rankUpdate(phi, points.weight[i]);
        totalWeight += points.weight[i];
    }
    if (totalWeight > 0) M /= totalWeight;
    Vector r = Vector::Zero();
    const double share = 1.0 / double(auxPoints.size());
    for (std::size_t j = 0; j < auxPoints.size(); ++j) {
        const Vector phi = basis(auxPoints[j]);
        M.selfadjointView<Eigen::Lower>().rankUpdate(phi, share);
        r += share * scale * auxValues[j] * phi;
    }
    M = Matrix(M.selfadjointView<Eigen::Lower>());
    const Vector k = solveRidged<10>(M, r, Vector::Constant(1e-7));

    Quadric q; // the unit ball's Q, times its radius
    q.A << k[0], k[3] / 2, k[5] / 2, k[3] / 2, k[1], k[4] / 2, k[5] / 2, k[4] / 2, k[2];
    q.A *= scale;
    q.b = k.segment<3>(6);
    q.c = k[9] / scale;
    return q;
}

double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    if (!fit.isSharp()) return std::sqrt(worstSquared(fit.pieces[0], points, testRadius));
    const double radius2 = testRadius * testRadius;
    double worst2 = 0;
    for (std::size_t i = 0; i < points.count; ++i) {
        const Vec3d y = points.position(i);
        if (!(y.squaredNorm() < radius2)) continue;
        const Quadric& q = fit.ruling(y);
        const double value = points.confidence[i] * q.value(y);
        worst2 = std::max(worst2, value * value / std::max(q.gradient(y).squaredNorm(), kFlat));
    }
    return std::sqrt(worst2);
}

double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& centre, double radius,
                  double enough)
{
    static const std::array<Vec3d, 15> probes = [] {
        std::array<Vec3d, 15> p;
        p[0] = Vec3d::Zero();
        for (int k = 0; k < 3; ++k) {
            p[std::size_t(1 + 2 * k)] = 0.6 * Vec3d::Unit(k);
            p[std::size_t(2 + 2 * k)] = -0.6 * Vec3d::Unit(k);
        }
        for (int k = 0; k < 8; ++k)
            p[std::size_t(7 + k)] = 0.45 * Vec3d(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1);
        return p;
    }();
    double gap2 = 0;
    for (const Vec3d& probe : probes) {
        Vec3d y = centre + probe * radius;
        for (int step = 0; step < 2; ++step) {
            const Quadric& q = fit.ruling(y);
            const Vec3d g = q.gradient(y);
            y -= g * (q.value(y) / std::max(g.squaredNorm(), 1e-6));
        }
        if ((y - centre).norm() < 0.85 * radius)
            gap2 = std::max(gap2, nearestSquared(points, y, enough * enough));
    }
    return std::sqrt(gap2);
}

namespace
{

/// (a) with the paper's auxiliary points; false if none is usable.
bool fitGeneralAbout(const CellPoints& points, double cellSize, Quadric& q)
{
    std::vector<Vec3d> auxPoints;
    std::vector<double> auxValues;
    auxiliaryPoints(points, cellSize, auxPoints, auxValues);
    if (auxPoints.empty()) return false;
    q = fitGeneral(points, auxPoints, auxValues);
    return true;
}

/// Replace @a result by a feature's fit if that is nearer to the points.
void trySharp(FitResult& result, const CellPoints& points, double cellSize, double testRadius,
              CellPoints& scratch)
{
    const std::optional<LocalFit> sharp = fitSharp(points, scratch);
    if (!sharp) return;
    const auto offer = [&](const LocalFit& fit) {
        const double error = taubinError(fit, points, testRadius);
        if (!(error < result.error)) return;
        result.fit = fit;
        result.error = error;
    };
    offer(*sharp);
    LocalFit general; // for four faces that are neither convex nor concave
    if (sharp->count == 4 && fitGeneralAbout(points, cellSize, general.pieces[0])) offer(general);
}

} // namespace

FitResult fitCell(const CellPoints& points, double cellSize, double testRadius,
                  const FitSettings& settings, CellPoints& scratch)
{
    FitResult result;
    const Vec3d normal = meanNormal(points);
    double lowest = 1;
    for (std::size_t i = 0; i < points.count; ++i)
        lowest = std::min(lowest, points.normal(i).dot(normal));
    result.opposedNormals = lowest <= 0;
    result.spreadNormals = lowest < kSpreadCosine;

    if (result.opposedNormals && points.count > 2 * std::size_t(settings.minPoints)) {
        result.needsSplit = !fitGeneralAbout(points, cellSize, result.fit.pieces[0]);
        if (result.needsSplit)
            result.fit.pieces[0] = fitBivariate(points, normal, points.count + 1);
    } else {
        result.fit.pieces[0] = fitBivariate(points, normal);
    }
    result.error = taubinError(result.fit, points, testRadius);
    // A smooth fillet can look like an edge to test (14): a feature only where smooth fails.
    if (points.count <= settings.maxSharpPoints && result.error > settings.tolerance)
        trySharp(result, points, cellSize, testRadius, scratch);
    return result;
}

} // namespace mpuvdb
