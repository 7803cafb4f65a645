// Points from memory, and what is done to them before the fit.
#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/point_input.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>

namespace mpuvdb
{
namespace
{

PointCloud sphere(std::uint64_t points)
{
    ScanSettings settings;
    settings.points = points;
    Interrupter progress;
    return scan(*parseSolid("sphere(1)"), settings, &progress);
}

/// Points as a program may hold them.
struct Arrays {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> normals;
    std::vector<float> confidences;

    explicit Arrays(const PointCloud& cloud) : normals(cloud.normals)
    {
        for (std::size_t i = 0; i < cloud.size(); ++i) positions.push_back(cloud.world(i));
    }
    PointView view() const
    {
        PointView view(positions);
        view.normals = normals;
        view.confidences = confidences;
        return view;
    }
};

TEST(ImportPoints, AreThoseGiven)
{
    const PointCloud cloud = sphere(500);
    Arrays arrays(cloud);
    for (Vec3f& n : arrays.normals) n *= 3;
    arrays.confidences.assign(cloud.size(), 5);
    const PointInput input = importPoints(arrays.view(), "mine", BadPoints::Fail);
    ASSERT_EQ(input.cloud.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_LT((input.cloud.world(i) - cloud.world(i)).norm(), 1e-6);
        EXPECT_LT((input.cloud.normals[i] - cloud.normals[i]).norm(), 1e-6);
        EXPECT_EQ(input.cloud.confidence[i], 1);
    }
    EXPECT_TRUE(input.dropped.empty());
}

TEST(ImportPoints, LeavesOutWhatCannotBeUsed)
{
    const PointCloud cloud = sphere(500);
    Arrays arrays(cloud);
    arrays.positions[3].x() = std::numeric_limits<double>::quiet_NaN();
    arrays.normals[5].setZero();
    arrays.positions.push_back(arrays.positions[0]);
    arrays.normals.push_back(arrays.normals[0]);
    const PointInput input = importPoints(arrays.view());
    EXPECT_EQ(input.cloud.size(), cloud.size() - 2);
    const std::map<std::string, std::uint64_t> dropped = {
        {"not finite", 1}, {"zero normal", 1}, {"duplicate", 1}};
    EXPECT_EQ(input.dropped, dropped);
    EXPECT_THROW(importPoints(arrays.view(), "mine", BadPoints::Fail), InputError);
}

TEST(ImportPoints, WantsOneNormalForEach)
{
    Arrays arrays(sphere(500));
    arrays.normals.pop_back();
    EXPECT_THROW(importPoints(arrays.view()), UsageError);
    EXPECT_THROW(importPoints({}), InputError);
    arrays.normals.clear();
    PointView view = arrays.view();
    view.scalars = {{"heat", arrays.confidences}};
    EXPECT_THROW(importPoints(view), UsageError);
    view.scalars.clear();
    view.viewpoints = {Vec3d::Zero()};
    const std::vector<std::uint32_t> beyond(arrays.positions.size(), 1);
    view.seenFrom = beyond.data();
    EXPECT_THROW(importPoints(view), UsageError);
}

TEST(ImportPoints, WantsRowsOfTheRightWidth)
{
    const std::vector<float> flat = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    EXPECT_THROW(importPoints(PointView(NumberView(flat))), UsageError);
    const std::vector<std::array<float, 2>> plane(3);
    EXPECT_THROW(importPoints(PointView(plane)), UsageError);
    PointView view(NumberView(flat.data(), 3, 3));
    EXPECT_EQ(importPoints(view).cloud.size(), 3u);
    view.viewpoints = {Vec3d(0, 0, NAN)};
    EXPECT_THROW(importPoints(view), UsageError);
}

TEST(Clean, RefusesPositionsThatAreNotFinite)
{
    PointCloud cloud = sphere(100);
    cloud.positions[7][1] = NAN;
    EXPECT_THROW(clean(cloud, {}), InputError);
}

TEST(ImportPoints, KnowsTheViewpoints)
{
    const Arrays arrays(sphere(500));
    PointView view = arrays.view();
    view.viewpoints = {{0, 0, 5}, {0, 0, -5}};
    const PointCloud one = importPoints(view).cloud;
    ASSERT_EQ(one.seenFrom.size(), one.size());
    EXPECT_EQ(one.viewpoints.at(one.seenFrom[0]).place, Vec3d(0, 0, 5));
    std::vector<std::uint32_t> seenFrom;
    for (const Vec3d& p : arrays.positions) seenFrom.push_back(p.z() < 0);
    view.seenFrom = seenFrom.data();
    const PointCloud two = importPoints(view).cloud;
    ASSERT_EQ(two.seenFrom.size(), arrays.positions.size());
    for (std::size_t i = 0; i < two.size(); ++i)
        EXPECT_GE(two.viewpoints.at(two.seenFrom[i]).place.z() * two.world(i).z(), 0);
}

/// Any type, side by side or not, is read where it is.
TEST(ImportPoints, ReadsEveryLayout)
{
    struct Vertex {
        std::array<float, 3> position;
        std::array<std::uint8_t, 3> color;
        double heat;
    };
    const PointCloud cloud = sphere(300);
    std::vector<Vertex> vertices;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3f p = cloud.world(i).cast<float>();
        vertices.push_back({{p.x(), p.y(), p.z()}, {std::uint8_t(i), 7, 9}, 0.5 * double(i)});
    }
    const Vertex& first = vertices.front();
    PointView view(NumberView(first.position.data(), vertices.size(), 3, sizeof(Vertex)));
    view.colors = NumberView(first.color.data(), vertices.size(), 3, sizeof(Vertex));
    view.scalars = {{"heat", NumberView(&first.heat, vertices.size(), 1, sizeof(Vertex))}};
    const PointCloud taken = importPoints(view).cloud;
    ASSERT_EQ(taken.size(), vertices.size());
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        EXPECT_LT((taken.world(i) - cloud.world(i)).norm(), 1e-6);
        EXPECT_EQ(taken.colors[i], (Rgb{std::uint8_t(i), 7, 9}));
        EXPECT_EQ(taken.scalars[0].values[i], 0.5f * float(i));
    }
}

