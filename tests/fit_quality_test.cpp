// How far a fit is from its points, and its points from its zero set.
#include "mpu/fit/fit_quality.h"

#include "cell_points.h"
#include "field_fixture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

using test::cellOf;
using test::Random;

TEST(TaubinError, IsTheLargestDistanceToFirstOrderWithinTheRadius)
{
    LocalFit fit;
    fit.pieces[0] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, 2), 0}; // |Q| / |grad Q| = |z|
    const std::vector<Vec3d> positions = {Vec3d(0.1, 0, 0.25), Vec3d(0, 0.2, -0.5), Vec3d(0, 0, 3)};
    const std::vector<Vec3d> normals(3, Vec3d(0, 0, 1));
    EXPECT_DOUBLE_EQ(taubinError(fit, cellOf(positions, normals, 4), 1), 0.5);
    EXPECT_DOUBLE_EQ(taubinError(fit, cellOf(positions, normals, 4), 4), 3.0);
    EXPECT_DOUBLE_EQ(taubinError(fit, cellOf(positions, normals, 4, 0.5), 4), 1.5);
    EXPECT_EQ(taubinError(fit, cellOf({}, {}, 4), 4), 0.0);
}

/// Points of two planes 2 apart that look away from each other, the lower one beyond the radius 1.
CellPoints wallPoints()
{
    std::vector<Vec3d> positions, normals;
    for (const double z : {0.0, -2.0})
        for (int x = -2; x <= 2; ++x)
            for (int y = -2; y <= 2; ++y) {
                positions.emplace_back(0.4 * x, 0.4 * y, z);
                normals.emplace_back(0, 0, z < 0 ? -1 : 1);
            }
    return cellOf(positions, normals, 3);
}

TEST(HeightError, CountsPointsThatLookAwayWhereverTheyAre)
{
    const Quadric plane{Eigen::Matrix3d::Zero(), Vec3d(0, 0, 1), 0};
    EXPECT_DOUBLE_EQ(heightError(plane, wallPoints(), 1), 2);
    LocalFit fit;
    fit.pieces[0] = plane;
    EXPECT_EQ(taubinError(fit, wallPoints(), 1), 0);
    // One normal of the sheet itself may be flipped, and points beside it beyond the radius count
    // for nothing.
    CellPoints sheet = cellOf({Vec3d(0, 0, 0), Vec3d(2, 0, 0), Vec3d(0, 2, 1)},
                              {Vec3d(0, 0, 1), Vec3d(0, 0, -1), Vec3d(0, 0, 1)}, 3);
    EXPECT_EQ(heightError(plane, sheet, 1), 0);
}

TEST(SidedError, IsInfiniteForAFitThatLooksAway)
{
    LocalFit wall, inverse;
    wall.count = inverse.count = 2;
    wall.pieces[0] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, 1), 0};
    wall.pieces[1] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, -1), -2};
    wall.maxBits = 1;
    for (int k = 0; k < 2; ++k) { // a slot of the same faces
        inverse.pieces[k] = wall.pieces[k];
        inverse.pieces[k].b *= -1;
        inverse.pieces[k].c *= -1;
    }
    CellPoints points = wallPoints(); // 50
    EXPECT_EQ(sidedError(wall, points, 1), 0);
    EXPECT_TRUE(std::isinf(sidedError(inverse, points, 1)));
    for (int flipped = 1; flipped <= 8; ++flipped) { // a tenth may be
        points.nz[std::size_t(2 * flipped)] *= -1;
        EXPECT_EQ(std::isinf(sidedError(wall, points, 1)), flipped > 5) << flipped;
    }
}

