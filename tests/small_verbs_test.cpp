// merge, clip, bend, taper, xor and slice, and attributes that operations carry: by the command.
#include "command_process.h"
#include "modelling_fixture.h"

#include <mpuvdb/contours.h>
#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <array>
#include <cmath>
#include <random>
#include <regex>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;
using Words = std::vector<std::string>;

LevelSet sampledSolid(const std::string& text, double voxelSize)
{
    return sampled(*makeSolidField(parseSolid(text)), voxelSize);
}

class SmallVerbs : public testing::Test
{
protected:
    Ended mpuvdb(Words words, int status = 0) const
    {
        words.insert(words.begin(), "mpuvdb");
        const Ended ended = run(folder, words);
        EXPECT_EQ(ended.status, status) << words[1] << "\n" << ended.err;
        return ended;
    }
    void write(const std::string& name, const LevelSet& levelSet,
               const openvdb::GridCPtrVec& beside = {}) const
    {
        writeLevelSet(folder / name, levelSet, {}, beside);
    }
    LevelSet read(const std::string& name) const { return readLevelSet(folder / name); }
    double volumeOf(const std::string& name) const { return measure(read(name)).volume; }
    std::vector<std::string> gridsOf(const std::string& name) const
    {
        std::vector<std::string> names;
        for (const auto& grid : readGrids(folder / name)) names.push_back(grid->getName());
        std::sort(names.begin(), names.end());
        return names;
    }

    TemporaryFolder folder;
};

/// Edge of the tests' voxels, world units.
constexpr double h = 0.05;

TEST_F(SmallVerbs, MergeKeepsGridsAndNamesThemByTheirFiles)
{
    const LevelSet ball = sampledSolid("sphere(0.5)", h);
    auto heat = openvdb::FloatGrid::create(0);
    heat->setName("heat");
    heat->fill(openvdb::CoordBBox(openvdb::Coord(0), openvdb::Coord(3)), 7);
    write("ball.vdb", ball, {heat});
    write("box.vdb", sampledSolid("box(1,1,1)", h));
    const Ended ended = mpuvdb({"merge", "ball.vdb", "box.vdb", "-o", "all.vdb"});
    EXPECT_EQ(gridsOf("all.vdb"), (Words{"box", "heat", "surface"}));
    EXPECT_NE(ended.err.find("'surface' of box.vdb: 'box'"), std::string::npos) << ended.err;
    const LevelSet box = readLevelSet(folder / "all.vdb", "box");
    EXPECT_TRUE(box.grid().tree().hasSameTopology(read("box.vdb").grid().tree()));
    EXPECT_EQ(box.voxelSize(), h);

    mpuvdb({"merge", "a=ball.vdb", "b=box.vdb", "-o", "named.vdb", "--report", "r.json"});
    EXPECT_EQ(gridsOf("named.vdb"), (Words{"a_heat", "a_surface", "b"}));
    EXPECT_EQ(json::parse(readFile(folder / "r.json"))["grids"].back()["was"], "surface");
    // Equal names of equal files have no names of their own.
    mpuvdb({"merge", "box.vdb", "box.vdb", "box.vdb", "-o", "x.vdb"}, 2);
    mpuvdb({"merge", "box.vdb", "none.vdb", "-o", "x.vdb"}, 3);
    mpuvdb({"merge", "box.vdb", "x=box.vdb", "-o", "box.vdb"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "x.vdb"));
}

TEST_F(SmallVerbs, MergeNumbersEqualNamesOfAFile)
{
    const auto named = [](const char* name, float value) {
        auto grid = openvdb::FloatGrid::create(0);
        grid->setName(name);
        grid->fill(openvdb::CoordBBox(openvdb::Coord(0), openvdb::Coord(3)), value);
        return grid;
    };
    writeGrids(folder / "a.vdb", {named("density", 1), named("density", 2), named("density_2", 3),
                                  named("density", 4)});
    const auto valueOf = [&](const std::string& file, const std::string& name) {
        for (const auto& grid : readGrids(folder / file))
            if (grid->getName() == name)
                return openvdb::gridPtrCast<openvdb::FloatGrid>(grid)->tree().getValue({1, 1, 1});
        return 0.f;
    };
    const Ended ended = mpuvdb({"merge", "a.vdb", "-o", "all.vdb"});
    EXPECT_EQ(gridsOf("all.vdb"), (Words{"density", "density_2", "density_3", "density_4"}));
    EXPECT_EQ(valueOf("all.vdb", "density_2"), 3) << "a name of its own";
    EXPECT_NE(ended.err.find("'density' of a.vdb: 'density_3'"), std::string::npos) << ended.err;
    float sum = 0;
    for (const char* const name : {"density", "density_3", "density_4"})
        sum += valueOf("all.vdb", name);
    EXPECT_EQ(sum, 1 + 2 + 4) << "each once";
    mpuvdb({"merge", "b=a.vdb", "a.vdb", "-o", "named.vdb"});
    EXPECT_EQ(gridsOf("named.vdb"), (Words{"b_density", "b_density_2", "b_density_3", "b_density_4",
                                           "density", "density_2", "density_3", "density_4"}));
    mpuvdb({"merge", "all.vdb", "a.vdb", "-o", "both.vdb"});
    EXPECT_EQ(gridsOf("both.vdb"), (Words{"a_density", "a_density_2", "a_density_3", "a_density_4",
                                          "density", "density_2", "density_3", "density_4"}));
}

