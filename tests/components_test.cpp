// Connected parts of solids.
#include "solid_level_set.h"

#include <fmt/format.h>
#include <openvdb/tools/Composite.h>

#include <cmath>

namespace mpuvdb::test
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

std::vector<SolidComponent> componentsOf(const LevelSet& levelSet)
{
    Interrupter progress;
    return components(levelSet, &progress);
}

LevelSet kept(const LevelSet& levelSet, double minVolume, std::size_t count)
{
    Interrupter progress;
    return keepComponents(levelSet, minVolume, count, &progress);
}

double ball(double radius)
{
    return 4 * M_PI / 3 * radius * radius * radius;
}

void expectAllSound(const std::vector<SolidComponent>& parts)
{
    for (const SolidComponent& part : parts) expectSmoothDistance(part.levelSet);
}

TEST(Components, OfOneSolidIsThatSolid)
{
    const LevelSet torus = solidLevelSet("torus(1,0.4)", 0.05);
    const auto parts = componentsOf(torus);
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_TRUE(treeBytes(parts[0].levelSet.grid()) == treeBytes(torus.grid()));
    EXPECT_NEAR(parts[0].volume / (2 * M_PI * M_PI * 0.16), 1, 0.001);
    EXPECT_NEAR(parts[0].area / (4 * M_PI * M_PI * 0.4), 1, 0.001);
    EXPECT_EQ(parts[0].genus, 1);
    EXPECT_NEAR((parts[0].bounds.sizes() - Vec3d(2.8, 2.8, 0.8)).norm(), 0, 0.01);
}

TEST(Components, OfATurnedWallOfOneVoxelIsTheWall)
{
    Random random(5);
    for (int n = 0; n < 4; ++n) {
        const Vec3d axis = random.direction();
        const LevelSet wall =
            solidLevelSet(fmt::format("rotate(box(2,2,0.1),{},{},{},{})", axis.x(), axis.y(),
                                      axis.z(), random.uniform(10, 80)),
                          0.1);
        const auto parts = componentsOf(wall);
        ASSERT_EQ(parts.size(), 1u) << "turn " << n;
        EXPECT_TRUE(treeBytes(parts[0].levelSet.grid()) == treeBytes(wall.grid()));
    }
}

TEST(Components, FarApartKeepTheirValuesToTheBit)
{
    const LevelSet both = solidLevelSet(
        "union(translate(sphere(0.3),-0.6,0,0),translate(sphere(0.4),0.6,0,0))", 0.05);
    const auto parts = componentsOf(both);
    ASSERT_EQ(parts.size(), 2u);
    EXPECT_NEAR(parts[0].volume, ball(0.4), 0.002 * ball(0.4));
    EXPECT_NEAR(parts[1].volume, ball(0.3), 0.002 * ball(0.3));
    expectAllSound(parts);
    std::uint64_t active = 0;
    for (const SolidComponent& part : parts) {
        EXPECT_EQ(part.levelSet.grid().transform(), both.grid().transform());
        for (auto on = part.levelSet.grid().cbeginValueOn(); on; ++on)
            ASSERT_EQ(*on, both.grid().tree().getValue(on.getCoord()));
        active += part.levelSet.grid().activeVoxelCount();
    }
    EXPECT_EQ(active, both.grid().activeVoxelCount());
}

/// A thin wall beside a ball: where the ball is gone distances are made anew, the wall's own stay.
TEST(Components, ThinWallsKeepTheirValues)
{
    const LevelSet wall = solidLevelSet("rotate(box(2,2,0.05),1,2,3,40)", 0.05);
    const LevelSet ball = solidLevelSet("translate(sphere(0.2),0,0,0.35)", 0.05);
    const auto either = wall.grid().deepCopy();
    openvdb::tools::csgUnion(*either, *ball.grid().deepCopy());
    const LevelSet both(either);
    const auto parts = componentsOf(both);
    ASSERT_EQ(parts.size(), 2u);
    EXPECT_NEAR(parts[0].volume, measured(wall).volume, 0.01 * measured(wall).volume);
    EXPECT_EQ(parts[0].genus, 0);
    std::uint64_t same = 0;
    const auto now = parts[0].levelSet.grid().getConstAccessor();
    for (auto on = wall.grid().cbeginValueOn(); on; ++on)
        same += now.getValue(on.getCoord()) == *on;
    // The ball's half of the bands' overlap is a twentieth of the wall's band.
    EXPECT_GT(double(same), 0.9 * double(wall.grid().activeVoxelCount()));
}

