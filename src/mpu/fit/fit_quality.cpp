#include "fit_quality.h"

#include "core/clones.h"
#include "spatial/point_group.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Least squared gradient of a fit: a flat one has a huge error. [derived: no overflow in
/// quotients]
constexpr double kMinGradient2 = 1e-200;

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

/// The piece in effect, as by LocalFit::ruling().
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

/// The points that are farthest from a fit.
struct Farthest {
    double within2 = 0; ///< largest (confidence Q)^2 / |grad Q|^2 within the radius
    double away2 = 0;   ///< the same over all points that look away from the fit
    double away = 0;    ///< number of points that look away from it
};

MPUVDB_WIDE_CLONES
Farthest farthestPoints(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    const double radius2 = testRadius * testRadius;
    Group within{}, away{}, count{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
        const Samples s = sampleFit(fit, x, y, z);
        const Group confidence = load(points.confidence, i), value = confidence * s.value;
        const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz;
        const Group flat = Group{} + kMinGradient2;
        const Group error2 = value * value / (slope2 > flat ? slope2 : flat);
        const Group along =
            load(points.nx, i) * s.gx + load(points.ny, i) * s.gy + load(points.nz, i) * s.gz;
        const Group inside = x * x + y * y + z * z < radius2 ? error2 : Group{};
        within = inside > within ? inside : within;
        const auto looksAway = (along < 0) & (along * along > kAway * kAway * slope2);
        const Group beyond = looksAway ? error2 : Group{};
        away = beyond > away ? beyond : away;
        count += looksAway & (confidence > 0) ? Group{} + 1 : Group{};
    }
    return {largest(within), largest(away), sum(count)};
}

/// Square of the distance from @a y to the nearest point, or to some point within sqrt(@a enough).
/// The search begins at @a start, which is then set for places near y.
MPUVDB_WIDE_CLONES
double nearestFrom(const CellPoints& points, const Vec3d& y, double enough, std::size_t& start)
{
    /// Points between tests whether one is near enough. [tuned: suite, time]
    constexpr std::size_t kRun = 4 * CellPoints::kGroup;
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
        const double found = smallest(nearest);
        if (found < least) {
            least = found;
            start = run;
            if (least <= enough) return least;
        }
    }
    return least;
}

/// Probes: 15 points of the unit ball, and its center once more.
struct Probes {
    static constexpr std::size_t kCount = 16; ///< probes [derived: 15 filled up to groups]
    double x[kCount], y[kCount], z[kCount];

    Vec3d at(std::size_t n) const { return {x[n], y[n], z[n]}; }
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

/// Uncertainty of a foot outside of the ball, per distance from its center. [tuned: unseen_bench]
constexpr double kRelativeUncertainty = 0.25;

/// Weight of a foot's distance past the rim of the data beside its distance from them.
/// [tuned: unseen_bench]
constexpr double kOverhangWeight = 4;

/// Move all probes from @a unit in the ball of @a radius about @a center by two Newton steps
/// towards the zero set. @return bit n: probe n is within 0.85 radius.
MPUVDB_WIDE_CLONES
unsigned stepOntoZeroSet(const LocalFit& fit, const Vec3d& center, double radius,
                         const Probes& unit, Probes& probes)
{
    unsigned landed = 0;
    const double reach2 = 0.85 * 0.85 * radius * radius;
    for (std::size_t n = 0; n < Probes::kCount; n += CellPoints::kGroup) {
        const auto at = [n](const double* a) { return Group{a[n], a[n + 1], a[n + 2], a[n + 3]}; };
        Group x = center[0] + radius * at(unit.x), y = center[1] + radius * at(unit.y),
              z = center[2] + radius * at(unit.z);
        for (int step = 0; step < 2; ++step) {
            const Samples s = sampleFit(fit, x, y, z);
            const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz;
            const Group least = Group{} + 1e-6;
            const Group length = s.value / (slope2 > least ? slope2 : least);
            x -= s.gx * length;
            y -= s.gy * length;
            z -= s.gz * length;
        }
        const Group dx = x - center[0], dy = y - center[1], dz = z - center[2];
        const Group d2 = dx * dx + dy * dy + dz * dz;
        for (std::size_t k = 0; k < CellPoints::kGroup; ++k) {
            probes.x[n + k] = x[k], probes.y[n + k] = y[k], probes.z[n + k] = z[k];
            landed |= unsigned(d2[k] < reach2) << (n + k);
        }
    }
    return landed;
}

} // namespace

double taubinError(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    return std::sqrt(farthestPoints(fit, points, testRadius).within2);
}

double heightError(const Quadric& height, const CellPoints& points, double testRadius)
{
    LocalFit fit;
    fit.pieces[0] = height;
    const Farthest farthest = farthestPoints(fit, points, testRadius);
    return std::sqrt(std::max(farthest.within2, farthest.away2));
}

double sidedError(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    const Farthest farthest = farthestPoints(fit, points, testRadius);
    return farthest.away > kMaxAwayShare * double(points.count)
               ? std::numeric_limits<double>::infinity()
               : std::sqrt(farthest.within2);
}

