// What is said of meshes: topology, angles, crossings, distances.
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cmath>
#include <random>

namespace mpuvdb::test
{
namespace
{

/// Vertices at f(u, v) for u and v in [0,1], joined at the ends where they close.
template <class F>
Mesh patch(std::uint32_t across, std::uint32_t along, bool closed, const F& f)
{
    Mesh mesh;
    const std::uint32_t m = closed ? across : across + 1, n = closed ? along : along + 1;
    for (std::uint32_t j = 0; j < n; ++j)
        for (std::uint32_t i = 0; i < m; ++i)
            mesh.positions.push_back(
                f(double(i) / across, double(j) / along).template cast<float>());
    for (std::uint32_t j = 0; j < along; ++j)
        for (std::uint32_t i = 0; i < across; ++i) {
            const auto at = [&](std::uint32_t a, std::uint32_t b) { return b % n * m + a % m; };
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    return mesh;
}

Mesh plane(std::uint32_t across, double tilt, double height)
{
    return patch(across, across, false, [=](double u, double v) {
        return Vec3d(u * std::cos(tilt), v, u * std::sin(tilt) + height);
    });
}

Mesh torus(std::uint32_t across, double small)
{
    return patch(2 * across, across, true, [=](double u, double v) {
        const double a = 2 * M_PI * u, b = 2 * M_PI * v, r = 1 + small * std::cos(b);
        return Vec3d(r * std::cos(a), r * std::sin(a), small * std::sin(b));
    });
}

/// A ball of radius 1 by longitudes and latitudes.
Mesh ballOf(std::uint32_t across)
{
    return patch(across, across / 2, false, [](double u, double v) {
        const double a = 2 * M_PI * u, b = M_PI * v;
        return Vec3d(std::sin(b) * std::cos(a), std::sin(b) * std::sin(a), std::cos(b));
    });
}

/// A box with its lowest corner at @a at.
Mesh box(const Vec3f& at, const Vec3f& size)
{
    Mesh mesh;
    for (int n = 0; n < 8; ++n)
        mesh.positions.push_back(
            at + Vec3f(float(n & 1), float(n >> 1 & 1), float(n >> 2 & 1)).cwiseProduct(size));
    mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                      {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    return mesh;
}

Mesh joined(Mesh a, const Mesh& b)
{
    const auto first = std::uint32_t(a.positions.size());
    a.positions.insert(a.positions.end(), b.positions.begin(), b.positions.end());
    for (const Mesh::Triangle& t : b.triangles)
        a.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
    return a;
}

std::uint64_t crossings(const Mesh& mesh)
{
    Interrupter progress;
    return findSelfIntersections(mesh, &progress).size();
}

TEST(MeshMeasuresTest, GenusAndAngles)
{
    const MeshReport ring = measure(torus(20, 0.3));
    EXPECT_EQ(ring.genus, 1);
    EXPECT_EQ(ring.boundaryEdges + ring.nonManifoldEdges, 0u);
    const MeshReport sheet = measure(plane(10, 0.3, 0));
    EXPECT_EQ(sheet.genus, 0);
    EXPECT_EQ(sheet.boundaryLoops, 1u);
    EXPECT_NEAR(sheet.smallestAngle, 45, 1e-4);
    EXPECT_NEAR(sheet.firstPercentileAngle, 45, 1e-4);
    EXPECT_EQ(
        measure(joined(torus(8, 0.3), joined(torus(9, 0.2), box({9, 9, 9}, {1, 1, 1})))).genus, 2);
    Mesh needles = plane(20, 0, 0); // 800 triangles
    for (int n = 0; n < 6; ++n) {
        const auto v = std::uint32_t(needles.positions.size());
        needles.positions.insert(needles.positions.end(),
                                 {Vec3f(0, 0, 5), Vec3f(1, 0, 5), Vec3f(1, 0.01f, 5)});
        needles.triangles.push_back({v, v + 1, v + 2});
    }
    EXPECT_NEAR(measure(needles).smallestAngle, std::atan(0.01) * 180 / M_PI, 1e-5);
    EXPECT_NEAR(measure(needles).firstPercentileAngle, 45, 1e-4);
    needles.triangles.resize(needles.triangles.size() + 3, {0, 0, 1});
    EXPECT_EQ(measure(needles).smallestAngle, 0);
    EXPECT_NEAR(measure(needles).firstPercentileAngle, std::atan(0.01) * 180 / M_PI, 1e-5);
}

TEST(MeshMeasuresTest, WholeSurfacesDoNotCrossThemselves)
{
    EXPECT_EQ(crossings(Mesh()), 0u);
    EXPECT_EQ(crossings(torus(60, 0.4)), 0u);
    EXPECT_EQ(crossings(plane(30, 0.7, 0)), 0u);
    // Boxes that touch along a face, an edge and a corner: nothing is inside of anything.
    for (const Vec3f& at : {Vec3f(1, 0, 0), Vec3f(1, 1, 0), Vec3f(1, 1, 1)})
        EXPECT_EQ(crossings(joined(box({0, 0, 0}, {1, 1, 1}), box(at, {1, 1, 1}))), 0u);
}

TEST(MeshMeasuresTest, CrossingsAreFound)
{
    Mesh two;
    two.positions = {Vec3f(0, 0, 0),        Vec3f(2, 0, 0),       Vec3f(0, 2, 0),
                     Vec3f(0.5f, 0.5f, -1), Vec3f(0.5f, 0.5f, 1), Vec3f(3, 3, 0)};
    two.triangles = {{0, 1, 2}, {3, 4, 5}};
    EXPECT_EQ(crossings(two), 1u);
    // One common corner, and the opposite side through the other triangle.
    two.triangles = {{0, 1, 2}, {0, 3, 4}};
    EXPECT_EQ(crossings(two), 1u);
    // The corner of one on the face of the other only touches.
    two.positions[3] = Vec3f(0.5f, 0.5f, 0);
    two.triangles = {{0, 1, 2}, {3, 4, 5}};
    EXPECT_EQ(crossings(two), 0u);
}

/// Where sides meet sides and corners there is no side that runs through an inside.
TEST(MeshMeasuresTest, CrossingsOfSymmetricSolidsAreFound)
{
    const Mesh cube = box({0, 0, 0}, {2, 2, 2});
    EXPECT_EQ(crossings(joined(cube, box({1, 1, 1}, {2, 2, 2}))), 6u);
    EXPECT_EQ(crossings(joined(cube, box({1, 1, 0}, {2, 2, 2}))), 6u);
    Mesh two;
    two.positions = {Vec3f(0, 0, 0), Vec3f(4, 0, 0),    Vec3f(0, 4, 0),
                     Vec3f(1, 1, 2), Vec3f(-1, -1, -2), Vec3f(3, 3, -2)};
    two.triangles = {{0, 1, 2}, {3, 4, 5}};
    EXPECT_EQ(crossings(two), 1u) << "from a corner to the middle of a side";
}

/// Against all pairs, each alone.
TEST(MeshMeasuresTest, TheTreeFindsWhatEveryPairSays)
{
    constexpr unsigned kSeed = 20;
    SCOPED_TRACE(kSeed);
    std::mt19937 random(kSeed);
    const auto number = [&] { return float(random() % 1000) / 1000; };
    Mesh soup;
    for (std::uint32_t t = 0; t < 150; ++t) {
        const Vec3f at(number(), number(), number());
        for (int k = 0; k < 3; ++k)
            soup.positions.push_back(at + 0.6f * Vec3f(number(), number(), number()));
        soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    std::uint64_t pairs = 0;
    for (std::size_t i = 0; i < soup.triangles.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) {
            Mesh pair = soup;
            pair.triangles = {soup.triangles[i], soup.triangles[j]};
            pairs += crossings(pair);
        }
    EXPECT_GT(pairs, 100u);
    for (const std::size_t threads : {1, 2}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        EXPECT_EQ(crossings(soup), pairs);
    }
}

TEST(MeshMeasuresTest, DistancesOfPlanes)
{
    Interrupter progress;
    const TwoWayDistances shifted = distances(plane(20, 0, 0), plane(7, 0, 0.01), &progress);
    for (const Distances& d : {shifted.there, shifted.back}) {
        EXPECT_NEAR(d.mean, 0.01, 1e-8);
        EXPECT_NEAR(d.rms, 0.01, 1e-8);
        EXPECT_NEAR(d.max, 0.01, 1e-8);
    }
    const double tilt = 0.2;
    const Distances tilted = distances(plane(20, 0, 0), plane(7, tilt, 0), &progress).there;
    EXPECT_NEAR(tilted.mean, std::sin(tilt) / 2, 1e-4);
    EXPECT_NEAR(tilted.rms, std::sin(tilt) / std::sqrt(3.0), 1e-4);
    EXPECT_NEAR(tilted.max, std::sin(tilt), 1e-6);
}

TEST(MeshMeasuresTest, WhatOneSideLacksIsFarFromTheOther)
{
    Interrupter progress;
    const Mesh cube = box({0, 0, 0}, {1, 1, 1});
    Mesh open = cube;
    open.triangles.resize(10); // without the side x = 1
    const TwoWayDistances d = distances(open, cube, &progress);
    EXPECT_LT(d.there.max, 1e-7);
    EXPECT_NEAR(d.back.mean, 1.0 / 36, 2e-4);
    EXPECT_NEAR(d.back.rms, 1.0 / 12, 4e-4);
    EXPECT_NEAR(d.back.max, 0.5, 0.01);
}

/// All of a surface may be equally far from a speck: places on it need to be no nearer to each
/// other than distances are told, or each of half a million looks at all triangles.
TEST(MeshMeasuresTest, SpecksInTheMiddleOfABall)
{
    Interrupter progress;
    const Mesh ball = ballOf(400);
    for (const float size : {1e-3f, 0.0f}) {
        Mesh speck;
        speck.positions = {{0, 0, 0}, {size, 0, 0}, {0, size, 0}};
        speck.triangles = {{0, 1, 2}};
        const auto start = std::chrono::steady_clock::now();
        const TwoWayDistances d = distances(speck, ball, &progress);
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        EXPECT_NEAR(d.there.mean, 1, 2e-3);
        EXPECT_NEAR(d.back.mean, 1, 2e-3);
        EXPECT_LT(took.count(), 20); // it took minutes
    }
}

TEST(MeshMeasuresTest, DistancesFarFromTheOriginAndBetweenFrames)
{
    Interrupter progress;
    Mesh a = torus(40, 0.3), b = a;
    a.frame = Vec3d(1e7, 0, 0);
    b.frame = Vec3d(1e7 - 0.5, 0, 0);
    for (Vec3f& p : b.positions) p[0] += 0.5f;
    EXPECT_LT(distances(a, b, &progress).there.max, 1e-6);
    b.frame[2] += 0.001;
    EXPECT_NEAR(distances(a, b, &progress).back.max, 0.001, 1e-6);
}

TEST(MeshMeasuresTest, DistancesToPoints)
{
    Interrupter progress;
    PointCloud points;
    points.frame = Vec3d(0.25, 0.25, 0);
    points.positions = {Vec3f(0, 0, 2), Vec3f(0, 0, 1)};
    const Mesh sheet = plane(4, 0, 0);
    const TwoWayDistances d = distances(sheet, points, &progress);
    EXPECT_NEAR(d.back.mean, 1.5, 1e-6);
    EXPECT_NEAR(d.back.rms, std::sqrt(2.5), 1e-6);
    EXPECT_NEAR(d.back.max, 2, 1e-6);
    EXPECT_NEAR(d.there.max, std::sqrt(1 + 2 * 0.75 * 0.75), 1e-6);
    EXPECT_NEAR(d.there.rms, std::sqrt(1 + 2 * (1.0 / 12 + 0.0625)), 1e-3);
    EXPECT_THROW(distances(sheet, PointCloud(), &progress), UsageError);
    EXPECT_THROW(distances(Mesh(), sheet, &progress), UsageError);
}

TEST(MeshMeasuresTest, ThreadsDoNotMatterAndAStopStops)
{
    const auto all = [](std::size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Interrupter progress;
        const TwoWayDistances d = distances(torus(60, 0.3), torus(50, 0.31), &progress);
        return std::array{d.there.mean, d.there.rms, d.there.max,
                          d.back.mean,  d.back.rms,  d.back.max};
    };
    EXPECT_EQ(all(1), all(2));
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(findSelfIntersections(torus(20, 0.3), &stopped), Interrupted);
    EXPECT_THROW(distances(torus(9, 0.3), torus(8, 0.3), &stopped), Interrupted);
}

} // namespace
} // namespace mpuvdb::test
