#include "sheet.h"

#include "core/clones.h"
#include "fit_quality.h"
#include "ridged_solver.h"
#include "spatial/point_group.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Distance from a sheet, in standard deviations of the noise, from which on points are not of it.
/// [tuned: noise_bench; 4 and 6 cost 5 %]
constexpr double kFarthest = 5;

/// Turn of a normal from a sheet's, in standard deviations of normals and in radians beside that,
/// from which on points are not of it. [tuned: noise_bench; 3 costs 2 %]
constexpr double kMaxTurn = 4, kMaxBend = 0.1;

/// Points that a seed looks at. [tuned: noise_bench]
constexpr std::size_t kSeedPoints = 20;
/// Turn from the commonest normal up to which normals count, in standard deviations of normals.
/// [tuned: noise_bench]
constexpr double kSeedReach = 3.75;

/// Growth of the radius from fit to fit. [tuned: noise_bench]
constexpr double kStep = 1.6;

/// Least effective number of points of a fit that is believed. [derived: more than one]
constexpr double kFewestEffective = 1.5;

/// Least points of a sheet. [derived: unknowns of a quadric]
constexpr std::size_t kFewest = 6;

[[gnu::always_inline]] inline Group positive(const Group& g)
{
    return g > 0 ? g : Group{};
}

/// Squared distances and turns (1 - cosine) of four points from a quadric.
struct Deviation {
    Group distance2, turn;
};

[[gnu::always_inline]] inline Deviation deviationFrom(const Quadric& q, const CellPoints& points,
                                                      std::size_t i)
{
    const auto& A = q.A;
    const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
    const Group ax = A(0, 0) * x + A(0, 1) * y + A(0, 2) * z,
                ay = A(1, 0) * x + A(1, 1) * y + A(1, 2) * z,
                az = A(2, 0) * x + A(2, 1) * y + A(2, 2) * z;
    const Group value = x * (ax + q.b[0]) + y * (ay + q.b[1]) + z * (az + q.b[2]) + q.c;
    const Group gx = 2 * ax + q.b[0], gy = 2 * ay + q.b[1], gz = 2 * az + q.b[2];
    const Group inverse2 = 1 / (gx * gx + gy * gy + gz * gz + 1e-30);
    const Group along = load(points.nx, i) * gx + load(points.ny, i) * gy + load(points.nz, i) * gz;
    return {value * value * inverse2, 1 - along * squareRoot(inverse2)};
}

/// Inverses of the limits of deviations.
struct Limits {
    double distance2, turn;
    explicit Limits(const PointNoise& noise)
    {
        const double most = kMaxTurn * noise.tau + kMaxBend;
        distance2 = 1 / std::pow(kFarthest * noise.spread(), 2);
        turn = 2 / (most * most);
    }
};

/// Coordinates of the basis at @a y.
Eigen::Matrix<double, 6, 1> basisAt(const Sheet& sheet, const Vec3d& y)
{
    const Frame frame(sheet.axis);
    const Vec3d d = sheet.scale * (y - sheet.origin);
    const double u = d.dot(frame.u), v = d.dot(frame.v);
    Eigen::Matrix<double, 6, 1> f;
    f << u * u, u * v, v * v, u, v, 1;
    return f;
}

/// Sum of the weights, effective number of points, and centroid.
struct Totals {
    double weight = 0, count = 0;
    std::size_t points = 0; ///< with a weight
    Vec3d centroid = Vec3d::Zero();
};

MPUVDB_WIDE_CLONES
Totals totalsOf(const CellPoints& points)
{
    Group w{}, w2{}, points1{}, sx{}, sy{}, sz{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group weight = load(points.weight, i);
        w += weight;
        const Group confidence = load(points.confidence, i);
        w2 += confidence > 0 ? weight * weight / confidence : Group{};
        points1 += weight > 0 ? Group{} + 1 : Group{};
        sx += weight * load(points.x, i);
        sy += weight * load(points.y, i);
        sz += weight * load(points.z, i);
    }
    Totals totals;
    totals.weight = sum(w);
    totals.points = std::size_t(sum(points1));
    if (!(totals.weight > 0)) return totals;
    totals.count = totals.weight * totals.weight / sum(w2);
    totals.centroid = Vec3d(sum(sx), sum(sy), sum(sz)) / totals.weight;
    return totals;
}

