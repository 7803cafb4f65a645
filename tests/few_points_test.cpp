// Clouds of hardly any points have ends everywhere: what is asked of points, asked of few.
#include "scanned_cloud.h"

#include <mpuvdb/error.h>

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mpuvdb
{
namespace
{

PointStatistics measured(const PointCloud& cloud)
{
    Interrupter progress;
    return measure(cloud, &progress);
}

TEST(Measure, FewPoints)
{
    PointCloud cloud;
    EXPECT_THROW(measured(cloud), InputError);
    cloud.positions.assign(1000, Vec3f(1, 2, 3));
    EXPECT_THROW(measured(cloud), InputError);
    cloud.positions.push_back(Vec3f(1, 2, 4));
    EXPECT_NEAR(measured(cloud).spacing, std::sqrt(M_PI), 1e-6);
    EXPECT_EQ(measured(cloud).noise, 0);
    for (const int side : {2, 3, 4, 5, 6, 7}) {
        const PointStatistics s = measured(planeGrid(side, 1));
        EXPECT_GT(s.spacing, 0.8) << side;
        EXPECT_LT(s.spacing, 1.8) << side;
        EXPECT_LT(s.noise, 1e-9) << side;
    }
    cloud.positions.clear();
    for (int i = 0; i < 100; ++i) cloud.positions.emplace_back(float(i), 0.0f, 0.0f);
    EXPECT_TRUE(std::isfinite(measured(cloud).noise)); // a line has no plane
}

TEST(EstimateNormals, FewPoints)
{
    Interrupter progress;
    PointCloud cloud = planeGrid(2, 1);
    estimateNormals(cloud, 16, &progress);
    for (const Vec3f& n : cloud.normals) EXPECT_NEAR(std::abs(n.z()), 1, 1e-6);
    cloud.positions[1] = cloud.positions[0];
    EXPECT_THROW(estimateNormals(cloud, 16, &progress), InputError);
    EXPECT_THROW(estimateNormals(cloud, 3, &progress), UsageError);

    PointCloud line;
    for (int i = 0; i < 500; ++i)
        line.positions.push_back(Vec3f(1, -2, 3) + float(i) * Vec3f(0.1f, 0.2f, 0.05f));
    EXPECT_THROW(estimateNormals(line, {}, &progress), InputError);
    line.positions[250] += Vec3f(0.01f, 0, 0);
    EXPECT_NO_THROW(estimateNormals(line, {}, &progress));
}

/// A plate whose points are thirty times as many at one end as at the other, where its sides are
/// about as near to each other as their points are: those neighbors alone lie on no plane.
TEST(Outliers, SidesOfAPlateWithFewPointsStay)
{
    for (const std::uint32_t seed : {1u, 2u, 3u}) {
        std::mt19937 engine(seed);
        const auto uniform = [&] { return float(engine()) / 4294967296.f; };
        PointCloud cloud;
        for (int n = 0; n < 18000; ++n) { // x has the density 30^(1 - x / 4)
            const float x = -4 * std::log(1 - uniform() * 29 / 30) / std::log(30.f);
            const float side = n % 2 ? 1.f : -1.f;
            cloud.positions.emplace_back(x, 4 * uniform(), 0.05f * side);
            cloud.normals.emplace_back(0, 0, side);
        }
        EXPECT_LT(outliersOf(cloud).size(), cloud.size() / 1000) << "seed " << seed;
    }
}

TEST(Outliers, FewPointsAreAllKept)
{
    PointCloud cloud;
    appendClump(cloud, 150, Vec3f::Zero(), Vec3f::Ones());
    EXPECT_TRUE(outliersOf(cloud).empty());
    cloud.normals.clear();
    cloud.positions.assign(1000, Vec3f(1, 2, 3)); // one place
    cloud.positions.push_back(Vec3f(1, 2, 4));
    Interrupter progress;
    EXPECT_NO_THROW(findOutliers(cloud, measure(cloud, &progress), &progress));
}

TEST(InwardSolids, FewPointsAndNoisyOnes)
{
    EXPECT_EQ(foundInFlipped(scanned("sphere(1)", 600, Pattern::Even)),
              scanned("sphere(1)", 600, Pattern::Even).size());
    const PointCloud noisy = scanned("torus(1,0.4)", 30000, Pattern::Random, 0.01);
    EXPECT_EQ(foundIn(noisy), 0u);
    EXPECT_EQ(foundInFlipped(noisy), noisy.size());
    Interrupter progress;
    EXPECT_TRUE(findInwardSolids(PointCloud(), PointStatistics(), &progress).empty());
}

} // namespace
} // namespace mpuvdb