namespace
{

/// Sums of residuals over the parts of a disc across the fit's normal: eight sectors, each inside
/// and outside of half its area. Parts along the normal would separate points by the sign of their
/// noise. Points weigh alike: by confidence, shapes seen only by points of low confidence would
/// pass for noise.
struct ResidualSums {
    static constexpr std::size_t kParts =
        16; ///< parts of a disc [derived: eight sectors, two rings]

    std::array<double, kParts> sums{};
    std::array<std::uint32_t, kParts> counts{};
    double squares = 0;
    std::size_t count = 0;
};

MPUVDB_WIDE_CLONES
void sumResiduals(const LocalFit& fit, const CellPoints& points, double testRadius,
                  ResidualSums& result)
{
    using Integers = std::int64_t __attribute__((vector_size(32)));
    const Vec3d slope0 = fit.ruling(Vec3d::Zero()).gradient(Vec3d::Zero());
    const Vec3d normal = slope0.norm() > 0 ? Vec3d(slope0.normalized()) : Vec3d::UnitZ();
    const Vec3d e1 = normal.unitOrthogonal(), e2 = normal.cross(e1);
    const double radius2 = testRadius * testRadius;
    Group squares{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
        const Samples s = sampleFit(fit, x, y, z);
        const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz;
        const Group flat = Group{} + kMinGradient2;
        const Group slope = squareRoot(slope2 > flat ? slope2 : flat);
        const Group u = x * e1[0] + y * e1[1] + z * e1[2], v = x * e2[0] + y * e2[1] + z * e2[2];
        const Group u2 = u * u, v2 = v * v, r2 = u2 + v2;
        const Group residual =
            r2 < radius2 && load(points.confidence, i) > 0 ? s.value / slope : Group{};
        squares += residual * residual;
        const Integers part = ((u > 0) & 1) | ((v > 0) & 2) | ((u2 > v2) & 4) |
                              ((2 * r2 > radius2) & 8) | ((r2 >= radius2) & 16);
        for (std::size_t k = 0; k < CellPoints::kGroup && i + k < points.count; ++k) {
            if (part[k] >= std::int64_t(ResidualSums::kParts)) continue;
            result.sums[std::size_t(part[k])] += residual[k];
            ++result.counts[std::size_t(part[k])];
            ++result.count;
        }
    }
    result.squares = sum(squares);
}

/// Residuals split into scatter within the parts, and differences between parts.
struct ResidualShares {
    double within, between; ///< mean square within; sum of squares between
    std::size_t parts, count;
};

ResidualShares shareResiduals(const LocalFit& fit, const CellPoints& points, double testRadius)
{
    ResidualSums residuals;
    sumResiduals(fit, points, testRadius, residuals);
    ResidualShares shares{residuals.squares, 0, 0, residuals.count};
    for (std::size_t k = 0; k < ResidualSums::kParts; ++k) {
        if (residuals.counts[k] == 0) continue;
        shares.between += residuals.sums[k] * residuals.sums[k] / double(residuals.counts[k]);
        ++shares.parts;
    }
    if (shares.count > shares.parts)
        shares.within = (residuals.squares - shares.between) / double(shares.count - shares.parts);
    return shares;
}

/// Largest scatter that is noise, in its standard deviations. [tuned: noise_bench]
constexpr double kMaxScatter = 2;

} // namespace

bool residualsAreNoise(const LocalFit& fit, const CellPoints& points, double testRadius,
                       double noise)
{
    /// Standard deviations of a chi-square sum from which on it is a pattern. [tuned: noise_bench]
    constexpr double kPatternDeviations = 2.5;
    const auto [within, between, parts, count] = shareResiduals(fit, points, testRadius);
    const double least = noise * noise, most = kMaxScatter * kMaxScatter * least;
    if (!(within <= most)) return false;
    const double expected = double(parts) + kPatternDeviations * std::sqrt(2 * double(parts));
    return between <= std::max(within, least) * expected;
}

namespace
{

/// Squares of the residuals and of the turns of normals of four points, in standard deviations.
struct NoisyDeviation {
    Group off, turn;
};

[[gnu::always_inline]] inline NoisyDeviation noisyDeviation(const LocalFit& fit,
                                                            const CellPoints& points, std::size_t i,
                                                            double noise2, double normalNoise2)
{
    const Samples s = sampleFit(fit, load(points.x, i), load(points.y, i), load(points.z, i));
    const Group slope2 = s.gx * s.gx + s.gy * s.gy + s.gz * s.gz, flat = Group{} + kMinGradient2;
    const Group steep2 = slope2 > flat ? slope2 : flat;
    const Group along =
        (load(points.nx, i) * s.gx + load(points.ny, i) * s.gy + load(points.nz, i) * s.gz) /
        squareRoot(steep2);
    return {s.value * s.value / (noise2 * steep2), 2 * (1 - along) / normalNoise2};
}

} // namespace

