// Points in Morton order: their queries are those of a search through all of them.
#include "field_fixture.h"
#include "mpu/octree/sorted_points.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

using test::Random;

PointCloud cloudOf(const std::vector<Vec3f>& positions, Random& random, bool confident)
{
    PointCloud cloud;
    cloud.positions = positions;
    for (std::size_t i = 0; i < positions.size(); ++i) {
        cloud.normals.push_back(random.direction().cast<float>());
        if (confident) cloud.confidence.push_back(float(random.uniform(0.1, 1)));
    }
    return cloud;
}

/// Clouds in the root cube [0,8)^3: random, with duplicates, on the borders of cells, in clumps.
std::vector<std::vector<Vec3f>> clouds(Random& random)
{
    std::vector<Vec3f> even, repeated, borders, clump;
    for (int i = 0; i < 3000; ++i)
        even.push_back((random.inCube(3.9) + Vec3d::Constant(4)).cast<float>());
    for (int i = 0; i < 2000; ++i) repeated.push_back(even[random.below(60)]);
    for (int x = 0; x < 15; ++x)
        for (int y = 0; y < 15; ++y)
            for (int z = 0; z < 15; ++z)
                borders.push_back(0.5f * Vec3f(float(x), float(y), float(z)));
    for (int i = 0; i < 2000; ++i)
        clump.push_back((random.inBall(1e-4) + Vec3d(5, 1, 7)).cast<float>());
    clump.emplace_back(0.f, 0.f, 0.f);
    return {even, repeated, borders, clump, {Vec3f(1, 2, 3)}};
}

const RootCube kRoot{Vec3d::Zero(), 8};

SortedPoints sorted(PointCloud cloud)
{
    Interrupter progress;
    return SortedPoints(std::move(cloud), kRoot, progress);
}

bool same(const PointArrays& a, const PointArrays& b)
{
    const auto equal = [&](const float* u, const float* v) {
        return a.size() == b.size() && std::equal(u, u + a.size(), v);
    };
    return equal(a.x, b.x) && equal(a.y, b.y) && equal(a.z, b.z) && equal(a.nx, b.nx) &&
           equal(a.ny, b.ny) && equal(a.nz, b.nz) && equal(a.confidence, b.confidence);
}

OctreeCell randomCell(Random& random)
{
    OctreeCell cell;
    cell.level = int(random.below(10));
    const std::size_t edge = std::size_t(1) << cell.level;
    cell.i = std::uint32_t(random.below(edge));
    cell.j = std::uint32_t(random.below(edge));
    cell.k = std::uint32_t(random.below(edge));
    return cell;
}

Vec3d position(const PointArrays& points, std::size_t i)
{
    return {points.x[i], points.y[i], points.z[i]};
}

TEST(SortedPoints, HoldsAllPointsInAnOrderThatTheInputsOrderDoesNotChange)
{
    Random random(1);
    for (const auto& positions : clouds(random)) {
        for (const bool confident : {false, true}) {
            const PointCloud cloud = cloudOf(positions, random, confident);
            const SortedPoints first = sorted(cloud), second = sorted(test::shuffled(cloud, 7));
            ASSERT_EQ(first.size(), cloud.size());
            EXPECT_TRUE(same(first.points(), second.points()));
            double sum = 0, sumSorted = 0; // of integers, to be exact
            for (std::size_t i = 0; i < cloud.size(); ++i) {
                sum += std::round(1e6 * double(cloud.positions[i].sum()));
                sumSorted += std::round(1e6 * double(Vec3f(first.points().x[i], first.points().y[i],
                                                           first.points().z[i])
                                                         .sum()));
            }
            EXPECT_EQ(sum, sumSorted);
        }
    }
}

