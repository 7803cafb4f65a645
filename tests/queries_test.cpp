// Questions to level sets, against exact distances and each other.
#include "solid_level_set.h"

#include <mpuvdb/queries.h>
#include <mpuvdb/shape.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace mpuvdb::test
{
namespace
{

/// A ball of @a radius about a place that is no voxel.
struct Ball {
    Vec3d center{0.31, -0.17, 0.23};
    double radius = 1;
    LevelSet levelSet;

    explicit Ball(double voxelSize, double halfWidth = 3)
        : levelSet(Shape(makeSolidField(parseSolid("sphere(1)")), "ball")
                       .moved(Eigen::Affine3d(Eigen::Translation3d(center)))
                       .evaluate({voxelSize, halfWidth, 0}))
    {
    }

    double distance(const Vec3d& p) const { return (p - center).norm() - radius; }
};

/// A turned box with its exact distance.
struct TurnedBox {
    Vec3d half{1, 0.7, 0.5};
    Eigen::Affine3d turn{Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized())};
    Shape shape = Shape(makeSolidField(parseSolid("box(2,1.4,1)")), "box").moved(turn);

    double distance(const Vec3d& p) const
    {
        const Vec3d d = (turn.inverse() * p).cwiseAbs() - half;
        return d.cwiseMax(0).norm() + std::min(0.0, d.maxCoeff());
    }
};

std::vector<Vec3d> randomPlaces(double reach, std::size_t count, std::uint64_t seed = 1)
{
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> in(-reach, reach);
    std::vector<Vec3d> places(count);
    for (Vec3d& p : places) p = Vec3d(in(random), in(random), in(random));
    return places;
}

std::vector<double> distancesOf(const Queries& queries, const NumberView& places)
{
    std::vector<double> distances(places.rows);
    queries.distances(places, distances.data());
    return distances;
}

/// Quantiles of the errors of distances, in the order of @a shares.
template <class Exact>
std::vector<double> errorQuantiles(const std::vector<Vec3d>& places,
                                   const std::vector<double>& distances, const Exact& exact,
                                   const std::vector<double>& shares)
{
    std::vector<double> errors;
    for (std::size_t i = 0; i < places.size(); ++i)
        errors.push_back(std::abs(distances[i] - exact.distance(places[i])));
    std::sort(errors.begin(), errors.end());
    std::vector<double> found;
    for (const double share : shares)
        found.push_back(errors[std::size_t(share * double(errors.size() - 1))]);
    return found;
}

TEST(QueriesTest, DistancesToABallAreExactEverywhere)
{
    for (const double voxelSize : {1 / 10.0, 1 / 20.0, 1 / 40.0}) {
        const Ball ball(voxelSize);
        // Near the surface, far from it, and about the center, where there is a singularity.
        const auto places = randomPlaces(3, 20000);
        const auto distances = distancesOf(Queries(ball.levelSet), places);
        const auto errors = errorQuantiles(places, distances, ball, {0.5, 0.99, 1});
        // Cubic interpolation leaves the third power of the voxel size, by derivatives of 1 / r^2.
        const double unit = std::pow(voxelSize, 3) + 1e-6;
        EXPECT_LT(errors[0], 0.02 * unit) << voxelSize;
        EXPECT_LT(errors[1], 0.2 * unit) << voxelSize;
        // Beside the center all of the surface is equally near: the triangles' own error.
        EXPECT_LT(errors[2], voxelSize * voxelSize / 4) << voxelSize;
    }
}

TEST(QueriesTest, DistancesInTheBandConvergeByTheThirdOrder)
{
    std::vector<double> means;
    for (const double voxelSize : {1 / 8.0, 1 / 16.0, 1 / 32.0}) {
        const Ball ball(voxelSize);
        std::vector<Vec3d> places;
        for (const Vec3d& p : randomPlaces(1.5, 200000))
            if (std::abs(ball.distance(p)) < 2 * voxelSize) places.push_back(p);
        const auto distances = distancesOf(Queries(ball.levelSet), places);
        double sum = 0;
        for (std::size_t i = 0; i < places.size(); ++i)
            sum += std::abs(distances[i] - ball.distance(places[i]));
        means.push_back(sum / double(places.size()));
    }
    EXPECT_GT(std::log2(means[0] / means[1]), 2.5);
    EXPECT_GT(std::log2(means[1] / means[2]), 2.5);
}

TEST(QueriesTest, CreasesAreRightInsideAndOutside)
{
    const TurnedBox box;
    constexpr double kVoxel = 0.04;
    const LevelSet levelSet = box.shape.evaluate({kVoxel, 3, 0});
    const auto places = randomPlaces(1.6, 50000);
    // With the field creases are exact but for floats; without it they come from the values.
    const auto exact =
        errorQuantiles(places, distancesOf(Queries(levelSet, box.shape.field()), places), box,
                       {0.5, 0.99, 0.999, 1});
    EXPECT_LT(exact[0], 1e-6);
    EXPECT_LT(exact[1], 2e-3 * kVoxel);
    EXPECT_LT(exact[2], 0.05 * kVoxel);
    EXPECT_LT(exact[3], 0.2 * kVoxel);
    const auto from =
        errorQuantiles(places, distancesOf(Queries(levelSet), places), box, {0.5, 0.99, 1});
    EXPECT_LT(from[0], 1e-6);
    EXPECT_LT(from[1], 0.1 * kVoxel);
    EXPECT_LT(from[2], 0.4 * kVoxel);
}

/// Places up to two voxels from the surface of @a exact.
template <class Exact>
std::vector<Vec3d> placesBeside(const Exact& exact, double reach, double voxelSize)
{
    std::vector<Vec3d> places;
    for (const Vec3d& p : randomPlaces(reach, 400000))
        if (std::abs(exact.distance(p)) < 2 * voxelSize) places.push_back(p);
    return places;
}

TEST(QueriesTest, EdgesAndCornersOfPlanesAreExact)
{
    constexpr double kVoxel = 0.04, kFloats = 1e-5;
    const TurnedBox box;
    const auto places = placesBeside(box, 1.4, kVoxel);
    std::vector<double> beside = distancesOf(Queries(box.shape.evaluate({kVoxel, 3, 0})), places);
    auto errors = errorQuantiles(places, beside, box, {0.99, 0.999});
    EXPECT_LT(errors[0], 1e-3 * kVoxel + kFloats);
    EXPECT_LT(errors[1], 5e-3 * kVoxel); // cells beside creases where interpolation is cubic
    // As a cavity, whose complement is convex.
    const Shape ball(makeSolidField(parseSolid("sphere(2)")), "ball");
    const LevelSet cavity = (ball - box.shape).evaluate({kVoxel, 3, 0});
    beside = distancesOf(Queries(cavity), places);
    for (double& distance : beside) distance = -distance;
    errors = errorQuantiles(places, beside, box, {0.99, 0.999});
    EXPECT_LT(errors[0], 1e-3 * kVoxel + kFloats);
    EXPECT_LT(errors[1], 5e-3 * kVoxel);
}

TEST(QueriesTest, GradientsAboutEdgesLeadToTheSurface)
{
    constexpr double kVoxel = 0.04;
    const TurnedBox box;
    const auto places = placesBeside(box, 1.4, kVoxel);
    std::vector<Vec3d> feet(places.size());
    Queries(box.shape.evaluate({kVoxel, 3, 0})).closestPoints(places, feet.data());
    std::vector<double> off;
    for (const Vec3d& foot : feet) off.push_back(std::abs(box.distance(foot)));
    std::sort(off.begin(), off.end());
    EXPECT_LT(off[off.size() * 99 / 100], 2e-3 * kVoxel);
    EXPECT_LT(off[off.size() * 999 / 1000], 0.02 * kVoxel);
}

TEST(QueriesTest, BesideCurvedCreasesOneSideAnswers)
{
    /// A cylinder about the z axis.
    struct Cylinder {
        double radius = 1, half = 0.7;

        double distance(const Vec3d& p) const
        {
            const double beside = std::hypot(p[0], p[1]) - radius, above = std::abs(p[2]) - half;
            return std::hypot(std::max(beside, 0.0), std::max(above, 0.0)) +
                   std::min(0.0, std::max(beside, above));
        }
    };
    constexpr double kVoxel = 0.04;
    const Shape shape(makeSolidField(parseSolid("cylinder(1,1.4)")), "cylinder");
    const auto places = placesBeside(Cylinder(), 1.4, kVoxel);
    const auto distances = distancesOf(Queries(shape.evaluate({kVoxel, 3, 0})), places);
    const auto errors = errorQuantiles(places, distances, Cylinder(), {0.5, 0.99, 0.999});
    // Parabolas err by a sixteenth of third differences, which are below 0.1 voxel, and edges of
    // triangles of a voxel along the rim by their sagitta.
    EXPECT_LT(errors[0], 1e-4 * kVoxel);
    EXPECT_LT(errors[1], 0.1 / 16 * 2 * kVoxel + kVoxel * kVoxel / 8);
    EXPECT_LT(errors[2], 0.1 * kVoxel);
    // A ball of five voxels: triangles, whose edges are up to sqrt(3) long, are off by a sagitta.
    const Ball ball(0.2);
    const auto near = placesBeside(ball, 1.6, 0.2);
    const auto small =
        errorQuantiles(near, distancesOf(Queries(ball.levelSet), near), ball, {0.99, 0.999});
    EXPECT_LT(small[0], 0.1 / 8 * 0.2);
    EXPECT_LT(small[1], 3 * 0.2 * 0.2 / 8);
}

TEST(QueriesTest, GradientsAreUnitAndLeadToTheSurface)
{
    const Ball ball(0.05);
    const Queries queries(ball.levelSet);
    const auto places = randomPlaces(2, 20000);
    std::vector<double> distances(places.size());
    std::vector<Vec3d> gradients(places.size()), closest(places.size());
    queries.distances(places, distances.data(), gradients.data());
    queries.closestPoints(places, closest.data());
    for (std::size_t i = 0; i < places.size(); ++i) {
        ASSERT_NEAR(gradients[i].norm(), 1, 1e-5);
        ASSERT_LT((places[i] - distances[i] * gradients[i] - closest[i]).norm(), 1e-9);
        // At most three voxels away along a gradient that errs by the square of the voxel size.
        ASSERT_NEAR(ball.distance(closest[i]), 0, 5e-3 * 0.05);
        if ((places[i] - ball.center).norm() < 0.1) continue;
        // A gradient errs by the square of the voxel size.
        const Vec3d outward = (places[i] - ball.center).normalized();
        ASSERT_LT((gradients[i] - outward).norm(),
                  2 * std::pow(0.05 / (places[i] - ball.center).norm(), 2))
            << i;
    }
}

TEST(QueriesTest, OnTheSurfaceGradientsAreNormals)
{
    const Ball ball(0.05);
    const Queries queries(ball.levelSet);
    std::vector<Vec3d> places = randomPlaces(2, 1000), surface(1000), normals(1000);
    queries.closestPoints(places, surface.data());
    std::vector<double> distances(1000);
    queries.distances(surface, distances.data(), normals.data());
    for (std::size_t i = 0; i < surface.size(); ++i) {
        ASSERT_NEAR(distances[i], 0, 5e-3 * 0.05);
        ASSERT_GT(normals[i].dot((surface[i] - ball.center).normalized()), 0.999);
    }
}

TEST(QueriesTest, ContainsIsTheSignOfTheDistance)
{
    const TurnedBox box;
    const Queries queries(box.shape.evaluate({0.04, 3, 0}), box.shape.field());
    const auto places = randomPlaces(1.6, 50000);
    std::vector<std::uint8_t> inside(places.size());
    queries.contains(places, inside.data());
    for (std::size_t i = 0; i < places.size(); ++i)
        if (std::abs(box.distance(places[i])) > 1e-3 * 0.04) {
            ASSERT_EQ(inside[i], box.distance(places[i]) < 0) << places[i].transpose();
        }
}

TEST(QueriesTest, SameBitsForAnyOrderTypeAndNumberOfThreads)
{
    const TurnedBox box;
    const Queries queries(box.shape.evaluate({0.05, 3, 0}));
    auto places = randomPlaces(1.5, 100000);
    // Numbers that are floats, too.
    for (Vec3d& p : places) p = p.cast<float>().cast<double>();
    const auto expected = distancesOf(queries, places);
    {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 1);
        EXPECT_EQ(distancesOf(queries, places), expected);
    }
    std::vector<std::size_t> order(places.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        const auto key = [&](std::size_t i) {
            return std::array<double, 3>{std::floor(places[i][0]), std::floor(places[i][1]),
                                         places[i][2]};
        };
        return key(a) < key(b);
    });
    std::vector<Vec3f> sorted;
    for (const std::size_t i : order) sorted.push_back(places[i].cast<float>());
    const auto distances = distancesOf(queries, sorted);
    for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(distances[i], expected[order[i]]);
    // One place at a time.
    for (std::size_t i = 0; i < 50; ++i)
        EXPECT_EQ(distancesOf(queries, std::vector<Vec3d>{places[i]}).front(), expected[i]);
}

