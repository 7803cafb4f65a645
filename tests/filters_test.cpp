// Smoothing of level sets, and densities made from them.
#include "solid_level_set.h"

#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/LevelSetUtil.h>

#include <cmath>

namespace mpuvdb::test
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

LevelSet smoothed(const LevelSet& levelSet, const SmoothSettings& settings)
{
    Interrupter progress;
    return smooth(levelSet, settings, &progress);
}

SmoothSettings settingsFor(Filter filter, int iterations = 1, int width = 1)
{
    SmoothSettings settings;
    settings.filter = filter;
    settings.iterations = iterations;
    settings.width = width;
    return settings;
}

double radiusOf(const LevelSet& sphere)
{
    return std::cbrt(measured(sphere).volume * 3 / (4 * M_PI));
}

TEST(Smooth, LeavesPlanesWhereTheyAre)
{
    const LevelSet box = solidLevelSet("translate(box(1.6,1.6,1.6),0.013,0.021,-0.017)", 0.05);
    const auto before = box.grid().getConstAccessor();
    for (const Filter filter : {Filter::Mean, Filter::Gaussian, Filter::Median}) {
        const LevelSet after = smoothed(box, settingsFor(filter, 2));
        const auto now = after.grid().getConstAccessor();
        // The middle of each face is out of reach of all edges.
        for (int n = 0; n < 6; ++n)
            for (int depth = 14; depth < 19; ++depth) {
                Coord at(0);
                at[n / 2] = n % 2 ? depth : -depth;
                EXPECT_NEAR(now.getValue(at), before.getValue(at), 1e-5) << at;
            }
    }
}

TEST(Smooth, MeanCurvatureShrinksASphereAsTheFormulaSays)
{
    // dr/dt = -2/r, and a step is h^2/6 long.
    const double h = 0.05, r = 1;
    const LevelSet sphere = solidLevelSet("sphere(1)", h);
    for (const int iterations : {1, 4, 12}) {
        const LevelSet after = smoothed(sphere, settingsFor(Filter::MeanCurvature, iterations));
        const double expected = std::sqrt(r * r - 4 * iterations * h * h / 6);
        RecordProperty("radius" + std::to_string(iterations), std::to_string(radiusOf(after)));
        EXPECT_NEAR(radiusOf(after), expected, 0.002 * h * iterations) << iterations;
        expectSmoothDistance(after);
    }
}

TEST(Smooth, GivesASoundDistanceAndKeepsVolume)
{
    const LevelSet torus = solidLevelSet("torus(1,0.4)", 0.05);
    const double volume = measured(torus).volume;
    for (const Filter filter : {Filter::Mean, Filter::Gaussian, Filter::Median}) {
        const LevelSet after = smoothed(torus, settingsFor(filter));
        expectSmoothDistance(after);
        EXPECT_DOUBLE_EQ(after.halfWidth(), torus.halfWidth());
        const double change = measured(after).volume / volume - 1;
        RecordProperty("volumeChange" + std::to_string(int(filter)), std::to_string(change));
        EXPECT_LT(change, 0);
        EXPECT_GT(change, -0.05);
    }
}

TEST(Smooth, RoundsTheEdgesOfABox)
{
    const LevelSet box = solidLevelSet("box(1.6,1.6,1.6)", 0.05);
    Interrupter progress;
    for (const int width : {1, 3}) {
        const LevelSet after = smoothed(box, settingsFor(Filter::Gaussian, 1, width));
        EXPECT_TRUE(
            check(after.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress).sound())
            << texts(check(after.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress));
        // The corner goes, the middles of the faces stay.
        EXPECT_GT(after.grid().tree().getValue(Coord(16 - width)), 0);
        EXPECT_NEAR(measured(after).bounds.max()[0], 0.8, 0.002);
    }
}