/// The coefficients of a sheet and their covariance for an information of 1 per point.
struct Solution {
    Eigen::Matrix<double, 6, 1> k;
    Eigen::Matrix<double, 6, 6> inverse;
};

MPUVDB_WIDE_CLONES
void invert(const BivariateSystem& system, Solution& solution)
{
    Eigen::Matrix<double, 6, 1> ridge;
    ridge << 1e-5, 1e-5, 1e-5, 1e-6, 1e-6, 1e-14;
    solution.k = solveRidged<6>(system.M, system.r, ridge);
    Eigen::Matrix<double, 6, 6> damped = system.M;
    damped.diagonal() += ridge;
    const SmallCholesky<6> factor(damped);
    for (int i = 0; i < 6; ++i)
        solution.inverse.col(i) = factor.solve(Eigen::Matrix<double, 6, 1>::Unit(i));
}

/// Leave out the curvatures: solve for the plane alone.
void flatten(const BivariateSystem& system, Solution& solution)
{
    Eigen::Matrix3d M = system.M.bottomRightCorner<3, 3>();
    M.diagonal() += Vec3d(1e-6, 1e-6, 1e-14);
    const Eigen::Matrix3d inverse = M.inverse();
    solution.k.setZero();
    solution.k.tail<3>() = inverse * system.r.tail<3>();
    solution.inverse.setZero();
    solution.inverse.bottomRightCorner<3, 3>() = inverse;
}

/// Whether the curvatures gain less than they cost: 3 unknowns, ln(n) / 2 each [Schwarz78].
bool isFlat(const Solution& solution, const BivariateSystem& system, double count, double sigma)
{
    const Eigen::Matrix3d block = solution.inverse.topLeftCorner<3, 3>();
    const Vec3d bent = solution.k.head<3>();
    // Heights are scaled, so that their noise is.
    const double noise = sigma * system.scale;
    const double gain = count / (noise * noise) * bent.dot(block.inverse() * bent);
    return !(gain > 3 * std::log(std::max(count, 2.0)));
}

} // namespace

double Sheet::variance(const Vec3d& y) const
{
    const auto f = basisAt(*this, y);
    return f.dot(covariance * f);
}

Sheet Sheet::about(const Vec3d& y) const
{
    Sheet moved = *this;
    moved.q = q.shifted(y);
    moved.origin = origin - y;
    return moved;
}

double heightOver(const Sheet& sheet, const Vec3d& at, const Vec3d& axis)
{
    double height = 0;
    for (int n = 0; n < 3; ++n) {
        const Vec3d y = at + height * axis;
        const double slope = sheet.q.gradient(y).dot(axis);
        height -= sheet.q.value(y) / std::max(slope, kMinHeightCosine);
    }
    return height;
}

Sheet planeSheet(const Vec3d& point, const Vec3d& normal)
{
    Sheet sheet;
    sheet.q = {Eigen::Matrix3d::Zero(), normal, -normal.dot(point)};
    sheet.axis = normal;
    sheet.origin = point;
    return sheet;
}

MPUVDB_WIDE_CLONES
void weighBySheet(CellPoints& points, const Sheet& sheet, double reach, const PointNoise& noise)
{
    const Limits limits(noise);
    const double scale = 1.5 / reach;
    const Vec3d& axis = sheet.axis;
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group x = load(points.x, i), y = load(points.y, i), z = load(points.z, i);
        const Group along = x * axis[0] + y * axis[1] + z * axis[2];
        const Group across2 = x * x + y * y + z * z - along * along;
        const Group lateral = bsplineWeight(squareRoot(positive(across2)) * scale);
        const Deviation off = deviationFrom(sheet.q, points, i);
        const Group near = positive(1 - off.distance2 * limits.distance2),
                    alike = positive(1 - off.turn * limits.turn);
        const Group weight = load(points.confidence, i) * lateral * near * near * alike * alike;
        std::memcpy(&points.weight[i], &weight, sizeof weight);
    }
}