/// Colors of 16 bits, of bytes and in [0, 1] are one color each, as in files.
TEST(ImportPoints, ColorsAreOfTheScaleOfMost)
{
    const PointCloud cloud = sphere(300);
    std::vector<Vec3d> places;
    for (std::size_t i = 0; i < cloud.size(); ++i) places.push_back(cloud.world(i));
    for (const double full : {1.0, 255.0, 65535.0}) {
        std::vector<Vec3d> colors(places.size(), full * Vec3d(1, 0.6, 0.2));
        PointView view(places);
        view.colors = colors;
        EXPECT_EQ(importPoints(view).cloud.colors.back(), (Rgb{255, 153, 51})) << full;
        colors.front() *= 300; // a highlight
        EXPECT_EQ(importPoints(view).cloud.colors.back(), (Rgb{255, 153, 51})) << full;
    }
}

TEST(Clean, SaysWhatItDid)
{
    PointCloud cloud = sphere(5000);
    for (std::size_t i = 0; i < cloud.size(); i += 40) cloud.normals[i] *= -1;
    cloud.positions[7] *= 4;
    Interrupter progress;
    const CleanReport report = clean(cloud, {}, &progress);
    EXPECT_EQ(report.outliers, 1u);
    EXPECT_NEAR(double(report.flipped), double(cloud.size()) / 40, 2);
    EXPECT_TRUE(report.hadNormals);
    EXPECT_FALSE(report.estimateNeighbors);
    EXPECT_FALSE(report.inward);
    for (std::size_t i = 0; i < cloud.size(); ++i)
        EXPECT_GT(cloud.normals[i].dot(cloud.world(i).cast<float>()), 0);
}

/// The two sides of a thin wall are one noisy sheet until normals are known, so that points far off
/// it, in its noise, stay at first.
TEST(Clean, OutliersAboutBareThinWallsAreLeftOut)
{
    const auto room = parseSolid("difference(box(2,2,1),box(1.87,1.87,0.87))"); // 3 spacings
    ScanSettings settings;
    settings.points = 60000;
    settings.outliers = 0.02;
    Interrupter progress;
    PointCloud cloud = scan(*room, settings, &progress);
    cloud.normals.clear();
    const auto count = [&](double farther, double nearer) {
        std::size_t points = 0;
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const double distance = std::abs(room->distance(cloud.world(i)));
            points += distance >= farther && distance < nearer;
        }
        return points;
    };
    constexpr double kOn = 1e-5;
    const std::size_t on = count(0, kOn);
    const CleanReport report = clean(cloud, {}, &progress);
    const double spacing = report.statistics.spacing;
    EXPECT_GT(report.outliers, 600u);
    EXPECT_EQ(count(0, kOn), on);
    EXPECT_LT(count(4 * spacing, HUGE_VAL), 12u); // 1 % of them
    EXPECT_LT(report.statistics.noise, 0.1 * spacing);
}