TEST(Components, NearToEachOtherGetDistancesOfTheirOwn)
{
    // A gap of two voxels: their bands meet.
    const LevelSet both = solidLevelSet(
        "union(translate(sphere(0.4),-0.45,0,0),translate(sphere(0.4),0.45,0,0))", 0.05);
    const auto parts = componentsOf(both);
    ASSERT_EQ(parts.size(), 2u);
    expectAllSound(parts);
    for (const SolidComponent& part : parts) {
        const double side = part.levelSet.grid().tree().getValue(Coord(9, 0, 0)) < 0 ? 1 : -1;
        double largest = 0;
        for (auto on = part.levelSet.grid().cbeginValueOn(); on; ++on) {
            const Vec3d p = worldOf(both.lattice(), on.getCoord()) - Vec3d(0.45 * side, 0, 0);
            largest = std::max(largest, std::abs(double(*on) - (p.norm() - 0.4)) / 0.05);
        }
        RecordProperty("largestError", std::to_string(largest));
        EXPECT_LT(largest, 0.25);
    }
    EXPECT_TRUE(treeBytes(kept(both, 0, 2).grid()) == treeBytes(both.grid()));
    EXPECT_TRUE(treeBytes(kept(both, 0, 1).grid()) == treeBytes(parts[0].levelSet.grid()));
}

TEST(Components, KeepTheirCavitiesAndWhatIsInACavityIsAPartOfItsOwn)
{
    // A hollow ball, a ball in its hollow, both with cores deep enough for tiles.
    const LevelSet solid =
        solidLevelSet("union(difference(sphere(2),sphere(1.2)),sphere(0.7))", 0.05);
    const auto parts = componentsOf(solid);
    ASSERT_EQ(parts.size(), 2u);
    expectAllSound(parts);
    EXPECT_NEAR(parts[0].volume, ball(2) - ball(1.2), 0.002 * ball(2));
    EXPECT_NEAR(parts[1].volume, ball(0.7), 0.002 * ball(0.7));
    EXPECT_EQ(measured(parts[0].levelSet).surfaces, 2u);
    EXPECT_EQ(measured(parts[1].levelSet).surfaces, 1u);
    EXPECT_GT(parts[0].levelSet.grid().tree().getValue(Coord(0)), 0);
    EXPECT_LT(parts[1].levelSet.grid().tree().getValue(Coord(0)), 0);
}

TEST(Components, ThroughTilesOfAllSizesAreOne)
{
    const LevelSet box = solidLevelSet("translate(box(2.9,2.9,2.9),1.28,1.28,1.28)", 0.02);
    const auto parts = componentsOf(box);
    ASSERT_EQ(parts.size(), 1u);
    EXPECT_TRUE(treeBytes(parts[0].levelSet.grid()) == treeBytes(box.grid()));
}

/// Balls on a lattice, of radii that grow in an order of their own.
LevelSet manyBalls(int n, double voxelSize)
{
    const auto grid = openvdb::createLevelSet<FloatGrid>(voxelSize, 3);
    auto voxels = grid->getAccessor();
    for (int k = 0; k < n * n * n; ++k) {
        const double r = 3 + 0.001 * (k * 7919 % (n * n * n)); // voxels; bands of 3 reach 8
        const openvdb::Coord center(20 * (k % n), 20 * (k / n % n), 20 * (k / n / n));
        for (int x = -8; x <= 8; ++x)
            for (int y = -8; y <= 8; ++y)
                for (int z = -8; z <= 8; ++z) {
                    const double distance = std::sqrt(x * x + y * y + z * z) - r;
                    const openvdb::Coord at = center.offsetBy(x, y, z);
                    if (std::abs(distance) < 3)
                        voxels.setValue(at, float(voxelSize * distance));
                    else if (distance < 0)
                        voxels.setValueOff(at, float(-3 * voxelSize));
                }
    }
    return LevelSet(grid);
}

