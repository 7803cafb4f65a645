// Normals of bare points: against the virtual scanner's truth.
#include "scanned_cloud.h"

#include <mpuvdb/io.h>
#include <mpuvdb/normals.h>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

/// Share of estimated normals that look to the true side.
double shareRight(const std::string& solid, std::uint64_t points, Pattern pattern, double noise = 0)
{
    PointCloud cloud = scanned(solid, points, pattern, noise);
    const std::vector<Vec3f> truth = std::exchange(cloud.normals, {});
    Interrupter progress;
    estimateNormals(cloud, {}, &progress);
    double right = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) right += truth[i].dot(cloud.normals[i]) > 0;
    return right / double(truth.size());
}

TEST(EstimateNormals, ThinWallsAndCloseSheets)
{
    EXPECT_GT(shareRight("slab(1,1,0.02)", 50000, Pattern::Random), 0.998) << "seed " << kSeed;
    EXPECT_GT(shareRight("sheets(1,1,0.3)", 30000, Pattern::Even), 0.998);
    EXPECT_GT(
        shareRight("union(translate(box(1,1,0.2),0,0,0.11),translate(box(1,1,0.2),0,0,-0.11))",
                   40000, Pattern::Even),
        0.995);
}

/// Share of estimated normals that look to the true side, of two slabs 1.6 spacings thick that
/// are a seventh of their width apart; only points away from the rims.
double shareRightOnSheets(double noise)
{
    PointCloud cloud = scanned("sheets(0.7,0.7,0.1)", 50000, Pattern::Even, noise);
    const std::vector<Vec3f> truth = std::exchange(cloud.normals, {});
    cloud.seenFrom.clear();
    Interrupter progress;
    estimateNormals(cloud, {}, &progress);
    double right = 0, all = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        if (cloud.positions[i].head<2>().cwiseAbs().maxCoeff() > 0.33f) continue;
        all += 1;
        right += truth[i].dot(cloud.normals[i]) > 0;
    }
    return right / all;
}

TEST(EstimateNormals, SheetsThinnerThanTheirNeighborhoods)
{
    EXPECT_EQ(shareRightOnSheets(0), 1);
    EXPECT_GT(shareRightOnSheets(0.0005), 0.998);
    EXPECT_GT(shareRight("slab(1,1,0.01)", 30000, Pattern::Random), 0.997) << "seed " << kSeed;
}

// Beside an acute edge neighbors on its two faces have normals that look apart, and many are
// farther from each other along the edge than across it. Rims of 63, 45 and 27 degrees.
TEST(EstimateNormals, AcuteEdges)
{
    for (const char* solid : {"cone(1,2)", "cone(1,1)", "cone(1,0.5)"})
        for (const Pattern pattern : {Pattern::Random, Pattern::Even})
            for (const std::uint64_t points : {3000, 20000}) {
                // Of the points those within two spacings of the rim may have planes of both faces.
                const double spacing = std::sqrt(2 * M_PI / double(points));
                EXPECT_GT(shareRight(solid, points, pattern), 1 - 4 * spacing)
                    << solid << ' ' << points << " seed " << kSeed;
            }
}

TEST(EstimateNormals, CavitiesLookInward)
{
    for (const char* solid :
         {"difference(sphere(1),sphere(0.7))",
          "difference(box(2,2,2),translate(sphere(0.3),0.4,0,0),translate(sphere(0.2),-0.5,0,0))",
          "union(difference(sphere(1),sphere(0.9)),sphere(0.5))"})
        EXPECT_EQ(shareRight(solid, 15000, Pattern::Even), 1) << solid << " seed " << kSeed;
}

// Walls three spacings thin, whose sides hang together by no links: each is a part of its own.
TEST(EstimateNormals, ThinShellsAreHollow)
{
    constexpr std::size_t kOuter = 40000;
    const double inner = 1 - 3 * std::sqrt(4 * M_PI / double(kOuter));
    for (unsigned seed = kSeed; seed < kSeed + 6; ++seed) {
        std::mt19937 random(seed);
        std::normal_distribution<float> normal;
        PointCloud cloud;
        for (std::size_t n = 0; n < std::size_t(double(kOuter) * (1 + inner * inner)); ++n) {
            const Vec3f to = Vec3f(normal(random), normal(random), normal(random)).normalized();
            cloud.positions.push_back(n < kOuter ? to : Vec3f(float(inner) * to));
        }
        Interrupter progress;
        estimateNormals(cloud, {}, &progress);
        std::size_t wrong = 0;
        for (std::size_t n = 0; n < cloud.size(); ++n)
            wrong += (cloud.positions[n].dot(cloud.normals[n]) > 0) != (n < kOuter);
        EXPECT_LT(wrong, cloud.size() / 1000) << "seed " << seed;
    }
}

