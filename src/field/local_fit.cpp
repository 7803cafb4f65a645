#include "local_fit.h"

#include <mpuvdb/clones.h>

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

/// Factors M = L D L^T of a small symmetric positive definite matrix: Eigen's own loops are not
/// unrolled at these sizes and take three times as long.
template <int N>
class SmallCholesky
{
public:
    explicit SmallCholesky(const Eigen::Matrix<double, N, N>& M)
    {
        double scaled[N][N]; // L D
        for (int j = 0; j < N; ++j) {
            double pivot = M(j, j);
            for (int k = 0; k < j; ++k) pivot -= mLower[j][k] * scaled[j][k];
            mInverse[j] = 1 / pivot;
            for (int i = j + 1; i < N; ++i) {
                double entry = M(i, j);
                for (int k = 0; k < j; ++k) entry -= mLower[i][k] * scaled[j][k];
                scaled[i][j] = entry;
                mLower[i][j] = entry * mInverse[j];
            }
        }
    }
    Eigen::Matrix<double, N, 1> solve(const Eigen::Matrix<double, N, 1>& r) const
    {
        Eigen::Matrix<double, N, 1> x = r;
        for (int i = 1; i < N; ++i)
            for (int k = 0; k < i; ++k) x[i] -= mLower[i][k] * x[k];
        for (int i = 0; i < N; ++i) x[i] *= mInverse[i];
        for (int i = N - 2; i >= 0; --i)
            for (int k = i + 1; k < N; ++k) x[i] -= mLower[k][i] * x[k];
        return x;
    }

private:
    double mLower[N][N], mInverse[N];
};

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
    const SmallCholesky<N> factor(damped);
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