TEST(Clean, DoesWhatItIsTold)
{
    PointCloud cloud = sphere(5000);
    const std::size_t count = cloud.size();
    cloud.positions[7] *= 4;
    cloud.normals[3] *= -1;
    CleanSettings settings;
    settings.dropOutliers = false;
    settings.normals = NormalsFrom::Keep;
    settings.flipNormals = true;
    Interrupter progress;
    const PointCloud before = cloud;
    CleanReport report = clean(cloud, settings, &progress);
    EXPECT_EQ(cloud.size(), count);
    // Points come in another order: their positions are all different.
    std::map<std::array<float, 3>, Vec3f> normalAt;
    const auto key = [](const Vec3f& p) { return std::array<float, 3>{p.x(), p.y(), p.z()}; };
    for (std::size_t i = 0; i < count; ++i) normalAt[key(before.positions[i])] = before.normals[i];
    ASSERT_EQ(normalAt.size(), count);
    for (std::size_t i = 0; i < count; ++i)
        EXPECT_EQ(cloud.normals[i], -normalAt.at(key(cloud.positions[i])));
    EXPECT_EQ(report.outliers + report.flipped, 0u);

    settings.flipNormals = false;
    EXPECT_TRUE(clean(cloud, settings, &progress).inward);
    settings.normals = NormalsFrom::Estimate;
    report = clean(cloud, settings, &progress);
    EXPECT_TRUE(report.estimateNeighbors);
    EXPECT_EQ(report.statistics.normalNoise, 0);
    EXPECT_FALSE(report.inward);
}

/// Terrain from a raster, of which a tenth has no data.
TEST(ImportPoints, CoordinatesThatStandForNoData)
{
    std::vector<Vec3d> places;
    for (int i = 0; i < 1000; ++i)
        places.emplace_back(i % 40, i / 40, i % 10 == 3 ? -9999 : std::sin(0.1 * i));
    const PointInput input = importPoints(PointView(places));
    EXPECT_EQ(input.dropped.at("no data (z = -9999)"), 100u);
    EXPECT_EQ(input.cloud.size(), 900u);
    places.emplace_back(-32768, 2, 3);
    EXPECT_EQ(importPoints(PointView(places)).dropped.at("no data (x = -32768, z = -9999)"), 101u);
    try {
        importPoints(PointView(places), "terrain.asc", BadPoints::Fail);
        FAIL();
    } catch (const InputError& error) {
        const std::string what = error.what();
        EXPECT_NE(what.find("point 3: no data (x = -32768, z = -9999) (101 of 1001 like it)"),
                  std::string::npos)
            << what;
    }
}

/// Two per cent that were not seen, with a height of their own; no program has it for no data.
TEST(ImportPoints, CoordinatesThatMayStandForNoDataAreTold)
{
    for (const double none : {0.0, -99.0, 9999.0}) {
        std::vector<Vec3d> places;
        for (int i = 0; i < 1000; ++i)
            places.emplace_back(i % 40, i / 40, i % 50 == 3 ? none : 80 + 10 * std::sin(0.1 * i));
        const PointInput input = importPoints(PointView(places));
        EXPECT_EQ(input.cloud.size(), 1000u);
        ASSERT_FALSE(input.warnings.empty());
        EXPECT_NE(
            input.warnings[0].find("20 of its points have z = " + std::to_string(int(none)) + ","),
            std::string::npos)
            << input.warnings[0];
        // Two shelves, a box's bottom, and one point far away.
        for (Vec3d& place : places) place[2] = place[2] == none ? none : 80;
        EXPECT_TRUE(importPoints(PointView(places)).warnings.empty());
        for (Vec3d& place : places)
            place[2] = place[2] == none ? 0 : 1 + 30 * std::abs(std::sin(place[0]));
        EXPECT_TRUE(importPoints(PointView(places)).warnings.empty());
    }
}

/// The same numbers among others, and as the bottom of a box.
TEST(ImportPoints, CoordinatesThatAreData)
{
    std::vector<Vec3d> places;
    for (int i = 0; i < 1000; ++i) places.emplace_back(i % 40, i / 40, -9500 - i);
    EXPECT_EQ(importPoints(PointView(places)).cloud.size(), 1000u);
    for (Vec3d& place : places) place[2] = place[2] < -10000 ? -9999 : 0;
    EXPECT_EQ(importPoints(PointView(places)).dropped.count("no data (z = -9999)"), 0u);
}

} // namespace
} // namespace mpuvdb