TEST(EstimateNormals, SmoothSolidsAreRightEverywhere)
{
    for (const Pattern pattern : {Pattern::Random, Pattern::Scan})
        for (const double noise : {0.0, 0.004})
            for (const char* solid : {"blob(1,8,0.05)", "torus(1,0.2)"})
                EXPECT_EQ(shareRight(solid, 10000, pattern, noise), 1)
                    << solid << ' ' << noise << " seed " << kSeed;
}

TEST(EstimateNormals, OfRealPointsAgreeWithTheirTriangles)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    for (const char* file : {"clouds/igea.ply", "bunny/bun_zipper.ply", "cad/rocker-arm.obj",
                             "dragon_stand/dragonStandRight.conf"}) {
        Interrupter progress;
        PointCloud cloud =
            readPoints({std::filesystem::path(folder) / file}, BadPoints::Drop, {}, {}, &progress)
                .cloud;
        const std::vector<Vec3f> truth = std::exchange(cloud.normals, {});
        cloud.seenFrom.clear();
        estimateNormals(cloud, {}, &progress);
        double wrong = 0;
        for (std::size_t i = 0; i < truth.size(); ++i) wrong += truth[i].dot(cloud.normals[i]) < 0;
        const double most = cloud.viewpoints.empty() ? 0.0001 : 0.006; // rims of scans say little
        EXPECT_LE(wrong, most * double(truth.size())) << file;
    }
}

TEST(EstimateNormals, NoiseTakesMoreNeighbors)
{
    Interrupter progress;
    PointCloud clean = scanned("torus(1,0.3)", 20000, Pattern::Random);
    PointCloud noisy = scanned("torus(1,0.3)", 20000, Pattern::Random, 0.03);
    clean.normals.clear();
    noisy.normals.clear();
    EXPECT_EQ(estimateNormals(clean, {}, &progress).neighbors, 12);
    EXPECT_GT(estimateNormals(noisy, {}, &progress).neighbors, 30);
    EXPECT_EQ(shareRight("torus(1,0.3)", 20000, Pattern::Random, 0.03), 1);
}

// Neighbors at a contact, in a groove or at the rim of a lens take two sheets for one: bodies that
// hang together there looked inward as a whole. A share of the points is where the sheets are
// closer than their spacing, about a twelfth of a unit around the contact.
TEST(EstimateNormals, BodiesThatTouchLookOutwardAll)
{
    const double contact = 0.01;
    for (const char* const apart : {"1", "0.95", "0.92"}) {
        const std::string solid =
            fmt::format("union(translate(sphere(1),{0},0,0),translate(sphere(1),-{0},0,0))", apart);
        for (const double noise : {0.0, 0.004})
            EXPECT_GT(shareRight(solid, 40000, Pattern::Random, noise), 1 - contact)
                << solid << " noise " << noise << " seed " << kSeed;
    }
    for (const double noise : {0.0, 0.003})
        EXPECT_GT(shareRight("ellipsoid(1,1,0.06)", 30000, Pattern::Random, noise), 1 - contact)
            << "noise " << noise << " seed " << kSeed;
}

// Where three tubes touch, pieces of each were joined to others the wrong way round, and each that
// was turned by itself made its neighbors look wrong: the volume was two and a half times the
// truth.
TEST(EstimateNormals, PiecesThatContradictEachOtherAreTurnedOneByOne)
{
    const double radius = 0.4, spacing = std::sqrt(17.0 / 60000); // of the area and its points
    // Sheets are closer than the spacing in a strip of either side of two lines, 1.2 long.
    const double strips = 8 * std::sqrt(radius * spacing) * 1.2 / 17;
    const std::string tube = "difference(cylinder(0.4,1.2),cylinder(0.28,3))";
    const std::string tubes =
        fmt::format("union(translate({0},-0.8,0,0),union({0},translate({0},0.8,0,0)))", tube);
    EXPECT_GT(shareRight(tubes, 60000, Pattern::Random), 1 - strips) << "seed " << kSeed;
}

