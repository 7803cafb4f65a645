// The modelling verbs of the command: what they make, what they refuse, and what they leave.
#include "command_process.h"

#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <openvdb/tools/ChangeBackground.h>

#include <fstream>
#include <iterator>

namespace mpuvdb::test
{
namespace
{

namespace fs = std::filesystem;
using nlohmann::json;

constexpr double kVoxel = 0.05;

LevelSet solid(const std::string& description, double voxelSize = kVoxel)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = voxelSize;
    return sampleField(*makeSolidField(parseSolid(description)), settings, &progress);
}

void write(const fs::path& file, const LevelSet& levelSet, const openvdb::GridCPtrVec& beside = {})
{
    Interrupter progress;
    writeLevelSet(file, levelSet, {}, beside, &progress);
}

double volumeOf(const fs::path& file)
{
    Interrupter progress;
    const LevelSet levelSet = readLevelSet(file);
    EXPECT_TRUE(
        check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress).sound())
        << file;
    return measure(levelSet, &progress).volume;
}

/// A folder with a ball, a box that cuts it, and a ball on coarser voxels.
class ModelVerbs : public ::testing::Test
{
protected:
    ModelVerbs()
    {
        write(folder / "ball.vdb", solid("sphere(1)"));
        write(folder / "box.vdb", solid("translate(box(1,1,1),0.9,0,0)"));
        write(folder / "coarse.vdb", solid("sphere(1)", 2 * kVoxel));
    }

    /// Run the command's words; it has to end with @a status.
    Ended command(std::vector<std::string> words, int status = 0)
    {
        words.insert(words.begin(), "mpuvdb");
        const Ended ended = run(folder, words);
        EXPECT_EQ(ended.status, status) << words[1] << "\n" << ended.err;
        return ended;
    }

    TemporaryFolder folder;
    const double ballVolume = 4.0 / 3 * M_PI;
    /// Of a volume: second order in the voxel, times the areas that there are here.
    const double tolerance = 15 * kVoxel * kVoxel;
};

// Grids whose voxels differ 40 times.
TEST_F(ModelVerbs, AskBeforeTheyMultiplyVoxels)
{
    write(folder / "large.vdb", solid("sphere(1)", 0.1));
    write(folder / "small.vdb", solid("translate(sphere(0.025), 1.2, 0, 0)", 0.0025));
    for (const char* verb : {"union", "difference", "intersection", "morph"}) {
        const Ended refused = command({verb, "small.vdb", "large.vdb", "-o", "a.vdb"}, 5);
        for (const char* said : {"64 times", "million voxels", "GB", "--voxel-size"})
            EXPECT_NE(refused.err.find(said), std::string::npos) << refused.err;
        EXPECT_FALSE(fs::exists(folder / "a.vdb"));
    }
    const Ended made = command({"union", "small.vdb", "large.vdb", "-o", "both.vdb", "--voxel-size",
                                "0.02", "--report", "report.json"});
    const auto estimate = made.err.find("estimate"), resampled = made.err.find("resampled");
    EXPECT_LT(estimate, resampled) << "what it takes is said before: " << made.err;
    EXPECT_NE(resampled, std::string::npos) << made.err;
    const json report = json::parse(readFile(folder / "report.json"));
    const double voxels = report["grid"]["active_voxels"];
    EXPECT_NEAR(double(report["estimate"]["active_voxels"]), voxels, 0.3 * voxels);
    EXPECT_EQ(report["settings"]["voxel_size"], 0.02);
    EXPECT_NEAR(volumeOf(folder / "both.vdb"), ballVolume, 0.02 * ballVolume);
    command(
        {"morph", "small.vdb", "large.vdb", "-o", "way.vdb", "--at", "1", "--voxel-size", "0.05"});
    EXPECT_NEAR(volumeOf(folder / "way.vdb"), ballVolume, 0.02 * ballVolume);
    command({"union", "small.vdb", "large.vdb", "-o", "a.vdb", "--voxel-size", "0"}, 2);
}

TEST_F(ModelVerbs, SayWhatResamplingTakesBeforeIt)
{
    const Ended ended = command({"union", "ball.vdb", "coarse.vdb", "-o", "a.vdb"});
    EXPECT_LT(ended.err.find("estimate"), ended.err.find("resampled")) << ended.err;
    EXPECT_EQ(command({"union", "ball.vdb", "box.vdb", "-o", "a.vdb"}).err.find("estimate"),
              std::string::npos)
        << "nothing is resampled";
    const Ended refused = command({"union", "ball.vdb", "coarse.vdb", "-o", "b.vdb", "--voxel-size",
                                   "0.01", "--max-memory", "30M"},
                                  5);
    EXPECT_NE(refused.err.find("voxels of size"), std::string::npos) << refused.err;
}

