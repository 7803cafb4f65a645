// Walls and gaps so thin that noise mixes the points of their two sides.
#include "fit_quality.h"
#include "local_fit.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace mpuvdb
{
namespace
{

/// Share of the normals' squares along one axis: sides of a wall, and no rim of it between them.
constexpr double kOneAxis = 0.8;
constexpr std::size_t kFewest = 12; ///< points of a side
/// Of the noise: what of it is asked whether it is alone there. Three sheets for two are louder.
constexpr double kQuiet = 0.65;
/// Standard errors by which the sides are apart, or it cannot be told which is above.
constexpr double kApart = 2;

/// The axis that the normals have in common, of either sign; none where they have not.
std::optional<Vec3d> commonAxis(const CellPoints& points)
{
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < points.count; ++i)
        sum += points.weight[i] * points.normal(i) * points.normal(i).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(sum);
    if (!(solver.eigenvalues()[2] >= kOneAxis * sum.trace())) return std::nullopt;
    return Vec3d(solver.eigenvectors().col(2));
}

/// The sides of a wall or gap, as one sheet: their points, all with normals to one side.
struct Sides {
    std::array<double, 2> height{}; ///< of each above the sheet between them, along its normal
    std::array<std::size_t, 2> count{};
    std::vector<int> of; ///< each point's
};

/// Make the normals of @a points look along @a axis.
Sides turnAlong(const Vec3d& axis, CellPoints& points)
{
    Sides sides;
    for (std::size_t i = 0; i < points.paddedCount(); ++i) {
        const int side = points.normal(i).dot(axis) > 0 ? 0 : 1;
        if (side == 1) {
            points.nx[i] = -points.nx[i];
            points.ny[i] = -points.ny[i];
            points.nz[i] = -points.nz[i];
        }
        sides.of.push_back(side);
        if (i < points.count) ++sides.count[std::size_t(side)];
    }
    return sides;
}

/// Bring both sides' points, in the mean, onto the zero set of @a q along its plane's @a normal.
void moveOnto(const Quadric& q, const Vec3d& normal, CellPoints& points, Sides& sides)
{
    std::array<double, 2> sum{}, weight{};
    for (std::size_t i = 0; i < points.count; ++i) {
        const auto side = std::size_t(sides.of[i]);
        sum[side] += points.weight[i] * q.value(points.position(i));
        weight[side] += points.weight[i];
    }
    for (std::size_t s = 0; s < 2; ++s) sum[s] = weight[s] > 0 ? sum[s] / weight[s] : 0;
    for (std::size_t s = 0; s < 2; ++s) sides.height[s] += sum[s];
    for (std::size_t i = 0; i < points.paddedCount(); ++i) {
        const Vec3d step = -sum[std::size_t(sides.of[i])] * normal;
        points.x[i] += step[0];
        points.y[i] += step[1];
        points.z[i] += step[2];
    }
}

} // namespace

std::optional<LocalFit> fitOpposedSheets(const CellPoints& points, double testRadius,
                                         const FitSettings& settings, CellPoints& scratch)
{
    constexpr int kRounds = 3;
    const std::optional<Vec3d> axis = commonAxis(points);
    if (!axis) return std::nullopt;
    scratch = points;
    Sides sides = turnAlong(*axis, scratch);
    const auto n0 = double(sides.count[0]), n1 = double(sides.count[1]);
    if (std::min(n0, n1) < kFewest) return std::nullopt;
    scratch.weighAcross(*axis, settings.reach > 0 ? settings.reach : points.radius);
    const Vec3d normal = meanNormal(scratch);
    LocalFit sheet;
    Quadric& q = sheet.pieces[0];
    for (int round = 0; round < kRounds; ++round) {
        q = fitBivariate(scratch, normal, kFewest, settings.lever);
        moveOnto(q, normal, scratch, sides);
    }
    if (!residualsAreNoise(sheet, scratch, testRadius, kQuiet * settings.noise))
        return std::nullopt;
    const double apart = sides.height[0] - sides.height[1];
    if (std::abs(apart) < kApart * settings.noise * std::sqrt(1 / n0 + 1 / n1)) return std::nullopt;
    LocalFit fit;
    fit.count = 2;
    fit.pieces[0] = {q.A, q.b, q.c - sides.height[0]};
    fit.pieces[1] = {-q.A, -q.b, sides.height[1] - q.c};
    fit.maxBits = apart > 0 ? ~0u : 0u; // a wall or a gap
    return fit;
}

} // namespace mpuvdb