TEST_F(SmallVerbs, StatusTellsOfAJobThatIsNotDone)
{
    mpuvdb({"sample", "torus(1,0.4)", "-o", "ring.ply", "--points", "3000"});
    mpuvdb({"plan", "ring.ply", "--job", "job", "--voxels", "40"});
    const json status = json::parse(mpuvdb({"status", "job", "--json"}).out);
    EXPECT_EQ(status["phase"], "fit");
    EXPECT_EQ(status["done"], 0);
    EXPECT_GT(status["tasks"], 0);
}

TEST_F(SmallVerbs, PlanTakesWhatItHasOfAPreset)
{
    mpuvdb({"sample", "torus(1,0.4)", "-o", "ring.ply", "--points", "3000"});
    for (const char* const preset : {"scan", "clean", "particles", "terrain"}) {
        const Ended ended = mpuvdb({"plan", "ring.ply", "--job", std::string("job ") + preset,
                                    "--voxels", "40", "--preset", preset});
        EXPECT_NE(ended.err.find(std::string("preset      ") + preset), std::string::npos)
            << ended.err;
        EXPECT_EQ(ended.err.find("--holes"), std::string::npos) << ended.err;
    }
}

TEST_F(SmallVerbs, MergeLeavesAJobsInputsAlone)
{
    mpuvdb({"sample", "torus(1,0.4)", "-o", "ring.ply", "--points", "3000"});
    const std::string bytes = readFile(folder / "ring.ply");
    mpuvdb({"plan", "ring.ply", "--job", "job", "--voxels", "40"});
    for (const char* const step : {"tile", "gather", "tile"}) mpuvdb({step, "job"});
    const Ended ended = mpuvdb({"merge", "job", "--mesh", "ring.ply"}, 2);
    EXPECT_NE(ended.err.find("is also an input"), std::string::npos) << ended.err;
    EXPECT_EQ(readFile(folder / "ring.ply"), bytes);
    mpuvdb({"merge", "job", "--mesh", "mesh.ply"});
    const std::string range = mpuvdb({"tile", "job", "-1"}, 2).err;
    EXPECT_LT(range.size(), 200u) << range;
}

// With fewer triangles, and coarser ones beside it.
TEST_F(SmallVerbs, MergeShapesTheMeshAsReconstructDoes)
{
    mpuvdb({"sample", "difference(box(2,1.5,1),cylinder(0.4,3))", "-o", "part.ply", "--points",
            "20000", "--noise", "0.01"});
    mpuvdb({"plan", "part.ply", "--job", "job", "--voxels", "150"});
    for (const char* const step : {"tile", "gather", "tile"}) mpuvdb({step, "job"});
    mpuvdb({"merge", "job", "--mesh", "a.ply", "--mesh-tolerance", "0.05%", "--lods", "2",
            "--strict", "--report", "r.json"});
    mpuvdb({"reconstruct", "part.ply", "-o", "whole.vdb", "--voxels", "150", "--mesh", "b.ply",
            "--mesh-tolerance", "0.05%", "--lods", "2", "--strict"});
    for (const char* const kind : {".ply", ".lod1.ply", ".lod2.ply"})
        EXPECT_TRUE(readFile(folder / (std::string("a") + kind)) ==
                    readFile(folder / (std::string("b") + kind)))
            << kind;
    EXPECT_EQ(json::parse(readFile(folder / "r.json"))["lods"].size(), 2u);
    mpuvdb({"merge", "job", "-o", "x.vdb", "--mesh", "a.ply", "--mesh-tolerance", "60%"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "x.vdb")); // refused before anything is written
    mpuvdb({"merge", "job", "-o", "x.vdb", "--lods", "2"}, 2);
}

// A box clipped by a box is a box: its distances are known, at edges and corners too.
TEST_F(SmallVerbs, ClipIsClosedAndSharp)
{
    write("box.vdb", sampledSolid("box(2,2,2)", h));
    mpuvdb({"clip", "box.vdb", "-o", "part.vdb", "--box", "0.1", "-0.5", "open", "open", "0.7",
            "0.3"});
    const LevelSet part = read("part.vdb");
    expectSound(part);
    const auto expected = parseSolid("translate(box(0.9,1.2,1.3),0.55,0.1,-0.35)");
    const Deviation off = deviation(
        part, [&](const Vec3d& p) { return expected->distance(p); }, 2);
    EXPECT_LT(off.largest, 0.02) << "voxels";
    EXPECT_EQ(off.wrongSigns, 0u);

    write("ball.vdb", sampledSolid("sphere(0.8)", h));
    mpuvdb({"clip", "box.vdb", "-o", "in.vdb", "--mask", "ball.vdb"});
    mpuvdb({"clip", "box.vdb", "-o", "out.vdb", "--mask", "ball.vdb:surface", "--outside"});
    const double ball = 4 * M_PI / 3 * std::pow(0.8, 3), second = 10 * h * h;
    EXPECT_NEAR(volumeOf("in.vdb"), ball, second);
    EXPECT_NEAR(volumeOf("out.vdb"), 8 - ball, second);

    const Ended none = mpuvdb({"clip", "box.vdb", "-o", "none.vdb", "--box", "open", "open", "9",
                               "open", "open", "open"});
    EXPECT_NE(none.err.find("nothing is left"), std::string::npos) << none.err;
    const Ended empty = mpuvdb({"mesh", "none.vdb", "-o", "none.ply"});
    EXPECT_NE(empty.err.find("the mesh is empty"), std::string::npos) << empty.err;
    const Ended fog = mpuvdb({"fog", "none.vdb", "-o", "fog.vdb"});
    EXPECT_NE(fog.err.find("the density is empty"), std::string::npos) << fog.err;
    const Ended picture = mpuvdb({"render", "none.vdb", "-o", "none.png"});
    EXPECT_NE(picture.err.find("the level set is empty"), std::string::npos) << picture.err;
    const Ended all =
        mpuvdb({"clip", "box.vdb", "-o", "all.vdb", "--box", "-9", "-9", "-9", "9", "9", "9"});
    EXPECT_NEAR(volumeOf("all.vdb"), 8, second);
    mpuvdb({"clip", "box.vdb", "-o", "x.vdb"}, 2);
    mpuvdb({"clip", "box.vdb", "-o", "x.vdb", "--box", "1", "0", "0", "0", "1", "1"}, 2);
    mpuvdb({"clip", "box.vdb", "-o", "x.vdb", "--box", "1", "0", "0"}, 2);
    mpuvdb({"clip", "box.vdb", "-o", "ball.vdb", "--mask", "ball.vdb"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "x.vdb"));
}