TEST(Components, OfThousandCostLittleAndAreSorted)
{
    const LevelSet balls = manyBalls(10, 0.1);
    const auto start = std::clock();
    const auto parts = componentsOf(balls);
    const double seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
    RecordProperty("seconds", std::to_string(seconds));
    ASSERT_EQ(parts.size(), 1000u);
    for (std::size_t n = 1; n < parts.size(); ++n) ASSERT_GE(parts[n - 1].volume, parts[n].volume);
    const LevelSet most = kept(balls, 0, 990);
    EXPECT_EQ(componentsOf(most).size(), 990u);
    const LevelSet large = kept(balls, parts[99].volume, 1000);
    EXPECT_EQ(componentsOf(large).size(), 100u);
    expectSmoothDistance(large);
}

TEST(Components, KeepNoneAllOrWhatIsLargeEnough)
{
    const LevelSet both = solidLevelSet(
        "union(translate(sphere(0.3),-0.6,0,0),translate(sphere(0.4),0.6,0,0))", 0.05);
    EXPECT_TRUE(treeBytes(kept(both, 0, 9).grid()) == treeBytes(both.grid()));
    EXPECT_TRUE(kept(both, 0, 0).grid().empty());
    EXPECT_TRUE(kept(both, 1, 9).grid().empty());
    EXPECT_EQ(componentsOf(kept(both, 0.2, 9)).size(), 1u);
    EXPECT_THROW(kept(both, -1, 9), UsageError);
    EXPECT_THROW(kept(both, std::nan(""), 9), UsageError);
}

TEST(Components, AreFoundAndMeasuredOnceAndThenKept)
{
    const LevelSet three = solidLevelSet("union(translate(sphere(0.3),-0.6,0,0),"
                                         "translate(sphere(0.2),0,0,0),"
                                         "translate(sphere(0.4),0.6,0,0))",
                                         0.05);
    Interrupter progress;
    const SolidComponents found(three, &progress);
    const auto parts = componentsOf(three);
    ASSERT_EQ(found.measures().size(), parts.size());
    for (std::size_t n = 0; n < parts.size(); ++n) {
        EXPECT_EQ(found.measures()[n].volume, parts[n].volume);
        EXPECT_EQ(found.measures()[n].bounds.max(), parts[n].bounds.max());
        EXPECT_EQ(componentsOf(found.keep(0, n, &progress)).size(), n);
    }
    EXPECT_TRUE(treeBytes(found.keep(0, 1, &progress).grid()) ==
                treeBytes(parts[0].levelSet.grid()));
}

TEST(Components, OfNothingAreNone)
{
    EXPECT_TRUE(componentsOf(emptyLevelSet(0.1)).empty());
    EXPECT_TRUE(kept(emptyLevelSet(0.1), 0, 1).grid().empty());
}

TEST(Components, AreTheSameForAnyNumberOfThreads)
{
    const LevelSet both = solidLevelSet(
        "union(translate(sphere(0.4),-0.45,0,0),translate(sphere(0.4),0.45,0,0))", 0.05);
    for (const std::size_t n : {0u, 1u})
        expectSameOnAnyThreads([&] { return componentsOf(both)[n].levelSet.gridPtr(); });
}

TEST(Components, CanBeStopped)
{
    const LevelSet solid = solidLevelSet("difference(sphere(2),sphere(1))", 0.02);
    expectStops([&](Interrupter& progress) {
        for (;;) components(solid, &progress);
    });
}

} // namespace
} // namespace mpuvdb::test