TEST(QueriesTest, RaysMeetABall)
{
    const double voxelSize = 0.05;
    const Ball ball(voxelSize);
    const Queries queries(ball.levelSet);
    const auto origins = randomPlaces(3, 20000, 2);
    auto directions = randomPlaces(1, 20000, 3);
    std::vector<double> hits(origins.size());
    std::vector<Vec3d> normals(origins.size());
    queries.raycast(origins, directions, hits.data(), normals.data());
    std::size_t met = 0;
    for (std::size_t i = 0; i < origins.size(); ++i) {
        const Vec3d o = origins[i] - ball.center, d = directions[i];
        const double a = d.squaredNorm(), b = o.dot(d), c = o.squaredNorm() - 1;
        const double root = b * b - a * c;
        const double first = root < 0 ? HUGE_VAL : (-b - std::sqrt(root)) / a;
        const double second = root < 0 ? HUGE_VAL : (-b + std::sqrt(root)) / a;
        const double exact = first >= 0 ? first : second >= 0 ? second : HUGE_VAL;
        // A ray that grazes the ball may pass by its triangles, which lie inside.
        const double nearest = (o - b / a * d).norm();
        if (std::abs(nearest - 1) < 0.1 * voxelSize) continue;
        ASSERT_EQ(std::isfinite(hits[i]), std::isfinite(exact)) << i;
        if (!std::isfinite(exact)) {
            EXPECT_TRUE(normals[i].array().isNaN().all());
            continue;
        }
        ++met;
        ASSERT_NEAR(ball.distance(origins[i] + hits[i] * d), 0, 0.02 * voxelSize) << i;
        ASSERT_NEAR(std::abs(hits[i] - exact) * std::sqrt(a), 0, voxelSize) << i;
        ASSERT_GT(normals[i].dot((o + hits[i] * d).normalized()), 0.99);
    }
    EXPECT_GT(met, 1000u);
}