TEST_F(SmallVerbs, BendAndTaperHaveTheVolumesOfTheirFormulas)
{
    write("bar.vdb", sampledSolid("box(0.4,0.6,2)", h / 2));
    const double second = 20 * h * h / 4; // of the voxel size, as areas are below 10
    // By Pappus, a bar bent about its middle keeps its volume.
    mpuvdb({"bend", "bar.vdb", "-o", "arch.vdb", "--angle", "180", "--report", "r.json"});
    expectSound(read("arch.vdb"));
    EXPECT_NEAR(volumeOf("arch.vdb"), 0.4 * 0.6 * 2, second);
    const Box3d arch = measure(read("arch.vdb")).bounds;
    const double radius = 2 / M_PI;
    EXPECT_NEAR(arch.sizes().x(), 2 * (radius + 0.2), h) << "its outer half circle";
    EXPECT_NEAR(arch.sizes().z(), radius + 0.2, h);
    const json settings = json::parse(readFile(folder / "r.json"))["settings"];
    EXPECT_EQ(settings["angle"], 180);
    EXPECT_NEAR(settings["from"], -1, 1e-6) << "the solid's end, not its band's";
    EXPECT_NEAR(settings["to"], 1, 1e-6);
    mpuvdb({"bend", "bar.vdb", "-o", "other.vdb", "--angle", "180", "--towards=-x", "--from=-1",
            "--to", "1"});
    EXPECT_NEAR(measure(read("other.vdb")).bounds.max().x(), -arch.min().x(), h / 10);

    mpuvdb({"taper", "bar.vdb", "-o", "spire.vdb", "--end-factor", "0.4"});
    expectSound(read("spire.vdb"));
    EXPECT_NEAR(volumeOf("spire.vdb"), 0.4 * 0.6 * 2 * (1 + 0.4 + 0.16) / 3, second);
    mpuvdb({"taper", "bar.vdb", "-o", "wide.vdb", "--start-factor", "2", "--end-factor", "2"});
    EXPECT_NEAR(volumeOf("wide.vdb"), 4 * 0.4 * 0.6 * 2, 4 * second);
    mpuvdb({"taper", "bar.vdb", "-o", "x.vdb", "--end-factor", "0"}, 2);
    mpuvdb({"taper", "bar.vdb", "-o", "x.vdb", "--end-factor", "1", "--from", "1", "--to", "0"}, 2);
    mpuvdb({"bend", "bar.vdb", "-o", "x.vdb", "--angle", "400"}, 2);
    mpuvdb({"bend", "bar.vdb", "-o", "x.vdb", "--angle", "10", "--towards", "z"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "x.vdb"));
}

// No surface of either solid goes away: the distance is the smaller one, inside where one is.
TEST_F(SmallVerbs, ExclusiveOrHasTheDistancesOfBothSurfaces)
{
    const auto a = parseSolid("sphere(0.8)"), b = parseSolid("translate(box(1,1.1,1.2),0.6,0.1,0)");
    write("a.vdb", sampled(*makeSolidField(a), h));
    write("b.vdb", sampled(*makeSolidField(b), h));
    mpuvdb({"xor", "a.vdb", "b.vdb", "-o", "x.vdb"});
    const LevelSet made = read("x.vdb");
    expectSound(made);
    const auto exact = [&](const Vec3d& p) {
        const double u = a->distance(p), v = b->distance(p);
        const double least = std::min(std::abs(u), std::abs(v));
        return (u < 0) != (v < 0) ? -least : least;
    };
    const Deviation all = deviation(made, exact, 2);
    EXPECT_LT(all.mean, 0.01) << "voxels";
    EXPECT_EQ(all.wrongSigns, 0u);
    // Where the surfaces cross, four sheets meet in a voxel, which none of its values can tell.
    EXPECT_LT(all.largest, 0.5) << "voxels";
    const auto apart = [&](const Vec3d& p) {
        const bool isCrossing =
            std::abs(a->distance(p)) < 3 * h && std::abs(b->distance(p)) < 3 * h;
        return isCrossing ? 100 : exact(p);
    };
    EXPECT_LT(deviation(made, apart, 2).largest, 0.05) << "voxels";
    mpuvdb({"union", "a.vdb", "b.vdb", "-o", "u.vdb"});
    mpuvdb({"intersection", "a.vdb", "b.vdb", "-o", "i.vdb"});
    EXPECT_NEAR(volumeOf("x.vdb"), volumeOf("u.vdb") - volumeOf("i.vdb"), 10 * h * h);
    mpuvdb({"xor", "a.vdb", "a.vdb", "-o", "none.vdb"});
    EXPECT_EQ(read("none.vdb").grid().activeVoxelCount(), 0u) << "a solid without itself";
}