/// Q = w - quadratic(u, v) without its constant, from the solution @a k of a system, in world
/// units.
Quadric heightAbove(const Frame& frame, const Eigen::Matrix<double, 5, 1>& k, double scale)
{
    Quadric q;
    q.A = -scale * (k[0] * frame.u * frame.u.transpose() + k[2] * frame.v * frame.v.transpose() +
                    0.5 * k[1] * (frame.u * frame.v.transpose() + frame.v * frame.u.transpose()));
    q.b = frame.w - k[3] * frame.u - k[4] * frame.v;
    return q;
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

/// A fit at four points.
struct Samples {
    Group value, gx, gy, gz;
};

[[gnu::always_inline]] inline Samples sampleQuadric(const Quadric& q, const Group& x,
                                                    const Group& y, const Group& z)
{
    const auto& A = q.A;
    const Group ax = A(0, 0) * x + A(0, 1) * y + A(0, 2) * z,
                ay = A(1, 0) * x + A(1, 1) * y + A(1, 2) * z,
                az = A(2, 0) * x + A(2, 1) * y + A(2, 2) * z;
    return {x * (ax + q.b[0]) + y * (ay + q.b[1]) + z * (az + q.b[2]) + q.c, 2 * ax + q.b[0],
            2 * ay + q.b[1], 2 * az + q.b[2]};
}

/// As LocalFit::ruling chooses.
[[gnu::always_inline]] inline Samples sampleFit(const LocalFit& fit, const Group& x, const Group& y,
                                                const Group& z)
{
    Samples s = sampleQuadric(fit.pieces[std::size_t(fit.count - 1)], x, y, z);
    for (int k = fit.count - 2; k >= 0; --k) {
        const Samples other = sampleQuadric(fit.pieces[std::size_t(k)], x, y, z);
        const double sign = fit.isMax(k) ? 1 : -1;
        const auto take = sign * other.value > sign * s.value;
        s.value = take ? other.value : s.value;
        s.gx = take ? other.gx : s.gx;
        s.gy = take ? other.gy : s.gy;
        s.gz = take ? other.gz : s.gz;
    }
    return s;
}

/// Largest (confidence Q)^2 / |grad Q|^2 within the radius.
MPUVDB_CLONES
double worstSquared(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    const double radius2 = testRadius * testRadius;
    Group worst{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
        const Samples s = sampleFit(fit, x, y, z);
        const Group value = load(points.confidence, i) * s.value;
        const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz;
        const Group flat = Group{} + kFlat;
        const Group error2 = value * value / (slope2 > flat ? slope2 : flat);
        const Group within = x * x + y * y + z * z < radius2 ? error2 : Group{};
        worst = within > worst ? within : worst;
    }
    return std::max(std::max(worst[0], worst[1]), std::max(worst[2], worst[3]));
}

/// Square of the distance from @a y to the nearest point, or to some point within sqrt(@a enough),
/// looked for from @a start on, around to it; then @a start is where to look for one near y.
MPUVDB_CLONES
double nearestFrom(const CellPoints& points, const Vec3d& y, double enough, std::size_t& start)
{
    constexpr std::size_t kRun = 4 * CellPoints::kGroup; // between looks at what was found
    const std::size_t end = points.paddedCount();
    double least = std::numeric_limits<double>::infinity();
    std::size_t run = start < end ? start : 0;
    for (std::size_t seen = 0; seen < end; seen += kRun, run = run + kRun < end ? run + kRun : 0) {
        Group nearest = Group{} + std::numeric_limits<double>::infinity();
        for (std::size_t i = run; i < std::min(run + kRun, end); i += CellPoints::kGroup) {
            const Group dx = load(points.x, i) - y[0], dy = load(points.y, i) - y[1],
                        dz = load(points.z, i) - y[2];
            const Group d2 = dx * dx + dy * dy + dz * dz;
            nearest = d2 < nearest ? d2 : nearest;
        }
        const double found =
            std::min(std::min(nearest[0], nearest[1]), std::min(nearest[2], nearest[3]));
        if (found < least) {
            least = found;
            start = run;
            if (least <= enough) return least;
        }
    }
    return least;
}

/// Where Newton steps from 15 points of the unit ball, and the middle once more, lead.
struct Probes {
    static constexpr std::size_t kCount = 16;
    double x[kCount], y[kCount], z[kCount];

    Probes()
    {
        const auto set = [this](std::size_t n, double px, double py, double pz) {
            x[n] = px, y[n] = py, z[n] = pz;
        };
        set(0, 0, 0, 0), set(15, 0, 0, 0);
        for (int k = 0; k < 6; ++k) {
            const double far = k & 1 ? -0.6 : 0.6;
            set(std::size_t(k) + 1, k / 2 == 0 ? far : 0, k / 2 == 1 ? far : 0,
                k / 2 == 2 ? far : 0);
        }
        for (int k = 0; k < 8; ++k)
            set(std::size_t(k) + 7, k & 1 ? 0.45 : -0.45, k & 2 ? 0.45 : -0.45,
                k & 4 ? 0.45 : -0.45);
    }
};

/// Take all probes from @a unit in the ball of @a radius about @a centre two steps towards the zero
/// set; bit n of the result: probe n is within 0.85 radius.
MPUVDB_CLONES
unsigned stepOntoZeroSet(const LocalFit& fit, const Vec3d& centre, double radius,
                         const Probes& unit, Probes& probes)
{
    unsigned landed = 0;
    const double reach2 = 0.85 * 0.85 * radius * radius;
    for (std::size_t n = 0; n < Probes::kCount; n += CellPoints::kGroup) {
        const auto at = [n](const double* a) { return Group{a[n], a[n + 1], a[n + 2], a[n + 3]}; };
        Group x = centre[0] + radius * at(unit.x), y = centre[1] + radius * at(unit.y),
              z = centre[2] + radius * at(unit.z);
        for (int step = 0; step < 2; ++step) {
            const Samples s = sampleFit(fit, x, y, z);
            const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz;
            const Group least = Group{} + 1e-6;
            const Group length = s.value / (slope2 > least ? slope2 : least);
            x -= s.gx * length;
            y -= s.gy * length;
            z -= s.gz * length;
        }
        const Group dx = x - centre[0], dy = y - centre[1], dz = z - centre[2];
        const Group d2 = dx * dx + dy * dy + dz * dz;
        for (std::size_t k = 0; k < CellPoints::kGroup; ++k) {
            probes.x[n + k] = x[k], probes.y[n + k] = y[k], probes.z[n + k] = z[k];
            landed |= unsigned(d2[k] < reach2) << (n + k);
        }
    }
    return landed;
}

} // namespace

double nearestSquared(const CellPoints& points, const Vec3d& y, double enough)
{
    std::size_t start = 0;
    return nearestFrom(points, y, enough, start);
}

void CellPoints::setCount(std::size_t n)
{
    count = n;
    const std::size_t padded = (n + kGroup - 1) / kGroup * kGroup;
    for (auto* a : {&x, &y, &z, &nx, &ny, &nz, &weight, &confidence}) a->resize(padded);
}

// No nearer to anything than the points.
void CellPoints::pad()
{
    for (std::size_t i = count; i < x.size(); ++i) {
        for (auto* a : {&x, &y, &z, &nx, &ny, &nz}) (*a)[i] = (*a)[count - 1];
        weight[i] = confidence[i] = 0;
    }
}