TEST_F(ModelVerbs, BooleansKeepTheBalanceOfVolumes)
{
    command({"union", "ball.vdb", "box.vdb", "-o", "both.vdb"});
    command({"intersection", "ball.vdb", "box.vdb", "-o", "common.vdb"});
    command({"difference", "ball.vdb", "box.vdb", "-o", "cut.vdb"});
    const double both = volumeOf(folder / "both.vdb"), common = volumeOf(folder / "common.vdb");
    EXPECT_NEAR(both + common, ballVolume + 1, tolerance);
    EXPECT_NEAR(volumeOf(folder / "cut.vdb"), ballVolume - common, tolerance);
    command({"union", "ball.vdb", "box.vdb", "-o", "filleted.vdb", "--blend", "0.2"});
    EXPECT_GT(volumeOf(folder / "filleted.vdb"), both);
    command({"union", "ball.vdb", "box.vdb", "-o", "x.vdb", "--blend=-1"}, 2);
    // A band holds 1000 voxels, of which 3 are the result's.
    const Ended far = command({"union", "ball.vdb", "box.vdb", "-o", "x.vdb", "--blend", "100"}, 5);
    for (const char* const part : {"radius 100", "2000 voxels of 0.05", "at most 49.85"})
        EXPECT_NE(far.err.find(part), std::string::npos) << far.err;
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, OtherLatticesAreResampledAndSaid)
{
    const Ended ended =
        command({"union", "coarse.vdb", "box.vdb", "-o", "both.vdb", "--report", "report.json"});
    const json report = json::parse(readFile(folder / "report.json"));
    ASSERT_EQ(report["settings"]["resampled"].size(), 1u);
    // Both grids are called 'surface': only the files tell them apart.
    const std::string said = report["settings"]["resampled"][0];
    EXPECT_EQ(said.find("coarse.vdb"), 0u) << said;
    EXPECT_NE(said.find("to the lattice of box.vdb"), std::string::npos) << said;
    EXPECT_NE(ended.err.find(said), std::string::npos) << ended.err;
    EXPECT_NEAR(report["grid"]["voxel_size"].get<double>(), kVoxel, 1e-6);
}