TEST(QueriesTest, RaysThroughEdgesOfTrianglesFindNoGaps)
{
    // Voxels and triangles are symmetric about the axes: these rays run along edges and through
    // vertices.
    const LevelSet levelSet = solidLevelSet("box(2,2,2)", 0.125);
    const Queries queries(levelSet);
    std::vector<Vec3d> origins, directions;
    for (int i = -12; i <= 12; ++i)
        for (int j = -12; j <= 12; ++j)
            for (int axis = 0; axis < 3; ++axis) {
                Vec3d origin(i / 16.0, j / 16.0, 5), direction(0, 0, -2);
                std::rotate(origin.data(), origin.data() + axis, origin.data() + 3);
                std::rotate(direction.data(), direction.data() + axis, direction.data() + 3);
                origins.push_back(origin);
                directions.push_back(direction);
            }
    std::vector<double> hits(origins.size());
    queries.raycast(origins, directions, hits.data());
    for (std::size_t i = 0; i < hits.size(); ++i) ASSERT_NEAR(hits[i], 2, 1e-5) << i;
    for (Vec3d& d : directions) d = -d;
    queries.raycast(origins, directions, hits.data());
    for (const double hit : hits) ASSERT_EQ(hit, HUGE_VAL);
    // From within.
    const std::vector<Vec3d> middle(1, Vec3d::Zero()), up(1, Vec3d(0, 0.5, 0));
    queries.raycast(middle, up, hits.data());
    EXPECT_NEAR(hits.front(), 2, 1e-5);
}

