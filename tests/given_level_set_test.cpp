// Level sets made elsewhere: what is mended when they are taken in, and what is refused.
#include "solid_level_set.h"

#include <mpuvdb/error.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/operations.h>

#include <gtest/gtest.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/SignedFloodFill.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

constexpr double kVoxel = 0.05;

LevelSet ball(double halfWidth = 3, double voxelSize = kVoxel)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = voxelSize;
    settings.halfWidth = halfWidth;
    return sampleField(*makeSolidField(parseSolid("sphere(1)")), settings, &progress);
}

FloatGrid::Ptr copyOf(const LevelSet& levelSet)
{
    return levelSet.grid().deepCopy();
}

/// As an array's copy is: all voxels of a block around the ball are active.
FloatGrid::Ptr dense(const LevelSet& levelSet)
{
    const FloatGrid::Ptr made = copyOf(levelSet);
    const openvdb::CoordBBox box(Coord(-30), Coord(30));
    openvdb::tools::Dense<float> values(box);
    openvdb::tools::copyToDense(levelSet.grid(), values);
    made->tree().clear();
    openvdb::tools::copyFromDense(values, *made, 0.0f);
    auto at = made->getAccessor();
    for (auto c = box.begin(); c; ++c) at.setValueOn(*c, values.getValue(*c));
    made->tree().prune();
    return made;
}

void expectRefused(const FloatGrid::Ptr& grid, const std::string& part)
{
    std::vector<std::string> notes;
    try {
        distancesFromGrid(grid, "The cure.", notes);
        ADD_FAILURE() << "was taken";
    } catch (const InputError& e) {
        const std::string text = e.what();
        for (const std::string& wanted : {part, std::string("'surface'"), std::string("The cure.")})
            EXPECT_NE(text.find(wanted), std::string::npos) << text;
    }
}