TEST_F(SmallVerbs, EachInputMayNameItsGrid)
{
    write("ball.vdb", sampledSolid("sphere(0.5)", h));
    write("box.vdb", sampledSolid("box(1,1,1)", h));
    mpuvdb({"merge", "ball=ball.vdb", "box=box.vdb", "-o", "all.vdb"});
    mpuvdb({"intersection", "all.vdb:ball", "box.vdb", "-o", "one.vdb"});
    mpuvdb({"intersection", "ball.vdb", "box.vdb", "-o", "two.vdb"});
    const auto volume = [&](const std::string& name) {
        return measure(readLevelSet(folder / name, "ball")).volume;
    };
    mpuvdb({"merge", "ball=two.vdb", "-o", "named.vdb"});
    EXPECT_DOUBLE_EQ(volume("one.vdb"), volume("named.vdb"));
    mpuvdb({"morph", "all.vdb:ball", "all.vdb:box", "-o", "half.vdb"});
    const Ended missing = mpuvdb({"offset", "all.vdb:cone", "-o", "x.vdb", "--distance", "1vx"}, 3);
    EXPECT_NE(missing.err.find("'cone'"), std::string::npos) << missing.err;
    mpuvdb({"offset", "all.vdb:box", "-o", "all.vdb", "--distance", "1vx"}, 2);
    mpuvdb({"analyze", "all.vdb:box", "-o", "all.vdb"}, 2);
    const Ended both = mpuvdb({"mesh", "all.vdb:box", "-o", "x.ply", "--grid", "ball"}, 2);
    EXPECT_NE(both.err.find("names another grid"), std::string::npos) << both.err;
    mpuvdb({"mesh", "all.vdb:box", "-o", "x.ply", "--grid", "box"});
    mpuvdb({"merge", "left:box=box.vdb", "-o", "colon.vdb"});
    mpuvdb({"mesh", "colon.vdb:left:box", "-o", "x.ply"});
}

/// The largest distance of a contour's points from a circle, voxels.
double offCircle(const Contour& contour, const Eigen::Vector2d& center, double radius)
{
    double most = 0;
    for (const Eigen::Vector2d& p : contour.points)
        most = std::max(most, std::abs((p - center).norm() - radius) / h);
    return most;
}

TEST_F(SmallVerbs, ContoursLieOnTheSurfaceAndRunRoundIt)
{
    const LevelSet torus =
        sampled(*makeMovedField(makeSolidField(parseSolid("torus(1.5,0.6)")),
                                Eigen::Affine3d(Eigen::Translation3d(3, 0.2, 1))),
                h);
    for (const double height : {1.0, 1.0 + 0.37, 1.0 - 0.411}) {
        const std::vector<Contour> contours = slicesOf(torus, 2, {height}).front().contours;
        ASSERT_EQ(contours.size(), 2u);
        const double half = std::sqrt(0.36 - (height - 1) * (height - 1));
        const bool isFirstOuter = contours[0].area > 0;
        const Contour &outer = contours[isFirstOuter ? 0 : 1], &inner = contours[isFirstOuter];
        const Eigen::Vector2d center(3, 0.2);
        // A mesh's chord of a voxel's diagonal lies below its arc, of radius 0.6, by h^2 / (4 r).
        constexpr double kChord = h * h / (4 * 0.6) + 0.01 * h;
        EXPECT_LT(offCircle(outer, center, 1.5 + half), kChord / h);
        EXPECT_LT(offCircle(inner, center, 1.5 - half), kChord / h);
        const auto within = [](double r) { return 2 * M_PI * r * kChord; };
        EXPECT_NEAR(outer.area, M_PI * std::pow(1.5 + half, 2), within(1.5 + half));
        EXPECT_NEAR(inner.area, -M_PI * std::pow(1.5 - half, 2), within(1.5 - half));
    }
    // Across x, y points right and z up: two circles, both outer.
    const std::vector<Contour> across = slicesOf(torus, 0, {3}).front().contours;
    ASSERT_EQ(across.size(), 2u);
    double sum = 0;
    for (const Contour& contour : across) {
        EXPECT_GT(contour.area, 0);
        const double side = contour.points.front().x() > 0.2 ? 1.5 : -1.5;
        EXPECT_LT(offCircle(contour, {0.2 + side, 1}, 0.6), h / (4 * 0.6) + 0.01);
        sum += side;
    }
    EXPECT_EQ(sum, 0);
    EXPECT_TRUE(slicesOf(torus, 2, {9}).front().contours.empty());
    EXPECT_THROW(slicesOf(torus, 3, {0}), UsageError);
    EXPECT_THROW(slicesOf(torus, 2, {std::nan("")}), UsageError);
    const std::vector<Slice> slices = slicesOf(torus, 2, {1.2, -7, 0.9});
    ASSERT_EQ(slices.size(), 3u) << "in the order of the heights";
    EXPECT_EQ(slices[0].height, 1.2);
    EXPECT_EQ(slices[1].contours.size() + 10 * slices[2].contours.size(), 20u);
    EXPECT_EQ(slicesOf(torus, 2, {0.9}).front().contours.back().points,
              slices[2].contours.back().points);
}

/// The distance of @a p from a rectangle's outline.
double offRectangle(const Eigen::Vector2d& p, const Eigen::Vector2d& half)
{
    const Eigen::Vector2d over = p.cwiseAbs() - half;
    return over.maxCoeff() < 0 ? -over.maxCoeff() : over.cwiseMax(0).norm();
}