// At the acute rim of a pyramid's base noise joined the base to the sides the wrong way round, and
// neighbors turned back what the winding number had turned: the volume was three times the truth.
TEST(EstimateNormals, NeighborsDoNotTurnBackWhatFits)
{
    const std::size_t points = 12000;
    const double area = 4 + 4 * M_SQRT2, spacing = std::sqrt(area / double(points));
    // Base and sides are closer than the spacing in strips along four edges 2 long.
    const double strips = 2 * 8 * spacing / area;
    const std::string pyramid = "intersection(translate(box(3,3,1),0,0,0.5),intersection("
                                "rotate(box(1.414214,3,1.414214),0,1,0,45),"
                                "rotate(box(3,1.414214,1.414214),1,0,0,45)))";
    for (const double noise : {0.0, 0.004, 0.008})
        EXPECT_GT(shareRight(pyramid, points, Pattern::Random, noise), 1 - strips)
            << "noise " << noise << " seed " << kSeed;
}

// A depth camera tells depths in steps, wider than its points are apart: each step is a flat sheet.
TEST(EstimateNormals, StepsOfDepthsAreOneSheet)
{
    constexpr int kRays = 200;
    constexpr double kStep = 0.02;
    const auto depth = [](double u, double v) { return 3 + 1.2 * u + 0.1 * std::sin(5 * v); };
    PointCloud cloud;
    std::vector<Vec3d> truth;
    for (int i = 0; i < kRays; ++i)
        for (int j = 0; j < kRays; ++j) {
            const double u = double(i) / kRays - 0.5, v = double(j) / kRays - 0.5;
            const double z = kStep * std::round(depth(u, v) / kStep);
            cloud.positions.push_back(Vec3d(u * z, v * z, z).cast<float>());
            const double h = 1e-5;
            const auto at = [&](double x, double y) { return Vec3d(depth(x, y) * Vec3d(x, y, 1)); };
            truth.push_back(
                (at(u + h, v) - at(u - h, v)).cross(at(u, v + h) - at(u, v - h)).normalized());
        }
    Interrupter progress;
    estimateNormals(cloud, {}, &progress);
    double right = 0, sameWay = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const double cosine = truth[i].dot(cloud.normals[i].cast<double>());
        right += std::abs(cosine) > std::cos(20 * M_PI / 180);
        sameWay += cosine > 0;
    }
    const auto count = double(truth.size());
    EXPECT_GT(right, 0.9 * count);
    EXPECT_GT(std::max(sameWay, count - sameWay), 0.98 * count); // which side is not known
    const double noise = kStep / std::sqrt(12.0);                // of rounding
    EXPECT_NEAR(measure(cloud, &progress).noise, noise, 0.4 * noise);
}

TEST(EstimateNormals, LookTowardsTheViewpoint)
{
    // An open plane has no outside; seen from below it looks down.
    PointCloud cloud;
    for (int x = 0; x < 30; ++x)
        for (int y = 0; y < 30; ++y) cloud.positions.emplace_back(float(x), float(y), 0.f);
    cloud.frame = Vec3d(5e6, 0, 0);
    cloud.seenFrom.assign(cloud.size(), 0);
    for (const double z : {-50.0, 50.0})
        for (const bool distant : {false, true}) {
            cloud.viewpoints = {{distant ? Vec3d(0, 0, z) : Vec3d(5e6, 10, z), distant}};
            Interrupter progress;
            estimateNormals(cloud, {}, &progress);
            for (const Vec3f& n : cloud.normals) ASSERT_GT(double(n.z()) * z, 0);
        }
    std::vector<std::uint8_t> keep(cloud.size(), 0);
    keep[7] = 1;
    cloud.compact(keep);
    EXPECT_EQ(cloud.seenFrom.size(), 1u);
}

TEST(EstimateNormals, TellOfWhatClosesNoSolid)
{
    Interrupter progress;
    const auto shareOf = [&](PointCloud cloud) {
        cloud.normals.clear();
        const EstimatedNormals used = estimateNormals(cloud, {}, &progress);
        return double(used.unclosed) / double(cloud.size());
    };
    for (const char* const solid :
         {"torus(1,0.4)", "box(1,2,3)", "difference(sphere(1),sphere(0.8))"})
        for (const double noise : {0.0, 0.01}) // of sheets that are 20 deviations apart
            EXPECT_LT(shareOf(scanned(solid, 20000, Pattern::Random, noise)), 0.25)
                << solid << " noise " << noise << " seed " << kSeed;
    PointCloud cap = scanned("sphere(1)", 20000, Pattern::Random);
    std::vector<std::uint8_t> keep(cap.size());
    for (std::size_t i = 0; i < cap.size(); ++i) keep[i] = cap.positions[i].z() > 0.7f;
    cap.compact(keep);
    EXPECT_GT(shareOf(cap), 0.75);
    cap.viewpoints = {{Vec3d(0, 0, 9), false}};
    cap.seenFrom.assign(cap.size(), 0);
    EXPECT_EQ(shareOf(cap), 0);
}

} // namespace
} // namespace mpuvdb