Sheet fitSheet(const CellPoints& points, const Vec3d& axis, const PointNoise& noise)
{
    const Totals totals = totalsOf(points);
    Sheet sheet = planeSheet(totals.centroid, axis);
    sheet.count = totals.count;
    if (totals.points < 3) return sheet;
    const Frame frame(axis);
    BivariateSystem system = bivariateSystem(points, frame, totals.centroid, totals.weight);
    if (!(system.scale > 0)) return sheet;
    if (noise.lever > 0)
        addSlopes(points, frame, totals.centroid, totals.weight, noise.lever, system);
    Solution solution;
    invert(system, solution);
    const bool flat =
        totals.points < kFewest || isFlat(solution, system, totals.count, noise.sigma);
    if (flat) flatten(system, solution);
    sheet.unknowns = flat ? 3 : 6;
    sheet.q = heightAbove(frame, solution.k.head<5>(), system.scale);
    sheet.q.c = -solution.k[5] / system.scale;
    sheet.q = sheet.q.shifted(-totals.centroid);
    sheet.scale = system.scale;
    sheet.covariance = solution.inverse / totals.count;
    return sheet;
}

namespace
{

/// The normal of a sheet at the foot of the line through the center along its axis.
Vec3d axisAtFoot(const Sheet& sheet)
{
    const Vec3d foot =
        -sheet.q.c / std::max(sheet.q.b.dot(sheet.axis), kMinHeightCosine) * sheet.axis;
    const Vec3d gradient = sheet.q.gradient(foot);
    return gradient.norm() > 0 ? Vec3d(gradient.normalized()) : sheet.axis;
}

} // namespace

Sheet growSheet(const CellPoints& points, const Sheet& seed, double start, double reach,
                const PointNoise& noise, CellPoints& scratch)
{
    scratch = points;
    Sheet sheet = seed;
    for (double radius = std::min(start, reach);; radius = std::min(kStep * radius, reach)) {
        weighBySheet(scratch, sheet, radius, noise);
        const Sheet next = fitSheet(scratch, sheet.axis, noise);
        if (next.count > kFewestEffective) {
            sheet = next;
            sheet.axis = axisAtFoot(sheet);
        }
        if (!(radius < reach)) return sheet;
    }
}

Sheet overFeet(const Sheet& sheet, double reach, const PointNoise& noise, CellPoints& scratch)
{
    // Weights by distance are those of the points' own places; the lateral ones of their feet.
    weighBySheet(scratch, sheet, reach, noise);
    scratch.projectLaterally(sheet.q, sheet.axis, kFarthest * noise.spread());
    weighBySheet(scratch, sheet, reach, noise);
    const Sheet last = fitSheet(scratch, sheet.axis, noise);
    return last.count > kFewestEffective ? last : sheet;
}

Sheet seedSheet(const CellPoints& points, const std::vector<std::uint8_t>& taken,
                const PointNoise& noise, double& reach)
{
    std::vector<std::pair<double, std::uint32_t>> near;
    for (std::size_t i = 0; i < points.count; ++i)
        if (!taken[i] && points.confidence[i] > 0)
            near.emplace_back(points.position(i).squaredNorm(), std::uint32_t(i));
    if (near.size() < kFewest) return {};
    const std::size_t count = std::min(kSeedPoints, near.size());
    std::partial_sort(near.begin(), near.begin() + std::ptrdiff_t(count), near.end());
    near.resize(count);
    // Turns (1 - cosine) in parts of the largest that counts.
    const double per = 2 / std::pow(kSeedReach * noise.tau, 2);
    std::size_t commonest = 0;
    double most = -1;
    for (std::size_t a = 0; a < count; ++a) {
        const Vec3d normal = points.normal(near[a].second);
        double votes = 0;
        for (std::size_t b = 0; b < count; ++b) {
            const double unlike = (1 - normal.dot(points.normal(near[b].second))) * per;
            votes += std::pow(std::max(1 - unlike, 0.0), 2);
        }
        if (votes > most) most = votes, commonest = a;
    }
    const Vec3d mode = points.normal(near[commonest].second);
    Vec3d at = Vec3d::Zero(), normal = Vec3d::Zero();
    double total = 0;
    for (const auto& [distance2, i] : near) {
        if ((1 - mode.dot(points.normal(i))) * per > 1) continue;
        at += points.confidence[i] * points.position(i);
        normal += points.confidence[i] * points.normal(i);
        total += points.confidence[i];
        reach = std::sqrt(distance2);
    }
    Sheet sheet = planeSheet(at / total, normal.normalized());
    sheet.count = total;
    return sheet;
}