TEST(Smooth, ChangesNothingAwayFromItsMask)
{
    const LevelSet torus = solidLevelSet("torus(1,0.4)", 0.05);
    // A mask on another lattice: one beyond x = 0.5.
    const auto mask = FloatGrid::create(0);
    mask->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
    mask->sparseFill({Coord(5, -30, -30), Coord(30, 30, 30)}, 1.0f);
    for (const Filter filter :
         {Filter::Mean, Filter::Gaussian, Filter::Median, Filter::MeanCurvature}) {
        SmoothSettings settings = settingsFor(filter, 2);
        settings.mask = mask;
        const LevelSet after = smoothed(torus, settings);
        expectSmoothDistance(after);
        std::uint64_t changed = 0;
        for (auto on = torus.grid().cbeginValueOn(); on; ++on) {
            const Coord at = on.getCoord();
            float now = 0;
            const bool active = after.grid().tree().probeValue(at, now);
            if (at.x() < 2) {
                EXPECT_TRUE(active && now == *on) << at;
            }
            changed += now != *on;
        }
        EXPECT_GT(changed, 1000u);
        settings.mask = FloatGrid::create(0);
        EXPECT_TRUE(treeBytes(smoothed(torus, settings).grid()) == treeBytes(torus.grid()));
    }
}

TEST(Smooth, RefusesSettingsOutOfRange)
{
    const LevelSet sphere = solidLevelSet("sphere(1)", 0.2);
    EXPECT_THROW(smoothed(sphere, settingsFor(Filter::Mean, 0)), UsageError);
    EXPECT_THROW(smoothed(sphere, settingsFor(Filter::Mean, 1001)), UsageError);
    EXPECT_THROW(smoothed(sphere, settingsFor(Filter::Median, 1, 0)), UsageError);
    EXPECT_THROW(smoothed(sphere, settingsFor(Filter::Gaussian, 1, 33)), UsageError);
    EXPECT_NO_THROW(smoothed(sphere, settingsFor(Filter::MeanCurvature, 1, 0)));
    SmoothSettings masked = settingsFor(Filter::Mean, 1);
    masked.mask = FloatGrid::create(NAN);
    EXPECT_THROW(smoothed(sphere, masked), InputError);
}

TEST(Smooth, MayLeaveNothing)
{
    const LevelSet crumb = solidLevelSet("sphere(0.1)", 0.05);
    EXPECT_TRUE(smoothed(crumb, settingsFor(Filter::Mean, 3, 4)).grid().empty());
    const LevelSet none = emptyLevelSet(0.05);
    EXPECT_TRUE(smoothed(none, settingsFor(Filter::Mean)).grid().empty());
}

TEST(Smooth, IsTheSameForAnyNumberOfThreads)
{
    const LevelSet solid = solidLevelSet("box(1,0.8,0.6)", 0.05);
    for (const Filter filter :
         {Filter::Mean, Filter::Gaussian, Filter::Median, Filter::MeanCurvature})
        expectSameOnAnyThreads([&] { return smoothed(solid, settingsFor(filter, 2)).gridPtr(); });
}

TEST(Smooth, CanBeStopped)
{
    const LevelSet solid = solidLevelSet("sphere(1)", 0.03);
    for (const Filter filter : {Filter::Gaussian, Filter::Median, Filter::MeanCurvature})
        expectStops(
            [&](Interrupter& progress) { smooth(solid, settingsFor(filter, 1000, 8), &progress); });
}

TEST(Fog, IsFullInsideAndFallsToTheSurface)
{
    // Large enough for tiles of 128 voxels inside.
    const LevelSet box =
        solidLevelSet("translate(roundedbox(2.9,2.9,2.9,0.2),1.28,1.28,1.28)", 0.02);
    Interrupter progress;
    const FloatGrid::Ptr fog = toFog(box, &progress);
    EXPECT_EQ(fog->getGridClass(), openvdb::GRID_FOG_VOLUME);
    EXPECT_EQ(fog->getName(), "density");
    EXPECT_EQ(fog->background(), 0);
    EXPECT_TRUE(fog->transform() == box.grid().transform());
    EXPECT_TRUE(fog->tree().hasActiveTiles());
    const auto inside = openvdb::tools::sdfInteriorMask(box.grid(), 0.0f);
    EXPECT_EQ(fog->activeVoxelCount(), inside->activeVoxelCount());
    for (auto on = fog->cbeginValueOn(); on; ++on) {
        const float distance = box.grid().tree().getValue(on.getCoord());
        EXPECT_NEAR(*on, -distance / box.grid().background(), 1e-6);
        if (testing::Test::HasFailure()) break;
    }
    EXPECT_TRUE(fog->tree().isValueOn(Coord(64)));
    EXPECT_EQ(fog->tree().getValue(Coord(64)), 1);
    EXPECT_EQ(fog->tree().getValue(Coord(300)), 0);
    EXPECT_EQ(fog->tree().getValue(Coord(5000)), 0);
}