TEST(QueriesTest, EmptyLevelSetsAndPlacesThatAreNotFinite)
{
    const double infinite = HUGE_VAL, nan = std::nan("");
    const std::vector<Vec3d> places = {{0, 0, 0}, {nan, 0, 0}, {0, infinite, 0}, {1e300, 0, 0}};
    const Queries nothing(emptyLevelSet(0.1));
    EXPECT_EQ(distancesOf(nothing, places)[0], infinite);
    EXPECT_TRUE(std::isnan(distancesOf(nothing, places)[1]));
    std::vector<Vec3d> closest(4);
    nothing.closestPoints(places, closest.data());
    EXPECT_TRUE(closest[0].array().isNaN().all());
    std::vector<double> hits(4);
    nothing.raycast(places, std::vector<Vec3d>(4, Vec3d(1, 0, 0)), hits.data());
    EXPECT_EQ(hits[0], infinite);

    const openvdb::FloatGrid::Ptr outside = Ball(0.1).levelSet.grid().deepCopy();
    for (auto at = outside->beginValueAll(); at; ++at) at.setValue(std::abs(*at));
    const std::vector<Vec3d> far = {Vec3d(9, 0, 0)};
    EXPECT_EQ(distancesOf(Queries(LevelSet(outside)), far)[0], infinite);

    const Queries ball(Ball(0.1).levelSet);
    const auto distances = distancesOf(ball, places);
    EXPECT_NEAR(distances[0], Ball(0.5).distance(places[0]), 1e-4);
    EXPECT_TRUE(std::isnan(distances[1]) && std::isnan(distances[2]));
    EXPECT_GT(distances[3], 1e299);
    const Vec3d away = Vec3d(0.6, 0, 0.8);
    const std::vector<Vec3d> veryFar = {1e10 * away, 1e20 * away, 1e300 * away, {nan, 0, 0}};
    ball.closestPoints(veryFar, closest.data());
    for (std::size_t n = 0; n < 3; ++n)
        EXPECT_LT((closest[n] - Ball(0.5).center - away).norm(), 2e-3) << n;
    EXPECT_TRUE(closest[3].array().isNaN().all());
    std::vector<std::uint8_t> inside(4);
    ball.contains(places, inside.data());
    EXPECT_EQ(inside, (std::vector<std::uint8_t>{1, 0, 0, 0}));
    EXPECT_TRUE(distancesOf(ball, std::vector<Vec3d>()).empty());
}