MPUVDB_WIDE_CLONES
std::size_t takePoints(const CellPoints& points, const Sheet& sheet, const PointNoise& noise,
                       std::vector<std::uint8_t>& taken)
{
    const double distance = 1 / (kUnlikely * noise.spread() * noise.spread()),
                 turn = 2 / (kUnlikely * noise.tau * noise.tau);
    std::size_t left = 0;
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Deviation off = deviationFrom(sheet.q, points, i);
        const auto is = off.distance2 * distance + off.turn * turn < 1;
        for (std::size_t k = 0; k < CellPoints::kGroup && i + k < points.count; ++k) {
            taken[i + k] |= std::uint8_t(is[k] != 0);
            left += !taken[i + k] && points.confidence[i + k] > 0;
        }
    }
    return left;
}

NoiseSums& NoiseSums::operator+=(const NoiseSums& other)
{
    count += other.count, squares += other.squares;
    n += other.n, x += other.x, y += other.y, xx += other.xx, xy += other.xy;
    return *this;
}

namespace
{

/// Principal curvatures of the zero set at @a y; positive where it is convex.
Eigen::Vector2d curvatures(const Quadric& q, const Vec3d& y)
{
    const Vec3d gradient = q.gradient(y);
    const double slope = std::max(gradient.norm(), 1e-6);
    const Frame frame(gradient / slope);
    const double a = 2 * frame.u.dot(q.A * frame.u) / slope,
                 b = 2 * frame.u.dot(q.A * frame.v) / slope,
                 c = 2 * frame.v.dot(q.A * frame.v) / slope;
    const double mean = (a + c) / 2, spread = std::hypot((a - c) / 2, b);
    return {mean - spread, mean + spread};
}

/// The place on the zero set nearest to @a p.
Vec3d footOf(const Quadric& q, const Vec3d& p)
{
    Vec3d foot = p;
    for (int n = 0; n < 4; ++n) {
        const Vec3d g = q.gradient(foot);
        foot = p - ((p - foot).dot(g) + q.value(foot)) / std::max(g.squaredNorm(), 1e-30) * g;
    }
    return foot;
}

/// Largest product of a curvature and a distance from the surface: beyond, sides meet. [derived:
/// half of that where they do]
constexpr double kMostBent = 0.5;

} // namespace

NoiseSums residualsOf(const CellPoints& points, const Sheet& sheet, double reach,
                      const PointNoise& noise)
{
    NoiseSums sums;
    sums.unknowns = sheet.unknowns;
    const Limits limits(noise);
    const Vec3d foot = heightOver(sheet, Vec3d::Zero(), sheet.axis) * sheet.axis;
    const Eigen::Vector2d bent = curvatures(sheet.q, foot);
    for (std::size_t i = 0; i < points.count; ++i) {
        const Vec3d p = points.position(i), y = footOf(sheet.q, p), gradient = sheet.q.gradient(y);
        const double along = y.dot(sheet.axis), slope = gradient.norm();
        const double across = std::sqrt(std::max(y.squaredNorm() - along * along, 0.0));
        const double distance = (p - y).dot(gradient) / slope;
        const double turn = 1 - points.normal(i).dot(gradient) / slope;
        if (across >= reach || !(distance * distance * limits.distance2 < 1) ||
            !(turn * limits.turn < 1))
            continue;
        const double weight = points.confidence[i];
        sums.count += weight;
        sums.squares += weight * distance * distance;
        double x = 0;
        for (const double k : bent) x += k * k / (1 + std::clamp(k * distance, -kMostBent, 1.0));
        sums.n += weight;
        sums.x += weight * x, sums.y += weight * 2 * turn;
        sums.xx += weight * x * x, sums.xy += weight * x * 2 * turn;
    }
    return sums;
}

void removeTangentialBias(Sheet& sheet, const PointNoise& noise)
{
    const Vec3d foot = heightOver(sheet, Vec3d::Zero(), sheet.axis) * sheet.axis;
    const Eigen::Vector2d bent = curvatures(sheet.q, foot);
    const double variance = noise.tangential * noise.tangential;
    double shift = 0;
    for (int n = 0; n < 4; ++n) { // the curvature is that of the surface shifted
        double total = 0;
        for (const double k : bent) total += k / (1 - std::clamp(k * shift, -1.0, kMostBent));
        shift = variance * total / 2;
    }
    sheet.q.c += shift * sheet.q.gradient(foot).norm();
}

} // namespace mpuvdb
