#include "scanned_cloud.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace mpuvdb
{
namespace
{

PointCloud sample(const std::string& solid, std::uint64_t points, double noise = 0,
                  Pattern pattern = Pattern::Random)
{
    ScanSettings s;
    s.points = points;
    s.pattern = pattern;
    s.noise = noise;
    Interrupter progress;
    return scan(*parseSolid(solid), s, &progress);
}

PointStatistics measured(const PointCloud& cloud)
{
    Interrupter progress;
    return measure(cloud, &progress);
}

PointCloud shuffled(const PointCloud& cloud, std::vector<std::size_t>& order)
{
    order.resize(cloud.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::mt19937 engine(3);
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[engine() % i]);
    PointCloud result;
    result.frame = cloud.frame;
    for (const std::size_t i : order) {
        result.positions.push_back(cloud.positions[i]);
        if (cloud.hasNormals()) result.normals.push_back(cloud.normals[i]);
    }
    return result;
}

TEST(PointCloud, LocalBoundsAreTight)
{
    PointCloud cloud;
    EXPECT_TRUE(cloud.localBounds().isEmpty());
    cloud.frame = Vec3d(5e6, 0, 0);
    cloud.positions = {Vec3f(1, -2, 3), Vec3f(-1, 5, 0.5f)};
    EXPECT_EQ(cloud.localBounds().min(), Vec3d(-1, -2, 0.5));
    EXPECT_EQ(cloud.localBounds().max(), Vec3d(1, 5, 3));
}

TEST(Measure, SpacingOfAGridIsItsStep)
{
    // The twelve nearest of a grid point reach to two steps: sqrt(pi/12) * 2 = 1.023.
    const PointStatistics s = measured(planeGrid(200, 0.25f));
    EXPECT_NEAR(s.spacing, 0.25, 0.01);
    EXPECT_LT(s.noise, 1e-9);
}

TEST(Measure, SpacingIsTheRootOfTheAreaPerPoint)
{
    const PointStatistics s = measured(sample("sphere(1)", 20000, 0, Pattern::Even));
    EXPECT_NEAR(s.spacing, std::sqrt(4 * M_PI / 20000), 0.05 * s.spacing);
}

// However few of so many points are asked, their noise fills the ball that holds them.
TEST(Measure, EndsWherePointsShowNoSurface)
{
    PointCloud cloud;
    std::mt19937 engine(11);
    std::uniform_real_distribution<float> coordinate(-1, 1);
    while (cloud.size() < 60000)
        cloud.positions.emplace_back(coordinate(engine), coordinate(engine), coordinate(engine));
    const PointStatistics s = measured(cloud);
    EXPECT_GT(s.noise, 0.1);
    EXPECT_LT(s.noise, 1);
}

TEST(Measure, NoiseIsThatOfTheSurface)
{
    for (const char* solid : {"sphere(1)", "torus(1,0.3)", "box(2,2,1)", "blob(1,8,0.05)"}) {
        const PointStatistics clean = measured(sample(solid, 10000));
        EXPECT_LT(clean.noise, 0.03 * clean.spacing) << solid;
        for (const double share : {0.05, 0.3, 1.0, 3.0}) {
            const double noise = share * clean.spacing;
            const PointStatistics s = measured(sample(solid, 10000, noise));
            EXPECT_NEAR(s.noise, noise, 0.25 * noise) << solid << " " << share << " spacings";
        }
    }
}

TEST(Measure, OutliersHardlyDisturb)
{
    ScanSettings s;
    s.points = 20000;
    s.outliers = 0.1;
    s.noise = 0.01;
    Interrupter progress;
    const PointStatistics m = measured(scan(*parseSolid("torus(1,0.3)"), s, &progress));
    EXPECT_NEAR(m.noise, 0.01, 0.0025);
}

TEST(Measure, KnowsNoOrderNoThreadsNoDuplicatesAndNoFrame)
{
    const PointCloud cloud = sample("blob(1,8,0.05)", 40000, 0.005);
    const PointStatistics one = measured(cloud);
    const auto expectSame = [&](const PointCloud& other) {
        const PointStatistics s = measured(other);
        EXPECT_EQ(s.spacing, one.spacing);
        EXPECT_EQ(s.noise, one.noise);
    };
    std::vector<std::size_t> order;
    expectSame(shuffled(cloud, order));
    for (const std::size_t threads : {1u, 8u}) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        expectSame(cloud);
    }
    PointCloud far = cloud;
    far.frame += Vec3d(5e6, 5e6, 5e6);
    expectSame(far);
    PointCloud twice = cloud;
    twice.positions.insert(twice.positions.end(), cloud.positions.begin(), cloud.positions.end());
    twice.normals.insert(twice.normals.end(), cloud.normals.begin(), cloud.normals.end());
    // Fewer distinct points are chosen; they still see distinct neighbors only.
    EXPECT_NEAR(measured(twice).spacing, one.spacing, 0.03 * one.spacing);
}

TEST(Measure, DensityMayVary)
{
    // A dense and a sparse plane: the median is the dense one's, which has most points.
    PointCloud cloud = planeGrid(300, 0.01f);
    for (const Vec3f& p : planeGrid(30, 1.0f).positions)
        cloud.positions.push_back(p + Vec3f(0, 0, 50));
    EXPECT_NEAR(measured(cloud).spacing, 0.01, 0.0005);
}

TEST(Measure, AttributesAreOnePerPointOrNone)
{
    PointCloud cloud = sample("sphere(1)", 1000);
    cloud.normals.pop_back();
    EXPECT_THROW(measured(cloud), UsageError);
    cloud.normals.clear();
    EXPECT_NO_THROW(measured(cloud));
    cloud.scalars = {{"heat", std::vector<float>(999)}};
    EXPECT_THROW(measured(cloud), UsageError);
}

/// Exact nearest neighbors decide: spacing computed by brute force over all points.
TEST(Measure, NeighborsAreThoseOfBruteForce)
{
    const PointCloud cloud = sample("torus(1,0.3)", 700); // fewer than are chosen: all
    std::vector<double> spacings;
    for (const Vec3f& p : cloud.positions) {
        std::vector<double> squared;
        for (const Vec3f& q : cloud.positions)
            squared.push_back((q.cast<double>() - p.cast<double>()).squaredNorm());
        std::nth_element(squared.begin(), squared.begin() + 12, squared.end());
        spacings.push_back(std::sqrt(M_PI / 12) * std::sqrt(squared[12]));
    }
    const auto middle = spacings.begin() + (spacings.size() - 1) / 2;
    std::nth_element(spacings.begin(), middle, spacings.end());
    EXPECT_DOUBLE_EQ(measured(cloud).spacing, *middle);
}

/// Share of estimated normals within @a degrees of the true ones.
double shareRight(const std::string& solid, std::uint64_t points, double noise, double degrees,
                  Pattern pattern = Pattern::Even)
{
    PointCloud cloud = sample(solid, points, noise, pattern);
    const std::vector<Vec3f> truth = cloud.normals;
    cloud.normals.clear();
    Interrupter progress;
    estimateNormals(cloud, {}, &progress);
    double right = 0;
    const float cosine = float(std::cos(degrees * M_PI / 180));
    for (std::size_t i = 0; i < truth.size(); ++i) {
        EXPECT_NEAR(cloud.normals[i].norm(), 1, 1e-5);
        right += truth[i].dot(cloud.normals[i]) > cosine;
    }
    return right / double(truth.size());
}

TEST(EstimateNormals, FindsThoseOfSmoothSolids)
{
    EXPECT_EQ(shareRight("sphere(1)", 5000, 0, 5), 1);
    EXPECT_EQ(shareRight("torus(1,0.3)", 5000, 0, 10), 1);
    EXPECT_EQ(shareRight("sphere(1)", 5000, 0, 20, Pattern::Random), 1);
    EXPECT_GT(shareRight("torus(1,0.3)", 10000, 0.01, 30), 0.99);
}

TEST(EstimateNormals, OrientsAcrossEdgesAndThinWalls)
{
    // A point on an edge may take either face's normal; none may look inward.
    EXPECT_EQ(shareRight("box(1,1,1)", 5000, 0, 91), 1);
    EXPECT_GT(shareRight("slab(1,1,0.05)", 10000, 0, 91), 0.998);
    EXPECT_GT(shareRight("slab(1,1,0.05)", 10000, 0, 10), 0.92);
    EXPECT_GT(shareRight("fandisk(1)", 20000, 0, 89), 0.995);
}

TEST(EstimateNormals, EveryPartLooksOutward)
{
    EXPECT_GT(shareRight("union(translate(sphere(1),-2,0,0),translate(box(1,1,1),2,0,0),"
                         "translate(torus(1,0.3),0,4,0))",
                         9000, 0, 91),
              0.999);
}

TEST(EstimateNormals, KnowsNoOrderAndNoThreads)
{
    PointCloud cloud = sample("fandisk(1)", 5000, 0.002);
    cloud.positions.insert(cloud.positions.end(), cloud.positions.begin(),
                           cloud.positions.begin() + 100); // duplicates
    cloud.normals.clear();
    std::vector<std::size_t> order;
    PointCloud other = shuffled(cloud, order);
    Interrupter progress;
    {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
        estimateNormals(cloud, 12, &progress);
    }
    estimateNormals(other, 12, &progress);
    for (std::size_t i = 0; i < order.size(); ++i)
        ASSERT_EQ(other.normals[i], cloud.normals[order[i]]);
}

struct TriangleMesh {
    std::vector<Vec3f> positions;
    std::vector<std::array<std::uint32_t, 3>> triangles;
};

TriangleMesh cube()
{
    TriangleMesh m;
    for (int i = 0; i < 8; ++i)
        m.positions.emplace_back(i & 1 ? 1.f : -1.f, i & 2 ? 1.f : -1.f, i & 4 ? 1.f : -1.f);
    const std::uint32_t quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& q : quads) {
        m.triangles.push_back({q[0], q[1], q[2]});
        m.triangles.push_back({q[0], q[2], q[3]});
    }
    return m;
}