std::vector<std::string> expectTaken(const FloatGrid::Ptr& grid, const LevelSet& like)
{
    std::vector<std::string> notes;
    const LevelSet taken = distancesFromGrid(grid, "", notes);
    EXPECT_NEAR(taken.halfWidth(), like.halfWidth(), 1e-4);
    EXPECT_TRUE(taken.grid().tree().hasSameTopology(like.grid().tree()));
    for (auto on = like.grid().cbeginValueOn(); on; ++on)
        EXPECT_EQ(taken.grid().tree().getValue(on.getCoord()), *on) << on.getCoord();
    Interrupter progress;
    const CheckReport report =
        check(taken.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << (report.sound() ? "" : report.findings[0].what);
    return notes;
}

/// What lies between voxels leaves a band without an inside: it has no surface to measure to.
TEST(GivenLevelSet, WithoutAnInsideItIsEmpty)
{
    const FloatGrid::Ptr grid = copyOf(ball());
    for (auto at = grid->beginValueAll(); at; ++at) at.setValue(std::abs(*at));
    std::vector<std::string> notes;
    const LevelSet taken = levelSetFromGrid(grid, notes);
    EXPECT_TRUE(taken.grid().empty());
    EXPECT_EQ(taken.grid().getName(), grid->getName());
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_NE(notes[0].find("has no surface"), std::string::npos) << notes[0];
}

TEST(GivenLevelSet, OfOursIsTheSame)
{
    for (const double halfWidth : {1.5, 3.0, 12.0}) {
        const LevelSet own = ball(halfWidth);
        std::vector<std::string> notes;
        const LevelSet taken = distancesFromGrid(own.gridPtr(), "", notes);
        EXPECT_EQ(&taken.grid(), &own.grid());
        EXPECT_TRUE(notes.empty());
    }
    Interrupter progress;
    const LevelSet thin = shell(ball(), 2 * kVoxel, Wall::Centered, &progress);
    std::vector<std::string> notes;
    EXPECT_EQ(&distancesFromGrid(thin.gridPtr(), "", notes).grid(), &thin.grid());
    const LevelSet nothing = emptyLevelSet({Vec3d::Zero(), kVoxel}, 3);
    EXPECT_NO_THROW(distancesFromGrid(nothing.gridPtr(), "", notes));
    EXPECT_TRUE(notes.empty());
}

TEST(GivenLevelSet, OfADenseArrayIsItsBand)
{
    const LevelSet own = ball();
    const FloatGrid::Ptr full = dense(own);
    EXPECT_GT(full->activeVoxelCount(), own.grid().activeVoxelCount());
    EXPECT_TRUE(expectTaken(full, own).empty());
}

TEST(GivenLevelSet, IsAsWideAsItsBand)
{
    const LevelSet own = ball();
    for (const float background : {1.0f, 0.05f}) {
        const FloatGrid::Ptr grid = copyOf(own);
        grid->tree().root().setBackground(background, true);
        const std::vector<std::string> notes = expectTaken(grid, own);
        ASSERT_EQ(notes.size(), 1u) << background;
        EXPECT_NE(notes[0].find("there are 3"), std::string::npos) << notes[0];
    }
}

TEST(GivenLevelSet, KeepsOneWidthWhereItHasTwo)
{
    const LevelSet wide = ball(6), own = ball(3);
    const FloatGrid::Ptr grid = copyOf(wide);
    for (auto leaf = grid->tree().beginLeaf(); leaf; ++leaf)
        for (auto on = leaf->beginValueOn(); on; ++on)
            if (*on >= own.grid().background()) {
                on.setValue(own.grid().background());
                on.setValueOff();
            }
    EXPECT_EQ(expectTaken(grid, own).size(), 1u);
}

/// A truncated field: an array of distances up to @a clip voxels, with a band that promises
/// @a promised. As far as @a reach voxels values are active.
FloatGrid::Ptr clippedBall(double clip, double promised, double reach)
{
    const FloatGrid::Ptr grid = FloatGrid::create(float(promised * kVoxel));
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel));
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName("surface");
    auto at = grid->getAccessor();
    for (auto c = openvdb::CoordBBox(Coord(-28), Coord(28)).begin(); c; ++c) {
        const double d = (*c).asVec3d().length() - 1 / kVoxel;
        if (std::abs(d) < reach) at.setValueOn(*c, float(std::clamp(d, -clip, clip) * kVoxel));
    }
    openvdb::tools::signedFloodFill(grid->tree());
    return grid;
}

/// The largest difference of a value from the distance to a ball, voxels.
double worstOf(const LevelSet& levelSet, double radius)
{
    double worst = 0;
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on)
        worst = std::max(worst, std::abs(*on / kVoxel - on.getCoord().asVec3d().length() + radius));
    return worst;
}

/// A zero set between voxels is known by planes: over a cell they are off by its diagonal squared
/// over eight radii.
double planeError(double radius)
{
    return 3 / (8 * radius);
}

TEST(GivenLevelSet, EndsWhereItsValuesAreClipped)
{
    const double radius = 1 / kVoxel;
    for (const double clip : {2.0, 2.9, 3.0})
        for (const double promised : {clip + 0.002, clip + 0.1, clip + 1, 6.0, 20.0})
            for (const double reach : {clip + 2, 50.0}) {
                std::vector<std::string> notes;
                const LevelSet taken =
                    distancesFromGrid(clippedBall(clip, promised, reach), "", notes);
                EXPECT_NEAR(taken.halfWidth(), clip, 1e-5) << promised;
                EXPECT_EQ(notes.size(), 1u) << promised;
                EXPECT_TRUE(check(taken.grid()).sound()) << promised;
                const LevelSet grown = offset(taken, 4 * kVoxel);
                EXPECT_TRUE(check(grown.grid()).sound()) << promised;
                EXPECT_LT(worstOf(grown, radius + 4), planeError(radius)) << promised;
            }
    // A plate's middle is no plateau, wherever it lies among leaves.
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = 1;
    for (int shift = 0; shift < 16; ++shift) {
        settings.lattice.origin = Vec3d::Constant(0.5 * shift);
        const LevelSet plate =
            sampleField(*makeSolidField(parseSolid("box(30, 30, 4)")), settings, &progress);
        std::vector<std::string> notes;
        EXPECT_EQ(&distancesFromGrid(plate.gridPtr(), "", notes).grid(), &plate.grid()) << shift;
    }
}