TEST(Fog, OfNothingIsEmpty)
{
    Interrupter progress;
    const FloatGrid::Ptr fog = toFog(emptyLevelSet(0.1), &progress);
    EXPECT_TRUE(fog->empty());
    EXPECT_EQ(fog->background(), 0);
    EXPECT_EQ(fog->getGridClass(), openvdb::GRID_FOG_VOLUME);
}

LevelSet surfaceOf(const FloatGrid& grid, double value, Inside inside = Inside::Above)
{
    Interrupter progress;
    return isosurface(grid, value, inside, 3, 0, &progress);
}

/// A density of 1 in the voxels from @a low to @a high.
FloatGrid::Ptr filled(const Coord& low, const Coord& high)
{
    const auto density = FloatGrid::create(0);
    density->setGridClass(openvdb::GRID_FOG_VOLUME);
    density->setTransform(openvdb::math::Transform::createLinearTransform(0.01));
    density->sparseFill({low, high}, 1.0f, true);
    return density;
}

TEST(Isosurface, OfTilesAndVoxelsLiesBetweenThem)
{
    Interrupter progress;
    // Tiles of 8 and 128 voxels, alone and among voxels; beside them is nothing.
    for (const auto& [low, high] :
         {std::pair{Coord(0), Coord(7)}, std::pair{Coord(0), Coord(127)},
          std::pair{Coord(-5, 0, 3), Coord(140, 127, 90)}, std::pair{Coord(-9), Coord(-3)}}) {
        const LevelSet box = surfaceOf(*filled(low, high), 0.5);
        EXPECT_TRUE(
            check(box.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress).sound());
        // Halfway from the last voxels to those beside.
        const SolidMeasures measures = measure(box, &progress);
        for (int axis = 0; axis < 3; ++axis) {
            EXPECT_NEAR(measures.bounds.min()[axis], 0.01 * (low[axis] - 0.5), 1e-6);
            EXPECT_NEAR(measures.bounds.max()[axis], 0.01 * (high[axis] + 0.5), 1e-6);
        }
        EXPECT_EQ(measures.surfaces, 1u);
    }
}

TEST(Isosurface, OfALinearDensityIsExact)
{
    const LevelSet ball = solidLevelSet("sphere(1)", 0.05);
    Interrupter progress;
    const FloatGrid::Ptr fog = toFog(ball, &progress);
    const LevelSet inner = surfaceOf(*fog, 0.5);
    EXPECT_TRUE(inner.grid().transform() == fog->transform());
    // Half of its band deep: 1.5 voxels. Straight lines between voxels miss a sphere by h^2 / 8 r.
    for (auto on = inner.grid().cbeginValueOn(); on; ++on) {
        const double radius = 0.05 * on.getCoord().asVec3d().length();
        ASSERT_NEAR(*on, radius - 0.925, 0.05 * 0.05) << on.getCoord();
    }
    EXPECT_THROW(surfaceOf(*fog, 2), InputError);
    EXPECT_THROW(surfaceOf(*fog, 0), UsageError); // the background would be no side
    fog->tree().setValue(Coord(1), std::nanf(""));
    EXPECT_THROW(surfaceOf(*fog, 0.5), InputError);
}

} // namespace
} // namespace mpuvdb::test