/// A cube whose faces are cut into n x n squares, blown up to the unit sphere.
TriangleMesh sphereMesh(int n)
{
    TriangleMesh m;
    for (int axis = 0; axis < 3; ++axis)
        for (const float side : {-1.f, 1.f}) {
            const auto base = std::uint32_t(m.positions.size());
            for (int i = 0; i <= n; ++i)
                for (int j = 0; j <= n; ++j) {
                    Vec3f p;
                    p[axis] = side;
                    p[(axis + 1) % 3] = side * (2 * float(i) / float(n) - 1);
                    p[(axis + 2) % 3] = 2 * float(j) / float(n) - 1;
                    m.positions.push_back(p.normalized());
                }
            const auto row = std::uint32_t(n + 1);
            for (std::uint32_t i = 0; i + 1 < row; ++i)
                for (std::uint32_t j = 0; j + 1 < row; ++j) {
                    const std::uint32_t a = base + i * row + j;
                    m.triangles.push_back({a, a + row, a + row + 1});
                    m.triangles.push_back({a, a + row + 1, a + 1});
                }
        }
    return m;
}

TEST(VertexNormals, OfACubeAreDiagonal)
{
    const TriangleMesh m = cube();
    const std::vector<Vec3f> normals = vertexNormals(m.positions, m.triangles);
    // Corners 0,3,5,6 or 1,2,4,7 lie on both triangles of a face: unequal weights, same octant.
    for (std::size_t i = 0; i < 8; ++i) {
        EXPECT_NEAR(normals[i].norm(), 1, 1e-6);
        for (int axis = 0; axis < 3; ++axis)
            EXPECT_GT(normals[i][axis] * m.positions[i][axis], 0.3);
    }
}

