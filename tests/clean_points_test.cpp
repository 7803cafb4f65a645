// Outliers and flipped normals: against the virtual scanner's truth.
#include "case_files.h"
#include "field_fixture.h"
#include "scanned_cloud.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/outliers.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numeric>
#include <random>
#include <utility>

namespace mpuvdb
{
namespace
{

std::vector<std::uint32_t> flippedOf(const PointCloud& cloud)
{
    Interrupter progress;
    return findFlippedNormals(cloud, measure(cloud, &progress), &progress);
}

void append(PointCloud& to, const PointCloud& from, const Vec3f& offset)
{
    for (const Vec3f& p : from.positions) to.positions.push_back(p + offset);
    to.normals.insert(to.normals.end(), from.normals.begin(), from.normals.end());
}

TEST(Outliers, CleanCloudsHaveNone)
{
    for (const char* solid :
         {"sphere(1)", "torus(1,0.3)", "box(1,1,1)", "fandisk(1)", "slab(1,1,0.02)"})
        for (const Pattern pattern : {Pattern::Even, Pattern::Random, Pattern::Scan})
            EXPECT_EQ(outliersOf(scanned(solid, 10000, pattern)).size(), 0u)
                << solid << " seed " << kSeed;
}

TEST(Outliers, OnePercentIsFound)
{
    for (const char* solid : {"blob(1,8,0.05)", "torus(1,0.3)"}) {
        const auto truth = parseSolid(solid);
        PointCloud cloud = scanned(solid, 50000, Pattern::Scan, 0.002, 0.01);
        Interrupter progress;
        const double spacing = measure(cloud, &progress).spacing;
        const auto away = [&](double spacings) {
            std::size_t count = 0;
            for (std::size_t i = 0; i < cloud.size(); ++i)
                count += std::abs(truth->distance(cloud.world(i))) > spacings * spacing;
            return count;
        };
        const std::size_t before = away(6);
        const std::size_t points = cloud.size();
        const auto found = outliersOf(cloud);
        dropPoints(cloud, found);
        EXPECT_EQ(cloud.size(), points - found.size());
        EXPECT_EQ(cloud.normals.size(), cloud.size());
        EXPECT_GT(before, 300u);
        EXPECT_LT(double(away(6)), 0.1 * double(before)) << solid << " seed " << kSeed;
        EXPECT_LT(double(found.size()), 0.01 * double(points)) << solid << " seed " << kSeed;
    }
}

TEST(Outliers, EveryTenthAndEveryFifthAreFound)
{
    for (const char* solid :
         {"blob(1,8,0.05)", "torus(1,0.4)", "difference(box(2,2,1),cylinder(0.6,3))"})
        for (const Pattern pattern : {Pattern::Random, Pattern::Scan})
            for (const double share : {0.1, 0.2}) {
                const auto truth = parseSolid(solid);
                PointCloud cloud = scanned(solid, 50000, pattern, 0, share);
                Interrupter progress;
                const double spacing = measure(cloud, &progress).spacing;
                const auto found = outliersOf(cloud);
                std::vector<char> isFound(cloud.size(), 0);
                for (const std::uint32_t i : found) isFound[i] = 1;
                std::size_t far = 0, missed = 0, right = 0, lost = 0;
                for (std::size_t i = 0; i < cloud.size(); ++i) {
                    const double off = std::abs(truth->distance(cloud.world(i)));
                    far += off > 4 * spacing;
                    missed += off > 4 * spacing && !isFound[i];
                    right += off < 1e-3 * spacing;
                    lost += off < 1e-3 * spacing && isFound[i];
                }
                const std::string which = fmt::format("{}, pattern {}, share {}, seed {}", solid,
                                                      int(pattern), share, kSeed);
                EXPECT_GT(double(far), 0.4 * share * double(cloud.size())) << which;
                EXPECT_LT(double(missed), 0.15 * share * double(far)) << which;
                EXPECT_LT(double(lost), 1e-3 * double(right)) << which;
            }
}

/// However few or many they are, and though walls are as near to each other as cells are wide.
TEST(Outliers, ThoseInBoresAndBetweenWallsAreFound)
{
    for (const char* solid :
         {"difference(cylinder(1,2),cylinder(0.8,3))", "difference(box(2,2,1),cylinder(0.6,3))",
          "difference(box(2,2,0.4),cylinder(0.3,3))"})
        for (const int percent : {1, 3, 5}) {
            const auto truth = parseSolid(solid);
            PointCloud cloud = scanned(solid, 50000, Pattern::Random);
            const std::size_t real = cloud.size();
            Eigen::AlignedBox3f box;
            for (const Vec3f& p : cloud.positions) box.extend(p);
            appendClump(cloud, int(real) * percent / 100, box.center(), 1.2f * box.sizes());
            Interrupter progress;
            const double spacing = measure(cloud, &progress).spacing;
            const auto found = outliersOf(cloud);
            std::size_t far = 0, farFound = 0;
            for (std::size_t i = real; i < cloud.size(); ++i) {
                if (std::abs(truth->distance(cloud.world(i))) < 4 * spacing) continue;
                ++far;
                farFound += std::binary_search(found.begin(), found.end(), std::uint32_t(i));
            }
            const std::string which = fmt::format("{}, {} %, seed {}", solid, percent, kSeed);
            EXPECT_GT(far, real * std::size_t(percent) / 400) << which;
            EXPECT_GT(double(farFound), 0.99 * double(far)) << which;
            EXPECT_TRUE(found.empty() || found.front() >= real) << which;
        }
}

/// As a scanner sees the bottom of a fold: by one point far from others, whose normal tells that
/// the surface passes there.
TEST(Outliers, APointThatNormalsLeadToStays)
{
    PointCloud cloud = scanned("torus(1,0.1)", 20000, Pattern::Even);
    const Vec3f lone(0, 1.1f, 0); // eight spacings from others
    std::vector<std::uint32_t> beside;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if ((cloud.world(i).cast<float>() - lone).norm() < 0.11f) beside.push_back(i);
    dropPoints(cloud, beside);
    const auto index = std::uint32_t(cloud.size());
    cloud.positions.push_back(lone - cloud.frame.cast<float>());
    cloud.normals.push_back(Vec3f(0, 1, 0));
    EXPECT_TRUE(outliersOf(cloud).empty());
    for (const Vec3f& wrong : {Vec3f(0, -1, 0), Vec3f(0.8f, 0.6f, 0), Vec3f(0, 0.6f, 0.8f)}) {
        cloud.normals.back() = wrong;
        EXPECT_EQ(outliersOf(cloud), std::vector<std::uint32_t>{index});
    }
    cloud.normals.clear();
    EXPECT_EQ(outliersOf(cloud), std::vector<std::uint32_t>{index});
}

/// As a scanner sees two faces of a wedge: one of them hardly at all.
TEST(Outliers, ASparseFaceBesideADenseOneStays)
{
    constexpr float kSparse = 0.03f, kDense = 0.006f; // between rows
    PointCloud cloud;
    const auto addFace = [&](float spacing, const Vec3f& across, const Vec3f& normal) {
        const int rows = int(1 / spacing);
        for (int i = 0; i < rows; ++i)
            for (int j = 0; j < rows; ++j) {
                const float along = i % 2 ? 0.5f : 0; // rows are staggered
                cloud.positions.push_back(Vec3f(spacing * (float(j) + along), 0, 0) +
                                          spacing * (float(i) + 0.3f) * across);
                cloud.normals.push_back(normal);
            }
    };
    const float c = std::cos(0.96f), s = std::sin(0.96f); // 55 degrees
    addFace(kSparse, Vec3f(0, 1, 0), Vec3f(0, 0, -1));
    const std::size_t sparse = cloud.size();
    addFace(kDense, Vec3f(0, c, s), Vec3f(0, -s, c));
    const auto found = outliersOf(cloud);
    EXPECT_LE(found.size(), 2u) << "of " << sparse; // at the corners
}

TEST(Outliers, ClumpsGoAndDetachedObjectsStay)
{
    PointCloud cloud = scanned("sphere(1)", 20000, Pattern::Even);
    const std::size_t object = cloud.size();
    append(cloud, scanned("sphere(0.08)", 120, Pattern::Even), Vec3f(1.5f, 0, 0));
    append(cloud, scanned("sphere(0.3)", 150, Pattern::Even), Vec3f(0, 2, 0)); // sparser
    const auto real = std::uint32_t(cloud.size());
    ASSERT_GE(real, object + 230);
    appendClump(cloud, 15, Vec3f(0, 0, 1.8f), Vec3f::Constant(0.05f));
    appendClump(cloud, 3, Vec3f(0, -1.5f, 0), Vec3f::Constant(0.01f));
    appendClump(cloud, 1, Vec3f(-1.2f, 0, 0), Vec3f::Constant(0.01f));
    std::vector<std::uint32_t> expected;
    for (std::uint32_t i = real; i < cloud.size(); ++i) expected.push_back(i);
    EXPECT_EQ(outliersOf(cloud), expected);
}

TEST(Outliers, SparsePartsStay)
{
    // Every two-hundredth point of one half: its spacing is fourteen times the other's.
    PointCloud dense = scanned("sphere(1)", 100000, Pattern::Random), uneven;
    std::size_t sparse = 0;
    for (std::size_t i = 0; i < dense.size(); ++i)
        if (dense.positions[i].x() > 0 || i % 200 == 0) {
            sparse += dense.positions[i].x() <= 0;
            uneven.positions.push_back(dense.positions[i]);
        }
    EXPECT_GT(sparse, 200u);
    EXPECT_LT(double(outliersOf(uneven).size()), 0.03 * double(sparse)) << "seed " << kSeed;
}

TEST(Outliers, SparsePartsStayAmongManyOutliers)
{
    // Every twentieth point of one half, and one in twenty that is none.
    PointCloud dense = scanned("sphere(1)", 100000, Pattern::Random), uneven;
    std::size_t sparse = 0;
    for (std::size_t i = 0; i < dense.size(); ++i)
        if (dense.positions[i].x() > 0 || i % 20 == 0) {
            sparse += dense.positions[i].x() <= 0;
            uneven.positions.push_back(dense.positions[i]);
        }
    const std::size_t real = uneven.size();
    std::mt19937 engine(kSeed);
    const auto uniform = [&] { return 3.f * (float(engine()) / 4294967296.f - 0.5f); };
    while (uneven.size() < real + real / 20) {
        const float x = uniform(), y = uniform(), z = uniform();
        uneven.positions.push_back(Vec3f(x, y, z));
    }
    const auto found = outliersOf(uneven);
    std::size_t lost = 0;
    for (const std::uint32_t i : found) lost += i < real && uneven.positions[i].x() <= 0;
    const auto right =
        found.end() - std::lower_bound(found.begin(), found.end(), std::uint32_t(real));
    EXPECT_LT(double(lost), 0.03 * double(sparse)) << "seed " << kSeed;
    EXPECT_GT(double(right), 0.9 * double(uneven.size() - real)) << "seed " << kSeed;
}

/// @a from, scaled about its middle.
PointCloud scaled(PointCloud from, float factor)
{
    for (Vec3f& p : from.positions) p *= factor;
    return from;
}

/// Perfect and noisy parts whose spacings differ by far more than a cell of the screen is wide, and
/// what lies about them.
TEST(Outliers, PartsOfAnySpacingStay)
{
    for (const float ratio : {3.f, 30.f, 1000.f})
        for (const double noise : {0.0, 0.02}) {
            PointCloud cloud = scanned("sphere(1)", 12000, Pattern::Random, noise / 3);
            float at = 0;
            for (const char* solid :
                 {"torus(1,0.4)", "box(2,1,1.5)", "sphere(1)", "cylinder(0.4,3)"})
                append(cloud, scaled(scanned(solid, 900, Pattern::Random, noise), 0.3f * ratio),
                       Vec3f(at += 3 * ratio, 0, 0));
            const std::size_t real = cloud.size();
            appendClump(cloud, 120, Vec3f::Zero(), Vec3f::Constant(6)); // about the dense one
            appendClump(cloud, 36, Vec3f(at, 0, 0), Vec3f::Constant(1.8f * ratio));
            for (const bool normals : {true, false}) {
                if (!normals) cloud.normals.clear();
                const auto found = outliersOf(cloud);
                const auto first = std::lower_bound(found.begin(), found.end(), real);
                const std::string which = fmt::format("1 to {}, noise {}, normals {}, seed {}",
                                                      ratio, noise, normals, kSeed);
                EXPECT_LE(double(first - found.begin()), noise > 0 ? 0.01 * 3600 : 0) << which;
                EXPECT_GT(double(found.end() - first), 0.9 * 156) << which;
            }
        }
}

TEST(Outliers, FiveBallsOfAnySpacingStay)
{
    const std::filesystem::path file = test::caseFile("T19-five-balls.ply");
    if (file.empty()) GTEST_SKIP() << "no cases beside MPUVDB_DATA_DIR";
    Interrupter progress;
    EXPECT_TRUE(outliersOf(readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud).empty());
}

TEST(Outliers, KnowNoThreads)
{
    const PointCloud cloud = scanned("torus(1,0.3)", 30000, Pattern::Random, 0.002, 0.02);
    const auto found = outliersOf(cloud);
    EXPECT_GT(found.size(), 300u);
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(outliersOf(cloud), found);
}

TEST(FlippedNormals, CleanCloudsHaveNone)
{
    for (const char* solid : {"sphere(1)", "box(1,1,1)", "fandisk(1)", "gear(12,1,0.3)",
                              "slab(1,1,0.03)", "sheets(1,1,0.3)"})
        for (const Pattern pattern : {Pattern::Even, Pattern::Scan})
            EXPECT_EQ(flippedOf(scanned(solid, 10000, pattern)).size(), 0u)
                << solid << " seed " << kSeed;
}

/// Points all over a square pyramid, moved any way by noise.
PointCloud noisyPyramid(int count, double noise)
{
    std::mt19937 engine(kSeed);
    std::normal_distribution<float> normal(0, float(noise));
    const auto uniform = [&] { return float(engine()) / 4294967296.f; };
    const Vec3f apex(0, 0, 2);
    const std::array<Vec3f, 4> base = {Vec3f(-0.5f, -0.5f, 0), Vec3f(0.5f, -0.5f, 0),
                                       Vec3f(0.5f, 0.5f, 0), Vec3f(-0.5f, 0.5f, 0)};
    const std::array<std::array<Vec3f, 3>, 6> triangles = {{{base[0], base[2], base[1]},
                                                            {base[0], base[3], base[2]},
                                                            {base[0], base[1], apex},
                                                            {base[1], base[2], apex},
                                                            {base[2], base[3], apex},
                                                            {base[3], base[0], apex}}};
    PointCloud cloud;
    for (int n = 0; n < count; ++n) { // each part as many: a base twice as dense as the sides
        const auto& [a, b, c] = triangles[std::size_t(n) % 6];
        const float r = std::sqrt(uniform()), s = uniform();
        const Vec3f off(normal(engine), normal(engine), normal(engine));
        cloud.positions.push_back((1 - r) * a + r * (1 - s) * b + r * s * c + off);
        cloud.normals.push_back((b - a).cross(c - a).normalized());
    }
    return cloud;
}

/// Where heights are lost in noise, faces that meet at less than a right angle look as if one of
/// them were flipped.
TEST(FlippedNormals, NoiseAtEdgesTurnsNoFaces)
{
    for (const double noise : {0.007, 0.012, 0.015}) {
        const std::size_t turned = flippedOf(noisyPyramid(120000, noise)).size();
        EXPECT_LT(turned, 1200u) << noise << " seed " << kSeed;
    }
}

/// Two flat sheets 1.5 spacings apart that look at each other, or away.
TEST(FlippedNormals, CloseSheetsStay)
{
    for (const float side : {1.f, -1.f}) {
        PointCloud cloud;
        for (int x = 0; x < 100; ++x)
            for (int y = 0; y < 100; ++y)
                for (int z = 0; z < 2; ++z) {
                    cloud.positions.emplace_back(float(x), float(y), 1.5f * float(z));
                    cloud.normals.emplace_back(0.f, 0.f, z == 0 ? side : -side);
                }
        EXPECT_TRUE(flippedOf(cloud).empty()) << side;
    }
}

/// Beside edges, too, though few points are there to ask.
TEST(FlippedNormals, EveryFifthIsTurnedBack)
{
    constexpr std::size_t kPoints = 30000;
    for (const char* solid : {"sphere(1)", "blob(1,8,0.05)", "torus(1,0.3)", "fandisk(1)",
                              "box(1,1,1)", "gear(12,1,0.3)"})
        for (const double noise : {0.0, 0.002}) {
            PointCloud cloud = scanned(solid, kPoints, Pattern::Random, noise);
            const std::vector<Vec3f> truth = cloud.normals;
            std::mt19937 engine(kSeed);
            for (Vec3f& n : cloud.normals)
                if (engine() % 5 == 0) n = -n;
            const auto flipped = flippedOf(cloud);
            flipNormals(cloud, flipped);
            std::size_t wrong = 0;
            for (std::size_t i = 0; i < truth.size(); ++i)
                wrong += truth[i].dot(cloud.normals[i]) < 0;
            EXPECT_LT(wrong, kPoints / 2000) << solid << ", noise " << noise << ", seed " << kSeed;
            tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
            PointCloud again = cloud;
            flipNormals(again, flipped);
            EXPECT_EQ(flippedOf(again), flipped) << solid;
        }
}

TEST(FlippedNormals, PatchesAreTurnedBack)
{
    PointCloud cloud = scanned("blob(1,8,0.05)", 30000, Pattern::Even);
    const Vec3f middle = cloud.positions[100];
    std::vector<std::uint32_t> patch;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if ((cloud.positions[i] - middle).norm() < 0.3f) patch.push_back(i);
    ASSERT_GT(patch.size(), 300u);
    flipNormals(cloud, patch);
    EXPECT_EQ(flippedOf(cloud), patch) << "seed " << kSeed;
}

/// The part of the points nearest to a random one, a @a share of all.
std::vector<std::uint32_t> capOf(const PointCloud& cloud, double share, std::mt19937& engine)
{
    const Vec3f middle = cloud.positions[engine() % cloud.size()];
    std::vector<std::uint32_t> cap(cloud.size());
    std::iota(cap.begin(), cap.end(), 0u);
    std::sort(cap.begin(), cap.end(), [&](std::uint32_t a, std::uint32_t b) {
        return (cloud.positions[a] - middle).squaredNorm() <
               (cloud.positions[b] - middle).squaredNorm();
    });
    cap.resize(std::size_t(share * double(cap.size())));
    return cap;
}

TEST(FlippedNormals, AreTheSameInAnyOrder)
{
    PointCloud cloud = scanned("fandisk(1)", 30000, Pattern::Scan, 0.005, 0.02);
    cloud.seenFrom.clear();
    std::mt19937 engine(11);
    for (Vec3f& n : cloud.normals)
        if (engine() % 8 == 0) n = -n;
    PointCloud other;
    std::vector<std::uint32_t> order(cloud.size());
    std::iota(order.begin(), order.end(), 0u);
    std::shuffle(order.begin(), order.end(), engine);
    for (const std::uint32_t i : order) {
        other.positions.push_back(cloud.positions[i]);
        other.normals.push_back(cloud.normals[i]);
    }
    std::vector<std::uint32_t> turned = flippedOf(other);
    for (std::uint32_t& i : turned) i = order[i];
    std::sort(turned.begin(), turned.end());
    EXPECT_GT(turned.size(), 2000u);
    EXPECT_EQ(turned, flippedOf(cloud));
}

TEST(FlippedNormals, CapsOfAllSizesAreTurnedBack)
{
    const unsigned seed = 20261121;
    std::mt19937 engine(seed);
    const struct {
        const char* solid;
        Pattern pattern;
        double noise, mostWrong; // share; along edges some stay
    } cases[] = {{"blob(1,8,0.05)", Pattern::Even, 0, 0.0005},
                 {"blob(1,8,0.05)", Pattern::Scan, 0.005, 0.001},
                 {"torus(1,0.3)", Pattern::Random, 0.003, 0.001},
                 {"slab(1,1,0.05)", Pattern::Even, 0, 0.001},
                 {"difference(cylinder(0.5,2),cylinder(0.44,3))", Pattern::Random, 0, 0.001},
                 {"difference(sphere(1),sphere(0.93))", Pattern::Random, 0, 0.001},
                 {"fandisk(1)", Pattern::Even, 0, 0.01}};
    for (const auto& c : cases) {
        PointCloud cloud = scanned(c.solid, 30000, c.pattern, c.noise);
        cloud.seenFrom.clear();
        const std::vector<Vec3f> truth = cloud.normals;
        for (const double share : {0.05, 0.15, 0.3}) {
            cloud.normals = truth;
            flipNormals(cloud, capOf(cloud, share, engine));
            flipNormals(cloud, flippedOf(cloud));
            double wrong = 0;
            for (std::size_t i = 0; i < truth.size(); ++i)
                wrong += truth[i].dot(cloud.normals[i]) < 0;
            EXPECT_LE(wrong, c.mostWrong * double(truth.size()))
                << c.solid << ' ' << share << " seed " << seed;
        }
    }
}

/// Two rooms with a wall between them that is two spacings thin: its sides lie in the same cells,
/// and only one of them meets each room's floor.
TEST(FlippedNormals, WallsBetweenRoomsKeepTheirs)
{
    for (const unsigned seed : {11, 14, 24, 32}) {
        const double at = 0.02 * ((seed - 1) % 10) - 0.1; // of the wall, and so in the cells
        const double left = 4.7 + at, right = 4.7 - at;
        const auto room = [](double width, double middle) {
            return fmt::format("translate(box({},7.6,2.6),{},0,0)", width, middle);
        };
        const auto door = [](double wall) {
            return fmt::format("translate(box(0.4,1,2),{},-0.5,-0.3)", wall);
        };
        PointCloud cloud = scanned(
            fmt::format("difference(box(10,8,3),{},{},{},{})", room(left, at - 0.1 - left / 2),
                        room(right, at + 0.1 + right / 2), door(at), door(-4.9)),
            60000, Pattern::Random, 0);
        cloud.seenFrom.clear();
        test::Random random(seed);
        for (int n = 0; n < 600; ++n) { // outliers, of which some are not found
            const Vec3d any = random.inCube(1).cwiseProduct(Vec3d(7, 6, 3.5));
            cloud.positions.push_back((any - cloud.frame).cast<float>());
            cloud.normals.push_back(random.direction().cast<float>());
        }
        Interrupter progress;
        EXPECT_LE(clean(cloud, {}, &progress).flipped, 100u) << "seed " << seed;
    }
}

/// Rims, folds, overlapping scans, and nothing flipped.
TEST(FlippedNormals, RealScansKeepTheirs)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    for (const char* file :
         {"bunny/bun.conf", "bunny/bun_zipper.ply", "bunny/bun270.ply", "berger/anchor_scan.ply",
          "berger/dc_scan.ply", "dragon_stand/dragonStandRight.conf",
          "dragon_stand/dragonStandRight_216.ply", "dragon_stand/dragonStandRight_312.ply",
          "cad/908460.stl"}) {
        Interrupter progress;
        PointCloud cloud =
            readPoints({std::filesystem::path(folder) / file}, BadPoints::Drop, {}, {}, &progress)
                .cloud;
        ASSERT_TRUE(cloud.hasNormals());
        EXPECT_LE(double(flippedOf(cloud).size()), 0.001 * double(cloud.size())) << file;
    }
}

TEST(FlippedNormals, ThreeFacesOfACube)
{
    PointCloud cloud = scanned("box(1,1,1)", 30000, Pattern::Even);
    std::vector<std::uint32_t> faces;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if (cloud.normals[i].sum() > 0) faces.push_back(i);
    flipNormals(cloud, faces);
    flipNormals(cloud, flippedOf(cloud));
    std::size_t inward = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        inward += cloud.normals[i].dot(cloud.positions[i]) < 0;
    EXPECT_LT(inward, 90u);
}

/// Walls are told of that so few points, or such noise, cannot hold apart, and no others.
TEST(Clean, WallsTooThinForThePointsAreSaid)
{
    constexpr double kPoints = 4000;
    const double spacing = std::sqrt(2 / kPoints); // of both sides of a plate of 1 x 1
    const struct {
        double spacings, noise; // of the wall; standard deviation in spacings
        bool bare, isSaid;
    } cases[] = {{1.2, 0, false, true}, {3, 0, false, false},   {3, 0.5, false, false},
                 {3, 0.5, true, true},  {3, 0.05, true, false}, {12, 0.5, true, false}};
    for (const auto& c : cases) {
        PointCloud cloud = scanned(fmt::format("slab(1,1,{})", c.spacings * spacing),
                                   std::uint64_t(kPoints), Pattern::Random, c.noise * spacing);
        cloud.seenFrom.clear();
        if (c.bare) cloud.normals.clear();
        Interrupter progress;
        EXPECT_EQ(!clean(cloud, {}, &progress).tooThin().empty(), c.isSaid)
            << c.spacings << ' ' << c.noise << ' ' << c.bare << " seed " << kSeed;
    }
}

} // namespace
} // namespace mpuvdb
