// Walls and gaps so thin that noise mixes the points of their two sides.
#include "fit_quality.h"
#include "local_fit.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Least share of the normals' squares along one axis, of two sides without a rim.
/// [tuned: noise_bench]
constexpr double kMinAxisShare = 0.8;
constexpr std::size_t kMinSidePoints = 12; ///< least points of a side [tuned: noise_bench]
/// Least cosine to the axis of normals that count for a side: others are of a rim or another face,
/// and their sign along the axis is noise. [tuned: noise_bench]
constexpr double kMinAxisCosine = 0.5;
/// Share of the noise that residuals are compared with: three sheets fitted by two leave more.
/// [tuned: noise_bench]
constexpr double kNoiseShare = 0.65;
/// Least distance between the sides, standard errors: otherwise noise decides which is above.
/// [tuned: noise_bench]
constexpr double kMinSeparation = 2;

/// The common axis of the normals, of either sign; none if there is none.
std::optional<Vec3d> commonAxis(const CellPoints& points)
{
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < points.count; ++i)
        sum += points.weight[i] * points.normal(i) * points.normal(i).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(sum);
    if (!(solver.eigenvalues()[2] >= kMinAxisShare * sum.trace())) return std::nullopt;
    return Vec3d(solver.eigenvectors().col(2));
}

/// The two sides of a wall or gap, separated by the signs of normals.
class Sides
{
public:
    Sides(const CellPoints& points, const Vec3d& axis) : mPoints(points), mAxis(axis)
    {
        for (std::size_t i = 0; i < points.count; ++i)
            if (isClear(i)) ++mCount[sideOf(i)];
    }
    std::size_t fewer() const { return std::min(mCount[0], mCount[1]); }
    /// Standard error of the distance between the sides, for a noise of 1.
    double standardError() const
    {
        return std::sqrt(1 / double(mCount[0]) + 1 / double(mCount[1]));
    }
    /// Height of a side over the sheet between both, along its plane's normal.
    double height(std::size_t side) const { return mHeight[side]; }

    /// Turn the normals of @a sheet, a copy of the points, to the side of the axis.
    void turnAlong(CellPoints& sheet) const
    {
        for (std::size_t i = 0; i < sheet.paddedCount(); ++i) {
            if (sideOf(i) == 0) continue;
            sheet.nx[i] = -sheet.nx[i];
            sheet.ny[i] = -sheet.ny[i];
            sheet.nz[i] = -sheet.nz[i];
        }
    }

    /// Move each side of @a sheet so that its mean is on the zero set of @a q, along its plane's
    /// @a normal.
    void moveOnto(const Quadric& q, const Vec3d& normal, CellPoints& sheet)
    {
        std::array<double, 2> sum{}, weight{};
        for (std::size_t i = 0; i < sheet.count; ++i) {
            sum[sideOf(i)] += sheet.weight[i] * q.value(sheet.position(i));
            weight[sideOf(i)] += sheet.weight[i];
        }
        for (std::size_t side = 0; side < 2; ++side) {
            sum[side] = weight[side] > 0 ? sum[side] / weight[side] : 0;
            mHeight[side] += sum[side];
        }
        for (std::size_t i = 0; i < sheet.paddedCount(); ++i) {
            const Vec3d step = -sum[sideOf(i)] * normal;
            sheet.x[i] += step[0];
            sheet.y[i] += step[1];
            sheet.z[i] += step[2];
        }
    }

private:
    bool isClear(std::size_t i) const
    {
        return std::abs(mPoints.normal(i).dot(mAxis)) >= kMinAxisCosine;
    }
    std::size_t sideOf(std::size_t i) const { return mPoints.normal(i).dot(mAxis) > 0 ? 0 : 1; }

    const CellPoints& mPoints;
    Vec3d mAxis;
    std::array<std::size_t, 2> mCount{};
    std::array<double, 2> mHeight{};
};

} // namespace

std::optional<LocalFit> fitOpposedSheets(const CellPoints& points, double testRadius,
                                         const FitSettings& settings, CellPoints& scratch)
{
    constexpr int kAlternations = 3; ///< rounds of fits and moves [tuned: noise_bench]
    const std::optional<Vec3d> axis = commonAxis(points);
    if (!axis) return std::nullopt;
    Sides sides(points, *axis);
    if (sides.fewer() < kMinSidePoints) return std::nullopt;
    scratch = points;
    sides.turnAlong(scratch);
    scratch.weightLaterally(*axis, settings.reach > 0 ? settings.reach : points.radius);
    const Vec3d normal = meanNormal(scratch);
    LocalFit sheet;
    Quadric& q = sheet.pieces[0];
    for (int round = 0; round < kAlternations; ++round) {
        q = fitBivariate(scratch, normal, kMinSidePoints, settings.lever);
        sides.moveOnto(q, normal, scratch);
    }
    if (!residualsAreNoise(sheet, scratch, testRadius, kNoiseShare * settings.noise))
        return std::nullopt;
    const double apart = sides.height(0) - sides.height(1);
    if (std::abs(apart) < kMinSeparation * settings.noise * sides.standardError())
        return std::nullopt;
    LocalFit fit;
    fit.count = 2;
    fit.pieces[0] = {q.A, q.b, q.c - sides.height(0)};
    fit.pieces[1] = {-q.A, -q.b, sides.height(1) - q.c};
    fit.maxBits = apart > 0 ? ~0u : 0u; // a wall or a gap
    return fit;
}

} // namespace mpuvdb