MPUVDB_CLONES
void CellPoints::assign(const PointBatch& batch, const Vec3d& centre, double ballRadius)
{
    setCount(batch.size());
    radius = ballRadius;
    const auto copy = [n = count](const std::vector<float>& from, std::vector<double>& to,
                                  double origin) {
        for (std::size_t i = 0; i < n; ++i) to[i] = double(from[i]) - origin;
    };
    copy(batch.x, x, centre[0]);
    copy(batch.y, y, centre[1]);
    copy(batch.z, z, centre[2]);
    copy(batch.nx, nx, 0);
    copy(batch.ny, ny, 0);
    copy(batch.nz, nz, 0);
    copy(batch.confidence, confidence, 0);
    pad();
    const double scale = 1.5 / ballRadius;
    for (std::size_t i = 0; i < x.size(); i += kGroup) {
        const Group gx = load(x, i), gy = load(y, i), gz = load(z, i);
        const Group d2 = gx * gx + gy * gy + gz * gz;
        for (std::size_t k = 0; k < kGroup; ++k)
            weight[i + k] = confidence[i + k] * bsplineWeight(std::sqrt(d2[k]) * scale);
    }
}

void CellPoints::assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members)
{
    setCount(members.size());
    radius = other.radius;
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
    pad();
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
    Quadric q = heightAbove(frame, k.head<5>(), system.scale);
    q.c = -k[5] / system.scale;
    return q.shifted(-origin); // from the centroid to the centre
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
    return std::sqrt(worstSquared(fit, points, testRadius));
}

bool residualsAreNoise(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise)
{
    constexpr std::size_t kParts = 16; // octants, each inside and outside of half the ball's disc
    constexpr double kLoud = 2, kSignificant = 2.5;
    std::array<double, kParts> sums{};
    std::array<std::size_t, kParts> counts{};
    const double radius2 = testRadius * testRadius;
    double squares = 0;
    std::size_t n = 0;
    for (std::size_t i = 0; i < points.count; ++i) {
        const Vec3d y = points.position(i);
        const double r2 = y.squaredNorm();
        if (!(r2 < radius2)) continue;
        const Quadric& q = fit.ruling(y);
        const double residual = points.confidence[i] * q.value(y) /
                                std::sqrt(std::max(q.gradient(y).squaredNorm(), kFlat));
        const auto part = std::size_t(y[0] > 0) | std::size_t(y[1] > 0) << 1 |
                          std::size_t(y[2] > 0) << 2 | std::size_t(2 * r2 > radius2) << 3;
        sums[part] += residual;
        ++counts[part];
        squares += residual * residual;
        ++n;
    }
    double between = 0;
    std::size_t parts = 0;
    for (std::size_t k = 0; k < kParts; ++k) {
        if (counts[k] == 0) continue;
        between += sums[k] * sums[k] / double(counts[k]);
        ++parts;
    }
    const double least = noise * noise, most = kLoud * kLoud * least;
    const double within = n > parts ? (squares - between) / double(n - parts) : squares;
    if (!(within <= most)) return false;
    const double expected = double(parts) + kSignificant * std::sqrt(2 * double(parts));
    return between <= std::max(within, least) * expected;
}

double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& centre, double radius,
                  double enough)
{
    static const Probes unit;
    Probes probes;
    const unsigned landed = stepOntoZeroSet(fit, centre, radius, unit, probes);
    double gap2 = 0;
    std::size_t start = 0;
    for (std::size_t n = 0; n + 1 < Probes::kCount; ++n) { // the last is the first again
        if (!(landed >> n & 1u)) continue;
        const Vec3d y(probes.x[n], probes.y[n], probes.z[n]);
        gap2 = std::max(gap2, nearestFrom(points, y, enough * enough, start));
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

namespace
{

bool isAccepted(const FitResult& result, const CellPoints& points, double testRadius,
                const FitSettings& settings)
{
    constexpr std::size_t kFew = 120; // no more points tell no shape from noise
    constexpr double kFarthest = 8;   // of few points, in standard deviations
    if (result.error <= settings.tolerance) return true;
    if (!(settings.noise > 0)) return false;
    if (points.count <= kFew) return result.error <= kFarthest * settings.noise;
    return residualsAreNoise(result.fit, points, testRadius, settings.noise);
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
    result.accepted = isAccepted(result, points, testRadius, settings);
    // A smooth fillet can look like an edge to test (14): a feature only where smooth fails.
    if (points.count <= settings.maxSharpPoints && !result.accepted) {
        trySharp(result, points, cellSize, testRadius, scratch);
        result.accepted = isAccepted(result, points, testRadius, settings);
    }
    return result;
}

} // namespace mpuvdb