TEST(SortedPoints, VisitsEveryOccupiedCellOnce)
{
    Random random(2);
    for (const auto& positions : clouds(random)) {
        const SortedPoints points = sorted(cloudOf(positions, random, false));
        for (const int level : {0, 1, 3, 6, SortedPoints::kMaxLevel}) {
            std::size_t next = 0;
            std::vector<std::array<double, 3>> cells;
            const double size = kRoot.size(level);
            points.forEachCell(level, [&](std::size_t begin, std::size_t end) {
                EXPECT_EQ(begin, next);
                next = end;
                const auto cellOf = [&](std::size_t i) {
                    const Vec3d p = position(points.points(), i) / size;
                    return std::array<double, 3>{std::floor(p[0]), std::floor(p[1]),
                                                 std::floor(p[2])};
                };
                cells.push_back(cellOf(begin));
                for (std::size_t i = begin; i < end; ++i) EXPECT_EQ(cellOf(i), cells.back());
            });
            EXPECT_EQ(next, points.size());
            std::sort(cells.begin(), cells.end());
            EXPECT_EQ(std::adjacent_find(cells.begin(), cells.end()), cells.end());
        }
    }
}

TEST(SortedPoints, GathersTheBall)
{
    Random random(3);
    for (const auto& positions : clouds(random)) {
        const SortedPoints points = sorted(cloudOf(positions, random, true));
        PointBatch found;
        BatchFilter filter;
        for (int query = 0; query < 60; ++query) {
            const OctreeCell cell = randomCell(random);
            const double radius = kRoot.size(cell.level) * random.uniform(0.3, 3);
            const Vec3d center = kRoot.center(cell);
            points.gather(points.around(cell, radius), 1, filter, found);
            // Points on the ball's border by less than rounding may be in or out.
            std::size_t surely = 0, perhaps = 0;
            for (std::size_t i = 0; i < points.size(); ++i) {
                const double d = (position(points.points(), i) - center).norm();
                surely += d < radius - 1e-5;
                perhaps += d < radius + 1e-5;
            }
            EXPECT_GE(found.size(), surely);
            EXPECT_LE(found.size(), perhaps);
            for (std::size_t i = 0; i < found.size(); ++i)
                EXPECT_LT((position(found, i) - center).norm(), radius + 1e-5);
            EXPECT_GE(points.around(cell, radius).points, found.size());
        }
    }
}

TEST(SortedPoints, GathersEveryNthOfTheSurroundings)
{
    Random random(4);
    const auto positions = clouds(random)[0];
    const SortedPoints points = sorted(cloudOf(positions, random, true));
    PointBatch found;
    BatchFilter filter;
    for (const std::size_t wanted : {1u, 2u, 7u, 100u, 1023u, 1024u, 1500u, 2100u})
        for (const OctreeCell& cell : {OctreeCell{}, OctreeCell{1, 0, 0, 0}}) {
            // All of them are in the ball.
            const std::size_t stride =
                points.gather(points.around(cell, 100), wanted, filter, found);
            EXPECT_LE(stride, wanted);
            EXPECT_GT(2 * stride, wanted);
            ASSERT_EQ(found.size(), (points.size() + stride - 1) / stride);
            for (std::size_t n = 0; n < found.size(); ++n)
                EXPECT_EQ(found.x[n], points.points().x[n * stride]);
        }
}

TEST(SortedPoints, CountsInABox)
{
    Random random(5);
    for (const auto& positions : clouds(random)) {
        const SortedPoints points = sorted(cloudOf(positions, random, false));
        for (int query = 0; query < 60; ++query) {
            // In the cube, across its faces and beyond it; some borders on points.
            Box3d box(random.inCube(6) + Vec3d::Constant(4));
            box.extend(query % 3 ? Vec3d(random.inCube(6) + Vec3d::Constant(4))
                                 : position(points.points(), random.below(points.size())));
            std::size_t expected = 0;
            for (std::size_t i = 0; i < points.size(); ++i)
                expected += box.contains(position(points.points(), i));
            EXPECT_EQ(points.countIn(box, points.size()), expected);
            for (const std::size_t limit : {std::size_t(1), expected / 2, expected}) {
                const std::size_t counted = points.countIn(box, limit);
                EXPECT_GE(counted, std::min(limit, expected));
                EXPECT_LE(counted, expected);
            }
        }
    }
}

} // namespace
} // namespace mpuvdb