TEST(QueriesTest, PartsThatAreFarApart)
{
    constexpr double kApart = 8e6; // voxels: a box of 2^60 blocks
    const Shape ball(makeSolidField(parseSolid("sphere(10)")), "ball");
    const Vec3d corner = Vec3d::Constant(kApart);
    const Shape other = ball.moved(Eigen::Affine3d(Eigen::Translation3d(corner)));
    const std::vector<Vec3d> places = {
        {11, 0, 0}, corner + Vec3d(12, 0, 0), corner + Vec3d(0, -9, 0)};
    const auto found = distancesOf(Queries((ball | other).evaluate({1, 3, 0})), places);
    const std::vector<double> exact = {1, 2, -1};
    for (std::size_t n = 0; n < exact.size(); ++n) EXPECT_NEAR(found[n], exact[n], 0.02) << n;
}

TEST(QueriesTest, RefusesWhatIsNoPlaceOrNoDirection)
{
    const Queries ball(Ball(0.1).levelSet);
    std::vector<double> out(2);
    const std::vector<std::uint8_t> bytes(6);
    EXPECT_THROW(ball.distances(NumberView(bytes.data(), 2, 3), out.data()), UsageError);
    const std::vector<Vec3d> two(2, Vec3d(1, 0, 0)), one(1, Vec3d(1, 0, 0));
    EXPECT_THROW(ball.raycast(two, one, out.data()), UsageError);
    EXPECT_THROW(ball.raycast(two, std::vector<Vec3d>(2, Vec3d::Zero()), out.data()), UsageError);
}

TEST(QueriesTest, FarFromTheOriginTheDistancesAreThoseOfTheWorld)
{
    const Vec3d far(3e6, -2e6, 1e6);
    const LevelSet levelSet = Shape(makeSolidField(parseSolid("sphere(1)")), "ball")
                                  .moved(Eigen::Affine3d(Eigen::Translation3d(far)))
                                  .evaluate({0.05, 3, 0});
    std::vector<Vec3d> places = randomPlaces(2, 2000);
    for (Vec3d& p : places) p += far;
    const auto distances = distancesOf(Queries(levelSet), places);
    for (std::size_t i = 0; i < places.size(); ++i)
        if ((places[i] - far).norm() > 0.2) {
            ASSERT_NEAR(distances[i], (places[i] - far).norm() - 1, 3e-3 * 0.05) << i;
        }
}

TEST(QueriesTest, Stops)
{
    const Ball ball(0.02);
    const auto places = randomPlaces(3, 2000000);
    std::vector<double> distances(places.size());
    expectStops([&](Interrupter& progress) {
        Queries(ball.levelSet).distances(places, distances.data(), &progress);
    });
}

} // namespace
} // namespace mpuvdb::test