TEST_F(SmallVerbs, ContoursHaveTheCornersOfTheSolid)
{
    const Eigen::Vector2d half(0.7, 0.45);
    const std::array<Eigen::Vector2d, 4> corners = {
        {{0.7, 0.45}, {-0.7, 0.45}, {-0.7, -0.45}, {0.7, -0.45}}};
    std::mt19937 random(20261127);
    std::uniform_real_distribution<double> any(-1, 1);
    for (int trial = 0; trial < 8; ++trial) {
        const double angle = M_PI * any(random);
        const Eigen::Vector2d at(any(random), any(random));
        const Eigen::Affine3d moved =
            Eigen::Translation3d(at.x(), at.y(), 0) * Eigen::AngleAxisd(angle, Vec3d::UnitZ());
        const LevelSet box =
            sampled(*makeMovedField(makeSolidField(parseSolid("box(1.4,0.9,1)")), moved), h);
        const std::vector<Slice> slices = slicesOf(box, 2, {-0.31, 0, 0.5, 0.17});
        EXPECT_LE(slices[2].contours.size(), 1u) << "the top lies in the plane";
        for (const std::size_t n : {0, 1, 3}) {
            ASSERT_EQ(slices[n].contours.size(), 1u);
            const Contour& contour = slices[n].contours.front();
            // Of the mesh's edges, as sharp_mesh_test has them.
            constexpr double kWithin = 0.1;
            std::array<double, 4> nearest{9, 9, 9, 9};
            for (const Eigen::Vector2d& point : contour.points) {
                const Eigen::Vector2d p = Eigen::Rotation2Dd(-angle) * (point - at);
                EXPECT_LT(offRectangle(p, half) / h, kWithin) << "trial " << trial;
                for (std::size_t c = 0; c < 4; ++c)
                    nearest[c] = std::min(nearest[c], (p - corners[c]).norm() / h);
            }
            for (const double apart : nearest) EXPECT_LT(apart, kWithin) << "trial " << trial;
            EXPECT_NEAR(contour.area, 4 * half.prod(), kWithin * h * 4 * half.sum());
        }
    }
}

// Vertices of a face lie in its plane but for roundings, above it and below.
TEST_F(SmallVerbs, SlicesInAFaceAreThoseOfTheSolidBelow)
{
    for (const double top : {0.5, 0.51, 0.53, 0.577, 0.61}) {
        const LevelSet box = sampledSolid(fmt::format("box(1.4,0.9,{})", 2 * top), h);
        const std::vector<Contour> contours = slicesOf(box, 2, {top}).front().contours;
        ASSERT_EQ(contours.size(), 1u) << top;
        EXPECT_NEAR(contours.front().area, 1.4 * 0.9, 0.01 * h) << top;
        EXPECT_TRUE(slicesOf(box, 2, {-top}).front().contours.empty()) << top;
    }
}