MPUVDB_WIDE_CLONES
double noisyMisfit(const LocalFit& fit, const CellPoints& points, double noise, double normalNoise)
{
    const Group most = Group{} + 9;
    const double noise2 = noise * noise, normalNoise2 = normalNoise * normalNoise;
    Group misfit{}, total{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const auto [off, turn] = noisyDeviation(fit, points, i, noise2, normalNoise2);
        const Group weight = load(points.weight, i);
        misfit += weight * ((off < most ? off : most) + (turn < most ? turn : most));
        total += weight;
    }
    const double weight = sum(total);
    return weight > 0 ? sum(misfit) / weight : 0;
}

MPUVDB_WIDE_CLONES
std::size_t countUnlikely(const LocalFit& fit, const CellPoints& points, double noise,
                          double normalNoise, double limit)
{
    const double noise2 = noise * noise, normalNoise2 = normalNoise * normalNoise;
    Group count{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const auto [off, turn] = noisyDeviation(fit, points, i, noise2, normalNoise2);
        const auto is = (off + turn > limit) & (load(points.weight, i) > 0);
        count += is ? Group{} + 1 : Group{};
    }
    return std::size_t(sum(count));
}

namespace
{

/// Distance of @a y, whose nearest point is @a gap away, from the points around it in the direction
/// of their mean: about 0 between points, the whole gap past the rim of a sheet of points.
MPUVDB_WIDE_CLONES
double overhang(const CellPoints& points, const Vec3d& y, double gap)
{
    /// Radius of the points around, gaps: to the far side of a gap in random samples.
    /// [tuned: unseen_bench]
    constexpr double kRimRadius = 3;
    const double within2 = kRimRadius * kRimRadius * gap * gap;
    Group sx{}, sy{}, sz{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group dx = load(points.x, i) - y[0], dy = load(points.y, i) - y[1],
                    dz = load(points.z, i) - y[2];
        const auto isNear = dx * dx + dy * dy + dz * dz < within2;
        sx += isNear ? dx : Group{}, sy += isNear ? dy : Group{}, sz += isNear ? dz : Group{};
    }
    const Vec3d mean(sum(sx), sum(sy), sum(sz));
    if (!(mean.norm() > 0)) return 0;
    const Vec3d u = mean.normalized();
    Group least = Group{} + gap;
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group dx = load(points.x, i) - y[0], dy = load(points.y, i) - y[1],
                    dz = load(points.z, i) - y[2];
        const Group along = dx * u[0] + dy * u[1] + dz * u[2];
        const auto nearer = (dx * dx + dy * dy + dz * dz < within2) & (along < least);
        least = nearer ? along : least;
    }
    return std::max(smallest(least), 0.0);
}

/// The largest gapAt(foot, enough) of the feet on the zero set as in zeroSetGap().
template <typename GapAt>
double largestGap(const LocalFit& fit, const Vec3d& center, double radius, double enough,
                  GapAt gapAt)
{
    static const Probes unit;
    Probes probes;
    const unsigned landed = stepOntoZeroSet(fit, center, radius, unit, probes);
    if (landed == 0) {
        const Vec3d foot = probes.at(0);
        const double uncertainty = kRelativeUncertainty * (foot - center).norm();
        return std::max(gapAt(foot, enough + uncertainty) - uncertainty, 0.0);
    }
    double gap = 0;
    for (std::size_t n = 0; n + 1 < Probes::kCount; ++n) // the last repeats the first
        if (landed >> n & 1u) gap = std::max(gap, gapAt(probes.at(n), enough));
    return gap;
}

} // namespace

double largestOnZeroSet(const LocalFit& fit, const Vec3d& center, double radius,
                        const std::function<double(const Vec3d&)>& of)
{
    static const Probes unit;
    Probes probes;
    const unsigned landed = stepOntoZeroSet(fit, center, radius, unit, probes);
    if (landed == 0) return of(probes.at(0));
    double largest = 0;
    for (std::size_t n = 0; n + 1 < Probes::kCount; ++n) // the last repeats the first
        if (landed >> n & 1u) largest = std::max(largest, of(probes.at(n)));
    return largest;
}

double zeroSetGap(const LocalFit& fit, const CellPoints& points, const Vec3d& center, double radius,
                  double enough)
{
    std::size_t start = 0;
    return largestGap(fit, center, radius, enough, [&](const Vec3d& foot, double near) {
        return std::sqrt(nearestFrom(points, foot, near * near, start));
    });
}

double zeroSetGapBeyond(const LocalFit& fit, const CellPoints& points, const Vec3d& center,
                        double radius, double enough)
{
    /// Least gap past which the rim counts, in gaps that are enough. [tuned: unseen_bench]
    constexpr double kMinGapShare = 0.4;
    std::size_t start = 0;
    return largestGap(fit, center, radius, enough, [&](const Vec3d& foot, double near) {
        const double close = kMinGapShare * near;
        const double gap = std::sqrt(nearestFrom(points, foot, close * close, start));
        return gap > close ? gap + kOverhangWeight * overhang(points, foot, gap) : gap;
    });
}

} // namespace mpuvdb