/// Scale the values of @a levelSet and its background.
FloatGrid::Ptr scaled(const LevelSet& levelSet, double scale)
{
    const FloatGrid::Ptr grid = copyOf(levelSet);
    grid->tree().root().setBackground(float(scale * grid->background()), false);
    for (auto v = grid->beginValueAll(); v; ++v) v.setValue(float(scale * *v));
    return grid;
}

TEST(GivenLevelSet, IsMeasuredAnewWhereCheckFindsNoDistances)
{
    const double radius = 1 / kVoxel;
    for (const double halfWidth : {3.0, 10.0})
        for (const double scale : {1 / kVoxel, 0.1, 0.5, 0.65, 0.8, 0.95, 1.05, 1.2, 1.5, 2.0}) {
            const FloatGrid::Ptr grid = scaled(ball(halfWidth), scale);
            std::vector<std::string> notes;
            const LevelSet taken = distancesFromGrid(grid, "", notes);
            if (std::abs(scale - 1) < kGradientTolerance) {
                EXPECT_EQ(&taken.grid(), grid.get()) << scale;
                continue;
            }
            ASSERT_FALSE(notes.empty()) << scale;
            EXPECT_NE(notes.back().find("not distances in world units"), std::string::npos);
            EXPECT_TRUE(check(taken.grid()).sound()) << scale;
            EXPECT_LT(worstOf(taken, radius), planeError(radius)) << scale;
            EXPECT_GE(taken.halfWidth(), 3 - 1e-5);
            EXPECT_LE(taken.halfWidth(), halfWidth + 1e-5);
            EXPECT_LT(worstOf(offset(taken, 0.3), radius + 6), planeError(radius)) << scale;
        }
}

TEST(GivenLevelSet, WithoutABandIsRefused)
{
    const FloatGrid::Ptr tile = copyOf(emptyLevelSet({Vec3d::Zero(), kVoxel}, 3));
    tile->tree().addTile(1, Coord(0), -tile->background(), false);
    expectRefused(tile, "at 384 of 384 faces (first at voxel 0, 0, 0)");
    const FloatGrid::Ptr large = copyOf(emptyLevelSet({Vec3d::Zero(), kVoxel}, 3));
    large->tree().addTile(2, Coord(0), -large->background(), false);
    expectRefused(large, "without a band");
    // A ball cut in two, as by an array that ends there.
    const FloatGrid::Ptr cut = copyOf(ball());
    cut->clip(openvdb::CoordBBox(Coord(-30), Coord(-1, 30, 30)));
    expectRefused(cut, "without a band");
    // What check() only complains of is taken, and told of.
    const FloatGrid::Ptr hole = copyOf(ball());
    for (int z = -1; z <= 1; ++z) hole->tree().setValueOff(Coord(20, 0, z));
    std::vector<std::string> notes;
    EXPECT_NO_THROW(distancesFromGrid(hole, "The cure.", notes));
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_NE(notes[0].find("without a band"), std::string::npos) << notes[0];
    EXPECT_NE(notes[0].find("The cure."), std::string::npos) << notes[0];
}

TEST(GivenLevelSet, IsJudgedWhereAFaceLiesBetweenLeaves)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = 1;
    settings.lattice.origin = Vec3d::Constant(0.5);
    const LevelSet cube =
        sampleField(*makeSolidField(parseSolid("box(16, 16, 16)")), settings, &progress);
    EXPECT_TRUE(hasSlopesOfDistances(cube));
    EXPECT_FALSE(hasSlopesOfDistances(LevelSet(scaled(cube, 10))));
}

} // namespace
} // namespace mpuvdb