TEST_F(SmallVerbs, SliceWritesSvgInMillimetersAndPictures)
{
    write("part.vdb", sampledSolid("difference(box(2,2,1),cylinder(0.4,3))", h));
    mpuvdb({"slice", "part.vdb", "-o", "one.svg", "--height", "0.1", "--units", "cm"});
    const std::string svg = readFile(folder / "one.svg");
    const std::regex number(R"re(data-height="([^"]*)")re");
    std::smatch height;
    ASSERT_TRUE(std::regex_search(svg, height, number)) << svg.substr(0, 300);
    EXPECT_NEAR(std::stod(height[1]), 1, 1e-9) << "0.1 cm";
    EXPECT_EQ(std::count(svg.begin(), svg.end(), 'M'), 2) << "the side, and the hole";
    EXPECT_EQ(std::count(svg.begin(), svg.end(), 'Z'), 2);
    mpuvdb({"slice", "part.vdb", "-o", "layers.svg", "--every", "0.2", "--report", "r.json"});
    const json slices = json::parse(readFile(folder / "r.json"))["slices"];
    ASSERT_EQ(slices.size(), 5u) << "layers of a height of 1";
    for (std::size_t n = 0; n < 5; ++n) {
        EXPECT_NEAR(slices[n]["height"], -0.4 + 0.2 * double(n), h / 10);
        EXPECT_NEAR(slices[n]["area"], 4 - M_PI * 0.16, 10 * h * h);
        EXPECT_EQ(slices[n]["contours"], 2);
    }
    // A corner on a lattice point has several vertices of the mesh about it.
    write("bar.vdb", sampledSolid("box(0.4,0.4,2)", 0.02));
    mpuvdb({"slice", "bar.vdb", "-o", "bar.svg", "--every", "0.02"});
    const std::string bar = readFile(folder / "bar.svg");
    const std::regex twice(R"([ML]([-0-9.]+ [-0-9.]+) L\1 )");
    EXPECT_FALSE(std::regex_search(bar, twice)) << "a segment without length";
    mpuvdb({"slice", "part.vdb", "-o", "x.png", "--axis", "y", "--pixels", "64"});
    EXPECT_EQ(readFile(folder / "x.png").substr(1, 3), "PNG");
    mpuvdb({"slice", "part.vdb", "-o", "p.##.png", "--height", "0.$F", "--frames", "1-3x2"});
    EXPECT_NE(readFile(folder / "p.01.png"), "");
    mpuvdb({"slice", "part.vdb", "-o", "y.png", "--every", "0.2"}, 2);
    mpuvdb({"slice", "part.vdb", "-o", "y.svg", "--every", "0"}, 2);
    const Ended beside = mpuvdb({"slice", "part.vdb", "-o", "z.svg", "--height", "7"});
    EXPECT_NE(beside.err.find("no slice meets the solid"), std::string::npos) << beside.err;
}

/// A closed box of two colors, or one with a point each.
std::string boxPly(double x, const std::string& left, const std::string& right)
{
    std::string text =
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar "
        "blue\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n";
    for (int v = 0; v < 8; ++v)
        text += std::to_string(x + (v & 1)) + " " + std::to_string(v >> 1 & 1) + " " +
                std::to_string(v >> 2) + " " + (v & 1 ? right : left) + "\n";
    return text + "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n";
}

TEST_F(SmallVerbs, ColorsOfMeshesGoToTheGridAndThroughBooleans)
{
    writeFile(folder / "a.ply", boxPly(0, "255 0 0", "0 0 255"));
    mpuvdb({"voxelize", "a.ply", "-o", "a.vdb", "--voxel-size", "0.05"});
    EXPECT_EQ(gridsOf("a.vdb"), (Words{"Cd", "surface"}));
    const auto colors = openvdb::gridPtrCast<openvdb::Vec3SGrid>(
        readAttributeGrids(folder / "a.vdb", {"Cd"}).front());
    ASSERT_TRUE(colors);
    // Linear along x, in linear light.
    for (auto on = colors->cbeginValueOn(); on; ++on) {
        const openvdb::Vec3d at = colors->indexToWorld(on.getCoord());
        if (at.x() < 0 || at.x() > 1) continue;
        // Beside the ends the nearest place may lie on them, as far as the band goes.
        ASSERT_NEAR((*on)[0], 1 - at.x(), 4 * h) << at;
        ASSERT_EQ((*on)[1], 0);
        const bool isByFace =
            at.y() > 3 * h && at.y() < 1 - 3 * h && at.x() > 3 * h && at.x() < 1 - 3 * h;
        ASSERT_NEAR((*on)[2], at.x(), isByFace ? 0.002 : 4 * h) << at << "; half floats";
    }
    writeFile(folder / "b.ply", boxPly(0.5, "0 255 0", "0 255 0"));
    mpuvdb({"voxelize", "b.ply", "-o", "b.vdb", "--voxel-size", "0.05"});
    for (const Words& verb :
         {Words{"union", "a.vdb", "b.vdb"}, Words{"difference", "a.vdb", "b.vdb"},
          Words{"xor", "a.vdb", "b.vdb"}}) {
        Words words = verb;
        words.insert(words.end(), {"-o", "c.vdb"});
        mpuvdb(words);
        mpuvdb({"mesh", "c.vdb", "-o", "c.ply"});
        const Mesh mesh = readMesh(folder / "c.ply");
        ASSERT_EQ(mesh.colors.size(), mesh.positions.size());
        std::size_t green = 0, other = 0;
        for (std::size_t n = 0; n < mesh.positions.size(); ++n) {
            const Vec3d p = mesh.world(n);
            // Where one operand's surface is far nearer than the other's.
            const double toB = std::abs(parseSolid("translate(box(1,1,1),1,0.5,0.5)")->distance(p));
            const double toA =
                std::abs(parseSolid("translate(box(1,1,1),0.5,0.5,0.5)")->distance(p));
            if (std::abs(toA - toB) < 0.1) continue;
            const bool isB = toB < toA;
            ASSERT_NEAR(mesh.colors[n].y(), isB ? 1 : 0, 0.02) << verb[0] << " " << p.transpose();
            (isB ? green : other) += 1;
        }
        EXPECT_GT(other, 100u) << verb[0];
        EXPECT_GT(green, 50u) << verb[0];
    }
}

TEST_F(SmallVerbs, BooleansTellOfAttributesThatAnInputLacks)
{
    writeFile(folder / "a.ply", boxPly(0, "255 0 0", "255 0 0"));
    mpuvdb({"voxelize", "a.ply", "-o", "a.vdb", "--voxel-size", "0.05"});
    const LevelSet ball = sampledSolid("translate(sphere(0.4),1,0.5,0.5)", h);
    auto heat = openvdb::FloatGrid::create(0);
    heat->setName("heat");
    heat->setTransform(ball.grid().transform().copy());
    heat->topologyUnion(ball.grid());
    for (auto on = heat->beginValueOn(); on; ++on) on.setValue(5);
    write("plain.vdb", ball);
    write("hot.vdb", ball, {heat});
    const auto lacks = [](const Ended& ended, const std::string& file, const std::string& what) {
        return std::regex_search(ended.err, std::regex(file + ": .*'surface' has no " + what));
    };
    for (const char* const verb : {"union", "difference", "xor"}) {
        SCOPED_TRACE(verb);
        const Ended ended = mpuvdb({verb, "a.vdb", "plain.vdb", "-o", "c.vdb"});
        EXPECT_TRUE(lacks(ended, "plain.vdb", "colors")) << ended.err;
        EXPECT_FALSE(lacks(ended, "a.vdb", "")) << ended.err;
        mpuvdb({"mesh", "c.vdb", "-o", "c.ply"});
        const Mesh mesh = readMesh(folder / "c.ply");
        ASSERT_EQ(mesh.colors.size(), mesh.positions.size());
        std::size_t white = 0;
        for (std::size_t n = 0; n < mesh.positions.size(); ++n) {
            const Vec3d p = mesh.world(n);
            const double toBall = std::abs((p - Vec3d(1, 0.5, 0.5)).norm() - 0.4);
            const double toBox =
                std::abs(parseSolid("translate(box(1,1,1),0.5,0.5,0.5)")->distance(p));
            if (std::abs(toBall - toBox) < 0.1) continue;
            const bool isBall = toBall < toBox;
            ASSERT_NEAR(mesh.colors[n].x(), 1, 0.01);
            ASSERT_NEAR(mesh.colors[n].y(), isBall ? 1 : 0, 0.01) << p.transpose();
            white += isBall;
        }
        EXPECT_GT(white, 100u);
    }
    const Ended ended = mpuvdb({"union", "a.vdb", "hot.vdb", "-o", "c.vdb"});
    EXPECT_TRUE(lacks(ended, "hot.vdb", "colors")) << ended.err;
    EXPECT_TRUE(lacks(ended, "a.vdb", "'heat'")) << ended.err;
    EXPECT_EQ(gridsOf("c.vdb"), (Words{"Cd", "heat", "surface"}));
    const Ended quiet = mpuvdb({"union", "a.vdb", "a.vdb", "-o", "c.vdb"});
    EXPECT_EQ(quiet.err.find("has no"), std::string::npos) << quiet.err;
}

TEST_F(SmallVerbs, NumbersAtVerticesBecomeGrids)
{
    // A box with a number that is linear along x, one of another name, and one that is not finite.
    std::string text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float "
                       "y\nproperty float z\nproperty float stress\nproperty double quality\n"
                       "element face 6\nproperty list uchar int vertex_indices\nend_header\n";
    for (int v = 0; v < 8; ++v)
        text += std::to_string(v & 1) + " " + std::to_string(v >> 1 & 1) + " " +
                std::to_string(v >> 2) + " " + (v & 1 ? "7 " : "-3 ") + (v == 5 ? "nan" : "2") +
                "\n";
    text += "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n";
    writeFile(folder / "a.ply", text);
    mpuvdb({"voxelize", "a.ply", "-o", "none.vdb", "--voxel-size", "0.05"});
    EXPECT_EQ(gridsOf("none.vdb"), Words{"surface"});
    const Ended ended = mpuvdb({"voxelize", "a.ply", "-o", "a.vdb", "--voxel-size", "0.05",
                                "--attributes", "stress,quality"});
    EXPECT_NE(ended.err.find("1 of its vertices' scalars"), std::string::npos) << ended.err;
    EXPECT_EQ(gridsOf("a.vdb"), (Words{"quality", "stress", "surface"}));
    const auto stress = openvdb::gridPtrCast<openvdb::FloatGrid>(
        readAttributeGrids(folder / "a.vdb", {"stress"}).front());
    ASSERT_TRUE(stress);
    std::size_t count = 0;
    for (auto on = stress->cbeginValueOn(); on; ++on) {
        const openvdb::Vec3d at = stress->indexToWorld(on.getCoord());
        if (at.x() < 0 || at.x() > 1) continue;
        const bool isByFace =
            at.y() > 3 * h && at.y() < 1 - 3 * h && at.x() > 3 * h && at.x() < 1 - 3 * h;
        // Half floats have 11 bits, of values up to 7.
        ASSERT_NEAR(*on, -3 + 10 * at.x(), isByFace ? 7.0 / 2048 : 10 * 4 * h) << at;
        ++count;
    }
    EXPECT_GT(count, 1000u);
    const Ended missing = mpuvdb({"voxelize", "a.ply", "-o", "b.vdb", "--attributes", "heat"}, 3);
    EXPECT_NE(missing.err.find("'stress'"), std::string::npos) << missing.err;
    mpuvdb({"voxelize", "a.ply", "-o", "b.vdb", "--attributes", "Cd"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "b.vdb"));
}

TEST_F(SmallVerbs, EveryVerbOfOneGridTakesItsName)
{
    const auto named = [](const LevelSet& levelSet, const char* name) {
        const openvdb::FloatGrid::Ptr grid = levelSet.grid().deepCopy();
        grid->setName(name);
        return LevelSet(grid);
    };
    write("both.vdb", named(sampledSolid("sphere(0.5)", h), "small"),
          {named(sampledSolid("sphere(1)", h), "large").gridPtr()});
    const double volume = 4 * M_PI / 3;
    for (const auto& [name, radius] :
         {std::pair<std::string, double>("small", 0.5), {"large", 1}}) {
        const std::string file = "both.vdb:" + name;
        mpuvdb({"fog", file, "-o", "fog.vdb"});
        const auto fog = readGrids(folder / "fog.vdb").front();
        const double across = fog->evalActiveVoxelDim().x() * h;
        EXPECT_NEAR(across, 2 * radius, 4 * h) << name;
        mpuvdb({"isosurface", file, "-o", "iso.vdb", "--value", "0", "--inside", "below"});
        EXPECT_NEAR(volumeOf("iso.vdb"), volume * std::pow(radius, 3), 0.02 * volume) << name;
        const json parts = json::parse(mpuvdb({"components", file, "--json"}).out)["components"];
        EXPECT_NEAR(double(parts[0]["volume"]), volume * std::pow(radius, 3), 0.02 * volume)
            << name;
        mpuvdb({"mesh", file, "-o", name + ".ply"});
        mpuvdb({"render", file, "-o", name + ".png", "--size", "64x64"});
        Box3d box;
        const Mesh mesh = readMesh(folder / (name + ".ply"));
        for (std::size_t n = 0; n < mesh.positions.size(); ++n) box.extend(mesh.world(n));
        EXPECT_NEAR(box.sizes().maxCoeff(), 2 * radius, h) << name;
        EXPECT_TRUE(std::filesystem::exists(folder / (name + ".png")));
    }
    // An output may not replace its input, however that is named.
    mpuvdb({"fog", "both.vdb:small", "-o", "both.vdb"}, 2);
    mpuvdb({"mesh", "both.vdb:none", "-o", "none.ply"}, 3);
}

TEST_F(SmallVerbs, OpenCutsAreLeftOutOfMeshes)
{
    const double radius = 1, height = 0.313;
    write("ball.vdb", sampledSolid("sphere(1)", h));
    const auto meshOf = [&](const Words& options, bool isOutside) {
        Words words = {"clip", "ball.vdb", "-o", "part.vdb", "--open"};
        words.insert(words.end(), options.begin(), options.end());
        mpuvdb(words);
        EXPECT_EQ(gridsOf("part.vdb"), (Words{"coverage", "surface"}));
        mpuvdb({"mesh", "part.vdb", "-o", "closed.ply"});
        mpuvdb({"mesh", "part.vdb", "-o", "open.ply", "--holes", "open"});
        const auto areaOf = [&](const std::string& file) {
            const Mesh mesh = readMesh(folder / file);
            double area = 0;
            for (const Mesh::Triangle& t : mesh.triangles) {
                const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
                area += (b - a).cross(c - a).norm() / 2;
            }
            return area;
        };
        const double cap = 2 * M_PI * radius * (radius - height);
        const double sphere = isOutside ? 4 * M_PI * radius * radius - cap : cap;
        const double disk = M_PI * (radius * radius - height * height);
        EXPECT_NEAR(areaOf("closed.ply"), sphere + disk, 0.01 * (sphere + disk));
        // The rim is the edge of the cut, to a voxel, since coverage is known at voxels, and on the
        // whole to a tenth of one.
        const double rim = 2 * M_PI * std::sqrt(radius * radius - height * height);
        EXPECT_NEAR(areaOf("open.ply"), sphere, 0.1 * h * rim + 0.005 * sphere);
        const Mesh mesh = readMesh(folder / "open.ply");
        for (std::size_t n = 0; n < mesh.positions.size(); ++n)
            EXPECT_NEAR(mesh.world(n).norm(), radius, h) << mesh.world(n).transpose();
    };
    const Words box = {"--box", "open", "open", "0.313", "open", "open", "open"};
    meshOf(box, false);
    Words outside = box;
    outside.push_back("--outside");
    meshOf(outside, true);
    write("slab.vdb", sampledSolid("translate(box(4,4,2),0,0,1.313)", h));
    meshOf({"--mask", "slab.vdb"}, false);
    // A cut of what was cut: both cuts are open.
    mpuvdb({"clip", "part.vdb", "-o", "quarter.vdb", "--open", "--box", "0.1", "open", "open",
            "open", "open", "open"});
    mpuvdb({"mesh", "quarter.vdb", "-o", "quarter.ply", "--holes", "open"});
    const Mesh mesh = readMesh(folder / "quarter.ply");
    for (std::size_t n = 0; n < mesh.positions.size(); ++n)
        EXPECT_NEAR(mesh.world(n).norm(), radius, h) << mesh.world(n).transpose();
}

TEST_F(SmallVerbs, OpenCutsOfThinWallsAreLeftOut)
{
    for (const double wall : {2.0, 2.7, 4.0}) { // voxels
        SCOPED_TRACE(wall);
        write("tube.vdb",
              sampledSolid(
                  fmt::format("difference(cylinder(0.8,2),cylinder({},3))", 0.8 - wall * h), h));
        mpuvdb({"clip", "tube.vdb", "-o", "part.vdb", "--open", "--box", "open", "open", "0.013",
                "open", "open", "open"});
        mpuvdb({"mesh", "part.vdb", "-o", "open.ply", "--holes", "open"});
        const Mesh mesh = readMesh(folder / "open.ply");
        double cut = 0; // area that faces down where the cut was
        for (const Mesh::Triangle& t : mesh.triangles) {
            const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
            const Vec3d area = (b - a).cross(c - a) / 2;
            if (area.z() < -0.9 * area.norm()) cut -= area.z();
        }
        // To a tenth of a voxel along both rims.
        EXPECT_LE(cut, 2 * 0.1 * h * 2 * M_PI * 0.8);
    }
}

TEST_F(SmallVerbs, SurveysBecomeBlocks)
{
    std::string survey;
    for (int x = 0; x < 60; ++x)
        for (int y = 0; y < 40; ++y)
            survey += std::to_string(0.1 * x) + " " + std::to_string(0.1 * y) + " " +
                      std::to_string(0.3 * std::sin(0.1 * x)) + "\n";
    writeFile(folder / "survey.xyz", survey);
    mpuvdb({"reconstruct", "survey.xyz", "-o", "survey.vdb", "--preset", "terrain", "--mesh",
            "terrain.ply"});
    mpuvdb({"voxelize", "terrain.ply", "-o", "block.vdb", "--voxel-size", "0.05", "--base", "0.5"});
    mpuvdb({"check", "block.vdb"});
    // What lies between the mesh and the base, which is below its lowest vertex.
    const Mesh terrain = readMesh(folder / "terrain.ply");
    double lowest = HUGE_VAL, volume = 0, area = 0;
    for (std::size_t n = 0; n < terrain.positions.size(); ++n)
        lowest = std::min(lowest, terrain.world(n)[2]);
    for (const Mesh::Triangle& t : terrain.triangles) {
        const Vec3d a = terrain.world(t[0]), b = terrain.world(t[1]), c = terrain.world(t[2]);
        const double seen = (b - a).cross(c - a)[2] / 2;
        volume += seen * ((a + b + c)[2] / 3 - lowest + 0.5);
        area += (b - a).cross(c - a).norm() / 2;
    }
    EXPECT_GT(area, 5.9 * 3.9);
    EXPECT_NEAR(volumeOf("block.vdb"), volume, 0.005 * volume);
    mpuvdb({"components", "block.vdb"});
    // A base thinner than the voxels, a closed mesh, an axis without a base.
    mpuvdb({"voxelize", "terrain.ply", "-o", "no.vdb", "--voxel-size", "0.05", "--base", "0.09"},
           2);
    mpuvdb({"mesh", "block.vdb", "-o", "block.ply"});
    mpuvdb({"voxelize", "block.ply", "-o", "no.vdb", "--base", "0.5"}, 3);
    mpuvdb({"voxelize", "terrain.ply", "-o", "no.vdb", "--up", "y"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "no.vdb"));
}

} // namespace
} // namespace mpuvdb::test