TEST(VertexNormals, OfASphereAreRadial)
{
    const TriangleMesh m = sphereMesh(24);
    const std::vector<Vec3f> normals = vertexNormals(m.positions, m.triangles);
    for (std::size_t i = 0; i < normals.size(); ++i)
        EXPECT_GT(normals[i].dot(m.positions[i]), 0.995f);
}

TEST(VertexNormals, AreZeroWhereThereIsNone)
{
    const std::vector<Vec3f> p{Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(2, 0, 0), Vec3f(5, 5, 5)};
    for (const Vec3f& n : vertexNormals(p, {{0, 1, 2}})) EXPECT_EQ(n, Vec3f::Zero());
}

bool inwardWhenFlipped(PointCloud cloud)
{
    flipNormals(cloud);
    return pointsInward(cloud);
}

TEST(PointsInward, NoticesModelsInsideOut)
{
    for (const char* solid : {"sphere(1)", "torus(1,0.3)", "box(1,1,1)", "slab(1,1,0.02)",
                              "fandisk(1)", "gear(12,1,0.3)", "sheets(1,1,0.1)"}) {
        const PointCloud cloud = sample(solid, 20000);
        EXPECT_FALSE(pointsInward(cloud)) << solid;
        EXPECT_TRUE(inwardWhenFlipped(cloud)) << solid;
    }
    EXPECT_FALSE(pointsInward(PointCloud()));
}

TEST(PointsInward, IsNotMisledByDensity)
{
    // Ten times the points on one side.
    PointCloud cloud = sample("sphere(1)", 50000), uneven;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        if (cloud.positions[i].x() > 0.3f || i % 10 == 0) {
            uneven.positions.push_back(cloud.positions[i]);
            uneven.normals.push_back(cloud.normals[i]);
        }
    EXPECT_FALSE(pointsInward(uneven));
    EXPECT_TRUE(inwardWhenFlipped(uneven));
}

TEST(PointsInward, LeavesOpenScansAlone)
{
    PointCloud half, floor = planeGrid(50, 1);
    const PointCloud sphere = sample("sphere(1)", 20000);
    for (std::size_t i = 0; i < sphere.size(); ++i)
        if (sphere.positions[i].z() > 0) {
            half.positions.push_back(sphere.positions[i]);
            half.normals.push_back(sphere.normals[i]);
        }
    EXPECT_FALSE(pointsInward(half));
    EXPECT_FALSE(inwardWhenFlipped(half)); // a bowl
    floor.normals.assign(floor.size(), Vec3f::UnitZ());
    EXPECT_FALSE(pointsInward(floor));
    EXPECT_FALSE(inwardWhenFlipped(floor));
}

} // namespace
} // namespace mpuvdb
