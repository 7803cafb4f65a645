// Surfaces between two others.
#include "modelling_fixture.h"
#include "solid_level_set.h"

#include <cmath>

namespace mpuvdb::test
{
namespace
{

using openvdb::Coord;

constexpr Morphing kBoth[] = {Morphing::Linear, Morphing::Advection};

LevelSet morphed(const LevelSet& a, const LevelSet& b, double t, Morphing how)
{
    Interrupter progress;
    return morph(a, b, t, how, &progress);
}

/// Mean and largest | |x| - r | of a sphere's values, voxels.
double largestError(const LevelSet& sphere, double radius)
{
    double largest = 0;
    for (auto on = sphere.grid().cbeginValueOn(); on; ++on) {
        const double exact = worldOf(sphere.lattice(), on.getCoord()).norm() - radius;
        largest = std::max(largest, std::abs(double(*on) - exact));
    }
    return largest / sphere.voxelSize();
}

TEST(Morph, BetweenSpheresIsASphere)
{
    // Both radii's distances are linear, and so is the way from one to the other.
    const LevelSet small = solidLevelSet("sphere(0.4)", 0.05),
                   large = solidLevelSet("sphere(1.2)", 0.05);
    for (const Morphing how : kBoth)
        for (const double t : {0.1, 0.6}) {
            const LevelSet grown = morphed(small, large, t, how),
                           shrunk = morphed(large, small, t, how);
            // The front's way is as long as the farthest voxel between, up to a voxel short.
            const double slack = how == Morphing::Linear ? 0.05 : 1;
            EXPECT_LT(largestError(grown, 0.4 + 0.8 * t), slack) << t;
            EXPECT_LT(largestError(shrunk, 1.2 - 0.8 * t), slack) << t;
            expectSmoothDistance(grown);
            expectSmoothDistance(shrunk);
        }
}

TEST(Morph, EndsAreTheShapesThemselves)
{
    const LevelSet a = solidLevelSet("torus(0.8,0.3)", 0.05, 3),
                   b = solidLevelSet("box(1,0.7,0.9)", 0.05, 4);
    Interrupter progress;
    const LevelSet wideA = withHalfWidth(a, 4, &progress);
    for (const Morphing how : kBoth) {
        EXPECT_TRUE(treeBytes(morphed(a, b, 0, how).grid()) == treeBytes(wideA.grid()));
        EXPECT_TRUE(treeBytes(morphed(a, b, 1, how).grid()) == treeBytes(b.grid()));
        EXPECT_TRUE(treeBytes(morphed(b, a, 0, how).grid()) == treeBytes(b.grid()));
    }
    for (auto on = a.grid().cbeginValueOn(); on; ++on)
        ASSERT_EQ(wideA.grid().tree().getValue(on.getCoord()), *on);
}

TEST(Morph, OfAShapeWithItselfIsThatShape)
{
    const LevelSet torus = solidLevelSet("torus(0.8,0.3)", 0.05);
    for (const Morphing how : kBoth) {
        const LevelSet same = morphed(torus, torus, 0.3, how);
        for (auto on = torus.grid().cbeginValueOn(); on; ++on)
            ASSERT_NEAR(same.grid().tree().getValue(on.getCoord()), *on, 0.1 * 0.05);
    }
}

TEST(Morph, PassesFromOneToTheOther)
{
    const struct {
        std::string a, b;
    } pairs[] = {
        {"box(1,1,1)", "sphere(0.65)"},
        {"torus(0.8,0.25)", "sphere(0.5)"},
        {"translate(sphere(0.4),-0.3,0,0)", "translate(box(0.5,0.6,0.7),0.3,0,0)"},
        // No overlap at all, and one in two pieces.
        {"translate(sphere(0.3),-0.5,0,0)", "translate(sphere(0.25),0.5,0,0)"},
        {"union(translate(sphere(0.3),0,0.5,0),translate(sphere(0.2),0,-0.5,0))", "sphere(0.3)"},
    };
    for (const auto& pair : pairs) {
        SCOPED_TRACE(pair.a + " to " + pair.b);
        const LevelSet a = solidLevelSet(pair.a, 0.05), b = solidLevelSet(pair.b, 0.05);
        for (const Morphing how : kBoth) {
            // Each place changes sides once at most.
            std::vector<LevelSet> steps;
            for (int n = 0; n <= 4; ++n) steps.push_back(morphed(a, b, n / 4.0, how));
            for (const LevelSet& step : steps) expectSound(step);
            for (int x = -24; x <= 24; x += 2)
                for (int y = -20; y <= 20; y += 2)
                    for (int z = -20; z <= 20; z += 2) {
                        int changes = 0;
                        for (std::size_t n = 1; n < steps.size(); ++n)
                            changes += (steps[n].grid().tree().getValue(Coord(x, y, z)) < 0) !=
                                       (steps[n - 1].grid().tree().getValue(Coord(x, y, z)) < 0);
                        ASSERT_LE(changes, 1) << x << ' ' << y << ' ' << z;
                    }
        }
    }
}

TEST(Morph, LinearIsTheZeroSetOfTheMixedDistances)
{
    const auto a = parseSolid("translate(sphere(0.3),-0.5,0,0)"),
               b = parseSolid("translate(sphere(0.7),0.4,0,0)");
    const LevelSet from = solidLevelSet("translate(sphere(0.3),-0.5,0,0)", 0.05),
                   to = solidLevelSet("translate(sphere(0.7),0.4,0,0)", 0.05);
    for (const double t : {0.05, 0.3, 0.5, 0.8, 0.97}) {
        const LevelSet between = morphed(from, to, t, Morphing::Linear);
        for (int x = -20; x <= 24; ++x)
            for (int y = -15; y <= 15; ++y)
                for (int z = -15; z <= 15; ++z) {
                    const Vec3d p = 0.05 * Vec3d(x, y, z);
                    const double mixed = (1 - t) * a->distance(p) + t * b->distance(p);
                    if (std::abs(mixed) < 0.1 * 0.05) continue;
                    ASSERT_EQ(between.grid().tree().getValue(Coord(x, y, z)) < 0, mixed < 0)
                        << t << ' ' << p.transpose();
                }
    }
}

TEST(Morph, JoinsOtherLatticesAndBands)
{
    const LevelSet a = solidLevelSet("sphere(1)", 0.1), b = solidLevelSet("sphere(0.6)", 0.04, 5);
    for (const Morphing how : kBoth) {
        const LevelSet between = morphed(a, b, 0.5, how);
        EXPECT_DOUBLE_EQ(between.voxelSize(), b.voxelSize());
        EXPECT_NEAR(between.halfWidth(), 7.5, 3); // the wider of 5 and what resampling makes of 3
        EXPECT_LT(largestError(between, 0.8), 1);
    }
}

TEST(Morph, RefusesTimesOutsideTheUnitInterval)
{
    const LevelSet a = solidLevelSet("sphere(1)", 0.2);
    for (const double t : {-0.1, 1.1, std::nan("")})
        EXPECT_THROW(morphed(a, a, t, Morphing::Linear), UsageError);
}

TEST(Morph, WithNothingIsNothing)
{
    const LevelSet sphere = solidLevelSet("sphere(0.5)", 0.1), none = emptyLevelSet(0.1);
    for (const Morphing how : kBoth) {
        EXPECT_TRUE(morphed(sphere, none, 0.5, how).grid().empty());
        EXPECT_TRUE(morphed(none, sphere, 0.5, how).grid().empty());
        EXPECT_FALSE(morphed(none, sphere, 1, how).grid().empty());
        EXPECT_FALSE(morphed(sphere, none, 0, how).grid().empty());
    }
}

TEST(Morph, IsTheSameForAnyNumberOfThreads)
{
    const LevelSet a = solidLevelSet("torus(0.8,0.3)", 0.05), b = solidLevelSet("box(1,1,1)", 0.05);
    for (const Morphing how : kBoth)
        expectSameOnAnyThreads([&] { return morphed(a, b, 0.4, how).gridPtr(); });
}

TEST(Morph, CanBeStopped)
{
    const LevelSet a = solidLevelSet("sphere(2)", 0.02), b = solidLevelSet("sphere(0.3)", 0.02);
    for (const Morphing how : kBoth)
        expectStops([&](Interrupter& progress) { morph(a, b, 0.5, how, &progress); });
}

} // namespace
} // namespace mpuvdb::test