TEST(ZeroSetGap, IsTheDistanceFromTheZeroSetToItsData)
{
    LocalFit fit;
    fit.pieces[0] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, 1), 0};
    std::vector<Vec3d> whole, holed;
    const double step = 0.05, hole = 0.4;
    for (double x = -1; x <= 1; x += step)
        for (double y = -1; y <= 1; y += step) {
            const Vec3d p(x, y, 0);
            if (p.norm() >= 1) continue;
            whole.push_back(p);
            if (p.norm() >= hole) holed.push_back(p);
        }
    const auto gapOf = [&](const std::vector<Vec3d>& positions, const Vec3d& center) {
        const std::vector<Vec3d> normals(positions.size(), Vec3d(0, 0, 1));
        return zeroSetGap(fit, cellOf(positions, normals, 1), center, 1, 0);
    };
    EXPECT_LE(gapOf(whole, Vec3d::Zero()), step * std::sqrt(0.5) + 1e-12);
    EXPECT_NEAR(gapOf(holed, Vec3d::Zero()), hole, step);
    // The plane is not in the ball: the foot of its middle counts.
    const double doubt = 0.25;
    EXPECT_LE(gapOf(whole, Vec3d(0, 0, 1.5)), step * std::sqrt(0.5) + 1e-12);
    EXPECT_NEAR(gapOf(holed, Vec3d(0, 0, 1.5)), hole - doubt * 1.5, step);
    EXPECT_NEAR(gapOf(whole, Vec3d(2, 0, 1.5)), 1 - doubt * 1.5, step);
}

TEST(ZeroSetGap, IsMeasuredToTheNearestPoint)
{
    Random random(9);
    LocalFit fit;
    fit.pieces[0] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, 1), 0};
    const double tiny = 1e-9; // all probes have one foot
    for (const std::size_t count : {1u, 3u, 4u, 5u, 30u}) {
        std::vector<Vec3d> positions;
        for (std::size_t i = 0; i < count; ++i)
            positions.push_back(random.inBall(1) + Vec3d(2, 0, 0));
        const std::vector<Vec3d> normals(count, Vec3d(0, 0, 1));
        const Vec3d foot(random.uniform(-1, 1), random.uniform(-1, 1), 0);
        double nearest = std::numeric_limits<double>::infinity();
        for (const Vec3d& p : positions) nearest = std::min(nearest, (p - foot).norm());
        EXPECT_NEAR(zeroSetGap(fit, cellOf(positions, normals, 1), foot, tiny, 0), nearest,
                    2 * tiny)
            << count;
    }
    EXPECT_TRUE(std::isinf(zeroSetGap(fit, cellOf({}, {}, 1), Vec3d(0, 0, 1), 0.5, 0)));
}

TEST(ZeroSetGapBeyond, CountsWhatIsPastTheRimMoreThanWhatIsBetween)
{
    LocalFit fit;
    fit.pieces[0] = {Eigen::Matrix3d::Zero(), Vec3d(0, 0, 1), 0};
    const double step = 0.05, tiny = 1e-9; // all probes have one foot
    std::vector<Vec3d> half, slotted;      // a rim at x = 0, another at x = 0.4
    for (double x = -1; x <= 1; x += step)
        for (double y = -1; y <= 1; y += step) {
            if (x <= 1e-9) half.push_back({x, y, 0});
            if (x <= 1e-9 || x >= 0.4 - 1e-9) slotted.push_back({x, y, 0});
        }
    const auto gaps = [&](const std::vector<Vec3d>& positions, double x) {
        const CellPoints cell =
            cellOf(positions, std::vector<Vec3d>(positions.size(), Vec3d(0, 0, 1)), 2);
        const Vec3d foot(x, 0, 0);
        return std::pair(zeroSetGap(fit, cell, foot, tiny, 0),
                         zeroSetGapBeyond(fit, cell, foot, tiny, 0));
    };
    const double beyond = 4;
    for (const double x : {0.1, 0.2, 0.3}) {
        const auto [gap, counted] = gaps(half, x);
        EXPECT_NEAR(gap, x, 0.01 * x);
        EXPECT_NEAR(counted, (1 + beyond) * x, 0.05 * x) << "past the rim by " << x;
        const auto [inner, innerCounted] = gaps(half, -x - step / 2);
        EXPECT_NEAR(innerCounted, inner, 0.1 * inner) << "among points";
    }
    const auto [gap, counted] = gaps(slotted, 0.2);
    EXPECT_EQ(counted, gap) << "between two rims";
    const CellPoints close = cellOf(half, std::vector<Vec3d>(half.size(), Vec3d(0, 0, 1)), 2);
    EXPECT_LE(zeroSetGapBeyond(fit, close, Vec3d(0.1, 0, 0), tiny, 0.3), 0.3) << "near enough";
}

} // namespace
} // namespace mpuvdb
