// Level sets made elsewhere: what is mended when they are taken in, and what is refused.
#include "solid_level_set.h"

#include <mpuvdb/error.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/operations.h>

#include <gtest/gtest.h>
#include <openvdb/tools/Dense.h>

#include <algorithm>

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
        requireDistances(levelSetFromGrid(grid, notes), "The cure.");
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
    const LevelSet taken = levelSetFromGrid(grid, notes);
    EXPECT_NO_THROW(requireDistances(taken, ""));
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
        const LevelSet taken = levelSetFromGrid(own.gridPtr(), notes);
        EXPECT_EQ(&taken.grid(), &own.grid());
        EXPECT_TRUE(notes.empty());
        EXPECT_NO_THROW(requireDistances(taken, ""));
    }
    Interrupter progress;
    const LevelSet thin = shell(ball(), 2 * kVoxel, Wall::Centered, &progress);
    std::vector<std::string> notes;
    EXPECT_EQ(&levelSetFromGrid(thin.gridPtr(), notes).grid(), &thin.grid());
    EXPECT_NO_THROW(requireDistances(thin, ""));
    const LevelSet nothing = emptyLevelSet({Vec3d::Zero(), kVoxel}, 3);
    EXPECT_NO_THROW(requireDistances(levelSetFromGrid(nothing.gridPtr(), notes), ""));
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

TEST(GivenLevelSet, WithoutDistancesIsRefused)
{
    for (const double scale : {1 / kVoxel, 0.1, 0.5, 2.0}) {
        const FloatGrid::Ptr grid = copyOf(ball());
        grid->tree().root().setBackground(float(scale * grid->background()), false);
        for (auto v = grid->beginValueAll(); v; ++v) v.setValue(float(scale * *v));
        expectRefused(grid, "not distances in world units");
    }
    // Filters and motions elsewhere change slopes by a few tenths.
    for (const double scale : {0.75, 1.3}) {
        const FloatGrid::Ptr grid = copyOf(ball());
        grid->tree().root().setBackground(float(scale * grid->background()), false);
        for (auto v = grid->beginValueAll(); v; ++v) v.setValue(float(scale * *v));
        EXPECT_NO_THROW(requireDistances(LevelSet(grid), ""));
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
    // What check() only complains of is taken.
    const FloatGrid::Ptr hole = copyOf(ball());
    for (int z = -1; z <= 1; ++z) hole->tree().setValueOff(Coord(20, 0, z));
    EXPECT_NO_THROW(requireDistances(LevelSet(hole), ""));
}

TEST(GivenLevelSet, IsJudgedWhereAFaceLiesBetweenLeaves)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = 1;
    settings.lattice.origin = Vec3d::Constant(0.5);
    const LevelSet cube =
        sampleField(*makeSolidField(parseSolid("box(16, 16, 16)")), settings, &progress);
    EXPECT_NO_THROW(requireDistances(cube, ""));
    const FloatGrid::Ptr steep = copyOf(cube);
    steep->tree().root().setBackground(10 * steep->background(), false);
    for (auto v = steep->beginValueAll(); v; ++v) v.setValue(10 * *v);
    expectRefused(steep, "change by 1");
}

} // namespace
} // namespace mpuvdb