TEST_F(ModelVerbs, OffsetsAndShellsMeasureRight)
{
    command({"offset", "ball.vdb", "-o", "large.vdb", "--distance", "0.3"});
    EXPECT_NEAR(volumeOf(folder / "large.vdb"), ballVolume * std::pow(1.3, 3), tolerance);
    command({"offset", "ball.vdb", "-o", "small.vdb", "--distance=-6vx"});
    EXPECT_NEAR(volumeOf(folder / "small.vdb"), ballVolume * std::pow(0.7, 3), tolerance);
    command({"shell", "ball.vdb", "-o", "hollow.vdb", "--thickness", "0.2"});
    EXPECT_NEAR(volumeOf(folder / "hollow.vdb"), ballVolume * (1 - std::pow(0.8, 3)),
                2 * tolerance);
    command({"shell", "ball.vdb", "-o", "x.vdb", "--thickness", "1vx"}, 5);
    const Ended none = command({"offset", "ball.vdb", "-o", "none.vdb", "--distance=-2"});
    EXPECT_NE(none.err.find("empty"), std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, MorphWritesAFileForEveryFrame)
{
    command({"morph", "ball.vdb", "box.vdb", "--frames", "8-10", "-o", "m.####.vdb"});
    EXPECT_NEAR(volumeOf(folder / "m.0008.vdb"), ballVolume, tolerance);
    EXPECT_NEAR(volumeOf(folder / "m.0010.vdb"), 1, tolerance);
    const double middle = volumeOf(folder / "m.0009.vdb");
    EXPECT_GT(middle, 1);
    EXPECT_LT(middle, ballVolume);
    command({"morph", "ball.vdb", "box.vdb", "--frames", "8-10", "--only", "9", "-o", "n.$F3.vdb"});
    EXPECT_EQ(readFile(folder / "n.009.vdb"), readFile(folder / "m.0009.vdb"));
    EXPECT_FALSE(fs::exists(folder / "n.008.vdb"));
    command({"morph", "ball.vdb", "box.vdb", "--frames", "8-10", "-o", "same.vdb"}, 2);
    command({"morph", "ball.vdb", "box.vdb", "--frames", "-2-0x2", "-o", "early.####.vdb"});
    for (const char* name : {"early.-002.vdb", "early.0000.vdb"})
        EXPECT_TRUE(fs::exists(folder / name)) << name;
    command({"morph", "ball.vdb", "box.vdb", "--frames", "10-8", "-o", "m.##.vdb"}, 2);
    command({"morph", "ball.vdb", "box.vdb", "--at", "2", "-o", "x.vdb"}, 2);
}

TEST_F(ModelVerbs, MorphsMixAttributes)
{
    const auto colored = [&](const std::string& file, double radius, const openvdb::Vec3f& color) {
        const LevelSet ball = solid("sphere(" + std::to_string(radius) + ")");
        const auto colors = openvdb::Vec3SGrid::create();
        colors->setName("Cd");
        colors->setTransform(ball.grid().transform().copy());
        colors->tree().topologyUnion(ball.grid().tree());
        for (auto at = colors->beginValueOn(); at; ++at) at.setValue(color);
        write(folder / file, ball, {colors});
    };
    colored("red.vdb", 1, {1, 0, 0});
    colored("blue.vdb", 0.8, {0, 0, 1});
    for (const char* const at : {"0", "0.25", "1"}) {
        command({"morph", "red.vdb", "blue.vdb", "-o", "x.vdb", "--at", at});
        const auto grids = readAttributeGrids(folder / "x.vdb", {"Cd"});
        const auto colors = openvdb::gridPtrCast<openvdb::Vec3SGrid>(grids[0]);
        ASSERT_TRUE(colors && colors->activeVoxelCount() > 0);
        const float t = std::stof(at);
        for (auto color = colors->cbeginValueOn(); color; ++color) {
            ASSERT_NEAR((*color)[0], 1 - t, 0.01); // of half floats and bytes
            ASSERT_NEAR((*color)[2], t, 0.01);
        }
    }
}

TEST_F(ModelVerbs, AxesHaveNames)
{
    const auto twisted = [&](const std::string& axis) {
        command({"twist", "box.vdb", "-o", "twisted.vdb", "--turn", "60", "--axis=" + axis});
        std::ifstream file(folder / "twisted.vdb", std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    EXPECT_TRUE(twisted("y") == twisted("0,1,0"));
    EXPECT_TRUE(twisted("-x") == twisted("-1,0,0"));
    EXPECT_TRUE(twisted("Z") == twisted("0,0,1"));
    EXPECT_FALSE(twisted("x") == twisted("y"));
    for (const char* const axis : {"--axis=w", "--axis=xy", "--axis=-", "--axis="})
        command({"twist", "box.vdb", "-o", "x.vdb", "--turn", "60", axis}, 2);
}

TEST_F(ModelVerbs, MotionsKeepVolumes)
{
    command({"twist", "box.vdb", "-o", "twisted.vdb", "--turn", "60"});
    EXPECT_NEAR(volumeOf(folder / "twisted.vdb"), 1, tolerance);
    command(
        {"transform", "box.vdb", "-o", "turned.vdb", "--rotate", "10,20,30", "--about", "0.9,0,0"});
    EXPECT_NEAR(volumeOf(folder / "turned.vdb"), 1, tolerance);
    command({"transform", "box.vdb", "-o", "scaled.vdb", "--scale", "2"});
    EXPECT_NEAR(volumeOf(folder / "scaled.vdb"), 8, 4 * tolerance);
    command({"transform", "box.vdb", "-o", "stretched.vdb", "--scale", "1,2,0.5"});
    EXPECT_NEAR(volumeOf(folder / "stretched.vdb"), 1, 2 * tolerance);
    command({"resample", "box.vdb", "-o", "fine.vdb", "--voxel-size", "0.5vx"});
    EXPECT_NEAR(volumeOf(folder / "fine.vdb"), 1, tolerance);
    command({"transform", "box.vdb", "-o", "x.vdb", "--scale", "0"}, 2);
    const Ended tiny = command({"transform", "box.vdb", "-o", "x.vdb", "--scale", "0.001"}, 2);
    EXPECT_NE(tiny.err.find("--with-voxels"), std::string::npos) << tiny.err;
    command({"transform", "box.vdb", "-o", "x.vdb", "--scale", "0.001", "--with-voxels"});
}

TEST_F(ModelVerbs, ComponentsAreListedAndKept)
{
    write(folder / "two.vdb", solid("union(sphere(0.6), translate(sphere(0.3),2,0,0))"));
    const json list = json::parse(command({"components", "two.vdb", "--json"}).out);
    ASSERT_EQ(list["components"].size(), 2u);
    const double large = 4.0 / 3 * M_PI * std::pow(0.6, 3);
    EXPECT_NEAR(list["components"][0]["volume"].get<double>(), large, tolerance);
    command({"components", "two.vdb", "-o", "one.vdb", "--keep", "1"});
    EXPECT_NEAR(volumeOf(folder / "one.vdb"), large, tolerance);
    command({"components", "two.vdb", "--keep", "1"}, 2);
}

TEST_F(ModelVerbs, FogAndMeshesGoThere)
{
    command({"fog", "ball.vdb", "-o", "fog.vdb", "--keep-surface"});
    const openvdb::GridPtrVec grids = readGrids(folder / "fog.vdb");
    ASSERT_EQ(grids.size(), 2u);
    EXPECT_EQ(grids[0]->getGridClass(), openvdb::GRID_FOG_VOLUME);
    EXPECT_EQ(grids[1]->getGridClass(), openvdb::GRID_LEVEL_SET);
    command({"mesh", "ball.vdb", "-o", "ball.ply"});
    command({"voxelize", "ball.ply", "-o", "again.vdb", "--voxel-size", "0.05"});
    EXPECT_NEAR(volumeOf(folder / "again.vdb"), ballVolume, tolerance);
}

TEST_F(ModelVerbs, OtherGridsPassThrough)
{
    const auto density = openvdb::FloatGrid::create(0.25f);
    density->setName("density");
    density->tree().setValue(openvdb::Coord(1, 2, 3), 0.5f);
    const LevelSet ball = solid("sphere(1)");
    density->setTransform(ball.grid().transform().copy());
    write(folder / "several.vdb", ball, {density});
    command({"offset", "several.vdb", "-o", "grown.vdb", "--distance", "0.1"});
    bool found = false;
    for (const auto& grid : readGrids(folder / "grown.vdb"))
        if (const auto floats = openvdb::gridPtrCast<openvdb::FloatGrid>(grid);
            grid->getName() == "density")
            found = floats->tree().getValue(openvdb::Coord(1, 2, 3)) == 0.5f;
    EXPECT_TRUE(found);
    command({"offset", "several.vdb", "--grid", "density", "-o", "x.vdb", "--distance", "0.1"}, 3);
}

TEST_F(ModelVerbs, GridsKeepTheirNames)
{
    command({"merge", "hull=ball.vdb", "-o", "named.vdb"});
    const std::vector<std::vector<std::string>> verbs = {
        {"transform", "named.vdb", "--translate", "0,0,0.5"},
        {"twist", "named.vdb", "--turn", "90"},
        {"taper", "named.vdb", "--end-factor", "0.5"},
        {"resample", "named.vdb", "--voxel-size", "2vx"},
        {"components", "named.vdb", "--keep", "1"},
        {"difference", "named.vdb", "box.vdb"},
        {"difference", "named.vdb", "ball.vdb"}, // nothing is left, here and by the next
        {"offset", "named.vdb", "--distance", "-3"}};
    for (std::vector<std::string> words : verbs) {
        words.insert(words.end(), {"-o", "made.vdb"});
        command(words);
        const auto grids = readGrids(folder / "made.vdb");
        ASSERT_EQ(grids.size(), 1u) << words[0];
        EXPECT_EQ(grids[0]->getName(), "hull") << words[0];
    }
}

// Of the first input: what others wrote of their shot, in the file and with the grid.
TEST_F(ModelVerbs, MetadataGoAlong)
{
    Interrupter progress;
    openvdb::MetaMap ofFile;
    ofFile.insertMeta("scene", openvdb::StringMetadata("arm.hip"));
    auto grid = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    grid->insertMeta("frame", openvdb::Int32Metadata(7));
    writeGrids(folder / "shot.vdb", {grid}, ofFile, &progress);
    for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
             {"transform", "shot.vdb", "-o", "x.vdb", "--translate", "1,0,0"},
             {"resample", "shot.vdb", "-o", "x.vdb", "--voxel-size", "0.08"},
             {"union", "shot.vdb", "box.vdb", "-o", "x.vdb"},
             {"analyze", "shot.vdb", "-o", "x.vdb"},
             {"fog", "shot.vdb", "-o", "x.vdb"},
             {"merge", "shot.vdb", "box=box.vdb", "-o", "x.vdb"}}) {
        SCOPED_TRACE(words[0]);
        command(words);
        EXPECT_EQ(readFileMetadata(folder / "x.vdb").metaValue<std::string>("scene"), "arm.hip");
        const openvdb::GridCPtrVec heads = readGridHeads(folder / "x.vdb");
        EXPECT_TRUE(std::any_of(heads.begin(), heads.end(), [](const auto& head) {
            const auto frame = head->template getMetadata<openvdb::Int32Metadata>("frame");
            return frame && frame->value() == 7;
        }));
    }
}

TEST_F(ModelVerbs, AGridOfTheResultsNameGivesWay)
{
    const auto density = openvdb::FloatGrid::create();
    density->setName("density");
    density->denseFill(openvdb::CoordBBox(openvdb::Coord(0), openvdb::Coord(9)), 1.0f, true);
    write(folder / "several.vdb", solid("sphere(1)"), {density});
    const auto countOf = [&](const std::string& file, const std::string& name) {
        const auto grids = readGrids(folder / file);
        return std::count_if(grids.begin(), grids.end(),
                             [&](const auto& grid) { return grid->getName() == name; });
    };
    const std::string gave = "gives way to the one that is made";
    const Ended fog = command({"fog", "several.vdb", "-o", "fog.vdb"});
    EXPECT_NE(fog.err.find("'density' " + gave), std::string::npos) << fog.err;
    EXPECT_EQ(countOf("fog.vdb", "density"), 1);
    const Ended iso = command({"isosurface", "several.vdb", "--grid", "density", "-o", "iso.vdb"});
    EXPECT_NE(iso.err.find("'surface' " + gave), std::string::npos) << iso.err;
    EXPECT_EQ(countOf("iso.vdb", "surface"), 1);
}

TEST_F(ModelVerbs, NothingIsInsideAtTheLargestValue)
{
    command({"fog", "ball.vdb", "-o", "fog.vdb"});
    const Ended ended = command({"isosurface", "fog.vdb", "-o", "x.vdb", "--value", "1"}, 3);
    EXPECT_NE(ended.err.find("its largest value is 1"), std::string::npos) << ended.err;
}

TEST_F(ModelVerbs, WhatFloatsDoNotHoldIsRefused)
{
    command({"transform", "ball.vdb", "-o", "large.vdb", "--scale", "1e18", "--with-voxels"});
    command({"mesh", "large.vdb", "-o", "large.ply"});
    for (const char* const scale : {"1e30", "1e40"}) {
        const Ended ended =
            command({"transform", "ball.vdb", "-o", "x.vdb", "--scale", scale, "--with-voxels"}, 5);
        EXPECT_NE(ended.err.find("Scale the model"), std::string::npos) << ended.err;
    }
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, FarAwayIsAsGoodAPlaceAsAny)
{
    command({"transform", "ball.vdb", "-o", "far.vdb", "--translate", "7e5,0,-3e6"});
    command({"check", "far.vdb"});
    command({"transform", "far.vdb", "-o", "back.vdb", "--translate=-7e5,0,3e6"});
    EXPECT_NEAR(volumeOf(folder / "back.vdb"), ballVolume, tolerance);
}

TEST_F(ModelVerbs, WhatIsMissingDoesNotHideTheRestFromCheck)
{
    const Ended ended = command({"check", "ball.vdb", "no.vdb", "ball.vdb"}, 3);
    EXPECT_NE(ended.err.find("no.vdb: cannot be read"), std::string::npos) << ended.err;
    EXPECT_EQ(std::count(ended.out.begin(), ended.out.end(), '\n'), 2) << ended.out;
}

TEST_F(ModelVerbs, OptionsThatMeanNothingAreRefused)
{
    command({"smooth", "ball.vdb", "-o", "x.vdb", "--mask-grid", "density"}, 2);
    command({"smooth", "ball.vdb", "-o", "x.vdb", "--filter", "curvature", "--width", "2"}, 2);
    command({"components", "ball.vdb", "-o", "x.vdb", "--keep", "-1"}, 2);
    command({"components", "ball.vdb", "-o", "x.vdb", "--keep", "0"}, 2);
    const Ended large = command({"resample", "ball.vdb", "-o", "x.vdb", "--voxel-size", "1000"}, 5);
    EXPECT_NE(large.err.find("take voxels of at most"), std::string::npos) << large.err;
    const Ended loose = command({"mesh", "ball.vdb", "-o", "x.ply", "--tolerance", "10"}, 2);
    EXPECT_NE(loose.err.find("nothing of its form"), std::string::npos) << loose.err;
    EXPECT_FALSE(fs::exists(folder / "x.ply"));
    command({"sample", "sphere(1)", "-o", "points.ply", "--points", "2000"});
    for (const char* const tolerance : {"10", "0"})
        command({"reconstruct", "points.ply", "-o", "x.vdb", "--mesh", "x.ply", "--mesh-tolerance",
                 tolerance},
                2);
    EXPECT_FALSE(fs::exists(folder / "x.vdb")) << "refused after half of the work was written";
    for (const char* const output : {"x.obj", "x.ply", "-"}) {
        const Ended unit = command({"mesh", "ball.vdb", "-o", output, "--units", "mm"}, 2);
        EXPECT_NE(unit.err.find("--units: no output stores it"), std::string::npos) << unit.err;
        command({"mesh", "ball.vdb", "-o", output, "--up", "y"}, 2);
    }
    command({"merge", "ball.vdb", "-o", "x.vdb", "--up", "z"}, 2);
    command({"mesh", "ball.vdb", "-o", "up.usda", "--up", "z", "--units", "mm"});
    command({"slice", "ball.vdb", "-o", "x.png", "--units", "mm"}, 2);
    command({"slice", "ball.vdb", "-o", "x.svg", "--pixels", "64"}, 2);
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, WhatIsNoLevelSetIsRefused)
{
    command({"fog", "ball.vdb", "-o", "fog.vdb"});
    const Ended fog = command({"offset", "fog.vdb", "-o", "x.vdb", "--distance", "0.1"}, 3);
    for (const char* const part : {"fog.vdb", "'density' (fog volume, float)",
                                   "mpuvdb isosurface fog.vdb --grid 'density' --value 0.5"})
        EXPECT_NE(fog.err.find(part), std::string::npos) << fog.err;
    auto stretched = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    stretched->transform().preScale(openvdb::Vec3d(1, 2, 1));
    Interrupter progress;
    writeGrids(folder / "stretched.vdb", {stretched}, &progress);
    const Ended uneven = command({"union", "ball.vdb", "stretched.vdb", "-o", "x.vdb"}, 3);
    for (const char* const part : {"stretched.vdb", "0.05 x 0.1 x 0.05", "VDB Resample"})
        EXPECT_NE(uneven.err.find(part), std::string::npos) << uneven.err;
    const auto vectors = openvdb::Vec3SGrid::create();
    vectors->setName("v");
    writeGrids(folder / "vectors.vdb", {vectors}, &progress);
    const Ended staggered = command({"union", "ball.vdb", "vectors.vdb", "-o", "x.vdb"}, 3);
    EXPECT_NE(staggered.err.find("as a grid of floats"), std::string::npos) << staggered.err;
    command({"isosurface", "vectors.vdb", "-o", "x.vdb"}, 3);
    command({"isosurface", "stretched.vdb", "-o", "x.vdb"}, 3);
    stretched->setGridClass(openvdb::GRID_UNKNOWN);
    writeGrids(folder / "unknown.vdb", {stretched}, &progress);
    const Ended unknown = command({"union", "ball.vdb", "unknown.vdb", "-o", "x.vdb"}, 3);
    EXPECT_NE(unknown.err.find("are not cubes: resample it"), std::string::npos) << unknown.err;
    command({"union", "ball.vdb", "missing.vdb", "-o", "x.vdb"}, 3);
    command({"union", "ball.vdb", "-o", "ball.vdb"}, 2);
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, ValuesThatAreNoDistancesAreMeasuredAnewOrRefusedWithACure)
{
    // Distances in voxels.
    auto voxels = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    voxels->tree().root().setBackground(float(voxels->background() / kVoxel), false);
    for (auto v = voxels->beginValueAll(); v; ++v) v.setValue(float(*v / kVoxel));
    // Inside without a band.
    auto open = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(
        emptyLevelSet({Vec3d::Zero(), kVoxel}, 3).grid());
    open->tree().addTile(1, openvdb::Coord(0), -open->background(), false);
    Interrupter progress;
    writeGrids(folder / "voxels.vdb", {voxels}, &progress);
    writeGrids(folder / "open.vdb", {open}, &progress);
    for (const std::string file : {"voxels.vdb", "open.vdb"}) {
        const std::string said =
            file == "voxels.vdb"
                ? "not distances in world units"
                : "mpuvdb isosurface open.vdb --grid 'surface' --value 0 --inside below";
        const std::vector<std::vector<std::string>> all = {
            {"union", file, "ball.vdb"},
            {"difference", "box.vdb", file},
            {"offset", file, "--distance", "2vx"},
            {"shell", file, "--thickness", "4vx"},
            {"smooth", file},
            {"morph", "ball.vdb", file},
            {"twist", file, "--turn", "90"},
            {"transform", file, "--scale", "2"},
            {"resample", file, "--voxel-size", "2vx"},
            {"components", file},
            {"fog", file}};
        for (std::vector<std::string> words : all) {
            words.insert(words.end(), {"-o", "x.vdb"});
            const Ended ended = command(words, file == "open.vdb" ? 3 : 0);
            EXPECT_NE(ended.err.find(said), std::string::npos) << ended.err;
            EXPECT_EQ(fs::remove(folder / "x.vdb"), file == "voxels.vdb");
        }
        command({"isosurface", file, "-o", "mended.vdb", "--value", "0", "--inside", "below"});
        command({"offset", "mended.vdb", "-o", "grown.vdb", "--distance", "2vx"});
        const double edge = 8 * kVoxel;
        EXPECT_NEAR(volumeOf(folder / "mended.vdb"),
                    file == "open.vdb" ? edge * edge * edge : ballVolume, tolerance);
        command({"mesh", file, "-o", "shown.ply"}, file == "open.vdb" ? 4 : 0);
    }
}

TEST_F(ModelVerbs, BandsAreTakenForWhatTheyAre)
{
    auto promising = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    promising->tree().root().setBackground(1, true);
    Interrupter progress;
    writeGrids(folder / "promising.vdb", {promising}, &progress);
    const Ended ended = command({"union", "promising.vdb", "box.vdb", "-o", "both.vdb"});
    EXPECT_NE(ended.err.find("promises a band of 20 voxels, and there are 3"), std::string::npos)
        << ended.err;
    EXPECT_GT(volumeOf(folder / "both.vdb"), ballVolume);
    write(folder / "narrow.vdb", withHalfWidth(solid("sphere(1)"), 1.5, &progress));
    auto narrow =
        openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(readLevelSet(folder / "narrow.vdb").grid());
    const auto width = float(1.2 * kVoxel);
    for (auto on = narrow->beginValueOn(); on; ++on)
        if (std::abs(*on) >= width) on.setValueOff();
    openvdb::tools::changeLevelSetBackground(narrow->tree(), width);
    writeGrids(folder / "narrow.vdb", {narrow}, &progress);
    for (const std::vector<std::string>& words : {std::vector<std::string>{"twist", "--turn", "90"},
                                                  {"transform", "--scale", "1"},
                                                  {"resample", "--voxel-size", "1vx"},
                                                  {"smooth"}}) {
        std::vector<std::string> all = words;
        all.insert(all.end(), {"narrow.vdb", "-o", "wide.vdb"});
        EXPECT_NE(command(all).err.find("too narrow"), std::string::npos) << words[0];
        EXPECT_NEAR(volumeOf(folder / "wide.vdb"), ballVolume, 3 * tolerance);
    }
}

TEST_F(ModelVerbs, TwistsFarFromTheAxisNameTheCenter)
{
    command({"transform", "ball.vdb", "-o", "away.vdb", "--translate", "100,-8,3"});
    const Ended far = command({"twist", "away.vdb", "-o", "x.vdb", "--turn", "90"}, 2);
    EXPECT_NE(far.err.find("--center 100,-8,3"), std::string::npos) << far.err;
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
    const Ended little =
        command({"twist", "away.vdb", "-o", "little.vdb", "--degrees-per-unit", "1"});
    EXPECT_NE(little.err.find("--center 100,-8,3"), std::string::npos) << little.err;
    EXPECT_NEAR(volumeOf(folder / "little.vdb"), ballVolume, 2 * tolerance);
    const Ended there =
        command({"twist", "away.vdb", "-o", "there.vdb", "--turn", "90", "--center", "100,-8,3"});
    EXPECT_EQ(there.err.find("off the axis"), std::string::npos) << there.err;
    EXPECT_NEAR(volumeOf(folder / "there.vdb"), ballVolume, tolerance);
    for (const std::vector<std::string>& words :
         {std::vector<std::string>{"bend", "--angle", "10"}, {"taper", "--end-factor", "0.9"}}) {
        std::vector<std::string> all{words[0], "away.vdb", "-o", words[0] + ".vdb"};
        all.insert(all.end(), words.begin() + 1, words.end());
        EXPECT_NE(command(all).err.find("--center 100,-8,3"), std::string::npos) << words[0];
    }
    const Ended along =
        command({"bend", "ball.vdb", "-o", "x.vdb", "--angle", "9", "--towards", "z"}, 2);
    EXPECT_NE(along.err.find("--towards"), std::string::npos) << along.err;
    // A library's message that begins with the verb's name does not say it twice.
    const Ended none = command({"shell", "ball.vdb", "-o", "x.vdb", "--thickness", "0"}, 2);
    EXPECT_NE(none.err.find("mpuvdb shell: thickness is 0"), std::string::npos) << none.err;
}

TEST_F(ModelVerbs, SayWhereNothingComesOfIt)
{
    const auto says = [&](std::vector<std::string> words, const std::string& what, int status = 0) {
        const std::string said = command(std::move(words), status).err;
        EXPECT_NE(said.find(what), std::string::npos) << said;
    };
    const auto saysNothing = [&](std::vector<std::string> words, const std::string& what) {
        const std::string said = command(std::move(words)).err;
        EXPECT_EQ(said.find(what), std::string::npos) << said;
    };
    // Walls that meet in the middle of the ball.
    says({"shell", "ball.vdb", "-o", "x.vdb", "--thickness", "1.5"}, "nothing of it is hollow");
    saysNothing({"shell", "ball.vdb", "-o", "x.vdb", "--thickness", "0.7"}, "hollow");
    saysNothing({"shell", "ball.vdb", "-o", "x.vdb", "--thickness", "3", "--wall", "outward"},
                "hollow");
    // A mask that is a level set, one that lies elsewhere, and one that is there.
    says({"smooth", "ball.vdb", "-o", "x.vdb", "--mask", "box.vdb"}, "is a level set", 3);
    command({"transform", "box.vdb", "-o", "away.vdb", "--translate", "9,0,0"});
    command({"fog", "away.vdb", "-o", "far.vdb"});
    command({"fog", "box.vdb", "-o", "near.vdb"});
    says({"smooth", "ball.vdb", "-o", "x.vdb", "--mask", "far.vdb"}, "nothing was smoothed");
    saysNothing({"smooth", "ball.vdb", "-o", "x.vdb", "--mask", "near.vdb"}, "nothing");
    // Nothing has a distance from an empty level set.
    command({"clip", "ball.vdb", "-o", "empty.vdb", "--box", "5", "5", "5", "6", "6", "6"});
    command({"sample", "sphere(1)", "-o", "points.ply", "--points", "1000"});
    command({"bend", "empty.vdb", "-o", "x.vdb", "--angle", "90"});
    says({"measure", "empty.vdb", "--points", "points.ply", "-o", "x.ply"}, "is empty", 3);
    says({"info", "ball.vdb", "--against", "empty.vdb"}, "is empty", 3);
    EXPECT_FALSE(fs::exists(folder / "x.ply"));
}

TEST_F(ModelVerbs, LevelSetsAreComparedWithPointsAndMeshes)
{
    command({"sample", "sphere(1)", "-o", "points.ply", "--points", "1000"});
    command({"mesh", "box.vdb", "-o", "box.ply"});
    for (const std::string other : {"points.ply", "box.ply", "box.vdb"}) {
        const Ended told = command({"info", "ball.vdb", "--against", other, "--json"});
        const json mesh = json::parse(told.out)["files"][0]["mesh"];
        EXPECT_NEAR(mesh["volume"], ballVolume, tolerance);
        const double largest = mesh["against"]["distance_from_it"]["max"];
        // Points of the ball are on it; the box's far corners are beside it.
        const double truth = other == "points.ply" ? 0 : std::sqrt(1.4 * 1.4 + 0.5) - 1;
        EXPECT_NEAR(largest, truth, kVoxel) << other;
    }
}

TEST_F(ModelVerbs, NumbersMayBeginWithTheirPoint)
{
    command({"clip", "ball.vdb", "-o", "a.vdb", "--box", "-.5", "-.5", "-.5", ".5", ".5", ".5"});
    command(
        {"clip", "ball.vdb", "-o", "b.vdb", "--box", "-0.5", "-0.5", "-0.5", "0.5", "0.5", "0.5"});
    EXPECT_NEAR(volumeOf(folder / "a.vdb"), volumeOf(folder / "b.vdb"), 1e-12);
}

TEST_F(ModelVerbs, MemoryOfATaperIsThatOfItsNarrowEnd)
{
    // A bar a hundred times as long as it is thick, drawn out at its far end.
    command({"sample", "box(0.2,0.2,20)", "-o", "bar.ply", "--points", "60000"});
    command({"reconstruct", "bar.ply", "-o", "bar.vdb", "--voxel-size", "0.02"});
    command({"taper", "bar.vdb", "-o", "x.vdb", "--end-factor", "0.3", "--max-memory", "1G"});
}

TEST_F(ModelVerbs, ChecksTellWhereThereIsNoLevelSet)
{
    command({"fog", "ball.vdb", "-o", "fog.vdb"});
    const Ended fog = command({"check", "fog.vdb", "ball.vdb"}, 3);
    EXPECT_NE(fog.err.find("fog.vdb: has no level set, but 'density' (fog volume, float)"),
              std::string::npos)
        << fog.err;
    EXPECT_NE(fog.out.find("ball.vdb: surface: sound"), std::string::npos) << fog.out;
    command({"check", "fog.vdb", "--grid", "density"}, 4);
}

TEST_F(ModelVerbs, DensitiesBecomeLevelSetsWhereTheyHaveAValue)
{
    // A density is 0 at the surface and 1 three voxels below.
    command({"fog", "ball.vdb", "-o", "fog.vdb", "--keep-surface"});
    command({"isosurface", "fog.vdb", "-o", "half.vdb", "--value", "0.5", "--grid", "density"});
    EXPECT_NEAR(volumeOf(folder / "half.vdb"), ballVolume * std::pow(1 - 1.5 * kVoxel, 3),
                tolerance);
    const Ended none = command({"isosurface", "fog.vdb", "-o", "x.vdb", "--value", "2"}, 3);
    EXPECT_NE(none.err.find("largest value is 1"), std::string::npos) << none.err;
    const Ended all = command({"isosurface", "fog.vdb", "-o", "x.vdb", "--value", "-1"}, 2);
    EXPECT_NE(all.err.find("has to be above"), std::string::npos) << all.err;
    // Distances that do not say so.
    auto distances = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    distances->setGridClass(openvdb::GRID_UNKNOWN);
    distances->setName("sdf");
    Interrupter progress;
    writeGrids(folder / "sdf.vdb", {distances}, &progress);
    const Ended said = command({"shell", "sdf.vdb", "-o", "x.vdb", "--thickness", "0.2"}, 3);
    EXPECT_NE(said.err.find("--value 0 --inside below"), std::string::npos) << said.err;
    for (const char* const value : {"0.1", "0.5"}) {
        const Ended above =
            run(folder, {"mpuvdb", "isosurface", "sdf.vdb", "-o", "x.vdb", "--value", value});
        EXPECT_NE(above.err.find("--value 0 --inside below"), std::string::npos) << above.err;
    }
    command({"isosurface", "sdf.vdb", "-o", "back.vdb", "--value", "0", "--inside", "below"});
    EXPECT_NEAR(volumeOf(folder / "back.vdb"), ballVolume, tolerance);
    EXPECT_FALSE(fs::exists(folder / "x.vdb"));
}

TEST_F(ModelVerbs, HalfFloatsAndEmptyOnesAreTaken)
{
    auto half = openvdb::deepCopyTypedGrid<openvdb::FloatGrid>(solid("sphere(1)").grid());
    half->setSaveFloatAsHalf(true);
    Interrupter progress;
    writeGrids(folder / "half.vdb", {half}, &progress);
    command({"difference", "half.vdb", "box.vdb", "-o", "cut.vdb"});
    volumeOf(folder / "cut.vdb");
    write(folder / "nothing.vdb", emptyLevelSet({Vec3d::Zero(), kVoxel}, 3));
    command({"union", "nothing.vdb", "ball.vdb", "-o", "ball2.vdb"});
    EXPECT_NEAR(volumeOf(folder / "ball2.vdb"), ballVolume, tolerance);
    for (const char* const verb : {"offset", "shell", "smooth", "twist", "transform", "resample"}) {
        std::vector<std::string> words = {verb, "nothing.vdb", "-o", "still.vdb"};
        if (words[0] == "offset") words.insert(words.end(), {"--distance", "0.1"});
        if (words[0] == "shell") words.insert(words.end(), {"--thickness", "0.2"});
        if (words[0] == "twist") words.insert(words.end(), {"--turn", "90"});
        command(words);
    }
}

TEST_F(ModelVerbs, PipesCarryGrids)
{
    const fs::path path = fs::path(MPUVDB_COMMAND).parent_path();
    const Ended ended = run(folder, {"bash", "-euo", "pipefail", "-c",
                                     "PATH=" + path.string() +
                                         ":$PATH\nmpuvdb offset - -o - --distance 0.2 < ball.vdb | "
                                         "mpuvdb offset - -o back.vdb --distance=-0.2"});
    EXPECT_EQ(ended.status, 0) << ended.err;
    EXPECT_NEAR(volumeOf(folder / "back.vdb"), ballVolume, tolerance);
}

} // namespace
} // namespace mpuvdb::test
