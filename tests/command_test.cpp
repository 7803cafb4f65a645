// The command end to end: every verb, every exit status, what is said and what is reported.
#include "command_process.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <cmath>
#include <fstream>
#include <random>
#include <regex>
#include <sstream>
#include <unistd.h>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;
using Words = std::vector<std::string>;

/// A scan of a torus, and its level set, made once.
class CommandTest : public testing::Test
{
protected:
    static void SetUpTestSuite()
    {
        ourInputs = new TemporaryFolder;
        const Ended sampled = run(
            *ourInputs, {"mpuvdb", "sample", "torus(1,0.4)", "-o", "scan.ply", "--points", "8000"});
        ASSERT_EQ(sampled.status, 0) << sampled.err;
        const Ended made = run(*ourInputs, {"mpuvdb", "reconstruct", "scan.ply", "-o", "scan.vdb"});
        ASSERT_EQ(made.status, 0) << made.err;
    }
    static void TearDownTestSuite() { delete ourInputs; }

    static std::string scan() { return *ourInputs / "scan.ply"; }
    static std::string grid() { return *ourInputs / "scan.vdb"; }

    Ended mpuvdb(Words words, const std::string& input = {}) const
    {
        words.insert(words.begin(), "mpuvdb");
        return run(mFolder, words, input);
    }
    json readJson(const std::string& name) const { return json::parse(readFile(mFolder / name)); }

    TemporaryFolder mFolder;

private:
    static TemporaryFolder* ourInputs;
};

TemporaryFolder* CommandTest::ourInputs = nullptr;

Words keysOf(const json& object)
{
    Words keys;
    for (const auto& item : object.items()) keys.push_back(item.key());
    return keys; // sorted by nlohmann::json
}

TEST_F(CommandTest, HelpIsOnStandardOutputAndHasExamples)
{
    const Ended all = mpuvdb({"--help"});
    EXPECT_EQ(all.status, 0);
    for (const char* verb : {"reconstruct", "mesh", "sample", "info", "check", "render"}) {
        EXPECT_NE(all.out.find(verb), std::string::npos) << verb;
        const Ended one = mpuvdb({verb, "--help"});
        EXPECT_EQ(one.status, 0);
        EXPECT_NE(one.out.find(std::string("mpuvdb ") + verb), std::string::npos) << one.out;
        EXPECT_NE(one.out.find("Examples:"), std::string::npos);
        EXPECT_EQ(one.err, "");
    }
    // What the parser calls its checks is no description.
    for (const char* verb : {"reconstruct", "mesh", "plan", "tile"}) {
        const std::string help = mpuvdb({verb, "--help"}).out;
        for (const char* check : {"NONNEGATIVE", "INT:", " in [", ":{"})
            EXPECT_EQ(help.find(check), std::string::npos) << verb << " " << check;
    }
    EXPECT_EQ(mpuvdb({"--version"}).out.rfind("mpuvdb ", 0), 0u);
}

TEST_F(CommandTest, UnknownWordsAreUsageErrorsThatSayWhatWasMeant)
{
    const struct {
        Words words;
        const char* said;
    } cases[] = {
        {{}, "Give a verb"},
        {{"reconstrct", "a.ply"}, "did you mean reconstruct?"},
        {{"--threads", "1", "offset", "a.vdb"}, "--threads stands before the verb: put it after"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--voxel-sise", "1"},
         "did you mean --voxel-size?"},
        {{"reconstruct", "a.ply", "--voxelsize=1"}, "did you mean --voxel-size?"},
        // No prefixes: a script that leans on one breaks when an option is added.
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--tol", "1"}, "did you mean --tolerance?"},
        {{"render", "a.vdb", "b.vdb", "-o", "c.png"}, "unexpected argument 'b.vdb'"},
        {{"offset", "a.vdb", "20vx", "-o", "c.vdb"}, "unexpected argument '20vx'"},
        {{"reconstruct", "a.ply"}, "--output is required"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--tolerance", "3mm"}, "--tolerance: '3mm'"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--max-memory", "lots"}, "'lots' is not a size"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--threads", "0"}, "--threads"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--voxels", "9", "--voxel-size", "1"}, "excludes"},
        {{"reconstruct", "a.ply", "-o", "a.txt"}, "use .vdb"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--region", "0", "0", "0", "1", "1", "1", "--mesh",
          "m.ply"},
         "there is no --mesh"},
        {{"reconstruct", "a.ply", "-o", "-"}, "not written to standard output"},
        {{"reconstruct", "a.ply", "-o", "a.vdb", "--mesh", "a.ply"}, "also an input"},
        {{"mesh", "a.vdb", "-o", "a.ply", "--report", "a.ply"}, "two outputs"},
        {{"sample", "sfere(1)", "-o", "a.ply"}, "sfere"},
        {{"reconstruct", scan(), "-o", "a.vdb", "--lods", "2"}, "--mesh"},
        {{"reconstruct", scan(), "-o", "a.vdb", "--strict"}, "--mesh"},
        {{"reconstruct", scan(), "-o", "a.vdb", "--mesh-tolerance", "0.1vx"}, "--mesh"},
    };
    for (const auto& c : cases) {
        const Ended ended = mpuvdb(c.words);
        EXPECT_EQ(ended.status, 2) << c.said << ended.err;
        EXPECT_NE(ended.err.find(c.said), std::string::npos) << c.said << "\n" << ended.err;
        EXPECT_EQ(ended.out, "");
    }
    EXPECT_TRUE(mFolder.names().empty());
}

// A crowd of points is told of, by word, report and status; a mesh that its vertices do not show is
// refused, and leaves nothing.
TEST_F(CommandTest, WhatPointsDoNotExplainIsTold)
{
    std::ofstream crowd(mFolder / "crowd.xyz");
    for (int v = 0; v < 17 * 17 * 17; ++v)
        crowd << v / 289 << ' ' << v / 17 % 17 << ' ' << v % 17 << '\n';
    crowd.close();
    const Ended told =
        mpuvdb({"reconstruct", "crowd.xyz", "-o", "crowd.vdb", "--report", "crowd.json"});
    EXPECT_EQ(told.status, 4) << told.err;
    EXPECT_NE(told.err.find("the points fill a solid"), std::string::npos) << told.err;
    const json explained = readJson("crowd.json")["explained"];
    EXPECT_FALSE(explained["sound"]);
    EXPECT_EQ(explained["findings"].size(), 1u);
    EXPECT_EQ(explained["points"], 17 * 17 * 17);

    std::ofstream bar(mFolder / "bar.obj");
    for (const int end : {0, 100})
        for (int k = 0; k < 40; ++k)
            bar << "v " << std::cos(k * M_PI / 20) << ' ' << std::sin(k * M_PI / 20) << ' ' << end
                << '\n';
    for (int k = 0; k < 40; ++k) {
        const int next = (k + 1) % 40;
        bar << "f " << k + 1 << ' ' << next + 1 << ' ' << next + 41 << ' ' << k + 41 << '\n';
    }
    bar.close();
    const Ended refused = mpuvdb({"reconstruct", "bar.obj", "-o", "bar.vdb"});
    EXPECT_EQ(refused.status, 3) << refused.err;
    EXPECT_NE(refused.err.find("mpuvdb voxelize"), std::string::npos) << refused.err;
    EXPECT_FALSE(std::filesystem::exists(mFolder / "bar.vdb"));
}

TEST_F(CommandTest, ARegionWithoutSurfaceIsTold)
{
    const Ended far =
        mpuvdb({"reconstruct", scan(), "-o", "far.vdb", "--region", "5", "5", "5", "6", "6", "6"});
    EXPECT_EQ(far.status, 0) << far.err;
    EXPECT_NE(far.err.find("no point lies in the region"), std::string::npos) << far.err;
    EXPECT_NE(far.err.find("the surface does not reach the region"), std::string::npos) << far.err;
}

// A program that starts this one may have more.
TEST_F(CommandTest, PeakMemoryIsItsOwn)
{
    constexpr std::size_t kBytes = std::size_t(600) << 20;
    const std::string held(kBytes, 'x');
    const Ended ended = mpuvdb({"info", scan(), "--report", "r.json"});
    ASSERT_EQ(ended.status, 0) << ended.err;
    for (const json& stage : readJson("r.json")["stages"])
        EXPECT_LT(stage["peak_bytes"].get<double>(), double(held.size()) / 2) << stage;
}

TEST_F(CommandTest, ReconstructEchoesAndReportsWhatItResolved)
{
    const Ended ended =
        mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--voxels", "40", "--tolerance", "0.1%",
                "--mesh", "a.ply", "--report", "a.json", "--no-sharp"});
    ASSERT_EQ(ended.status, 0) << ended.err;
    EXPECT_EQ(ended.out, "");
    for (const char* said : {"spacing", "noise", "voxel size", "tolerance", "active voxels"})
        EXPECT_NE(ended.err.find(said), std::string::npos) << said << "\n" << ended.err;
    const json report = readJson("a.json");
    EXPECT_EQ(keysOf(report), (Words{"check", "explained", "field", "grid", "input", "mesh",
                                     "settings", "stages"}));
    EXPECT_EQ(keysOf(report["grid"]),
              (Words{"active_voxels", "bytes", "half_width", "name", "voxel_size"}));
    EXPECT_EQ(report["grid"]["name"], "surface");
    EXPECT_NEAR(report["grid"]["voxel_size"], 2.8 / 40, 0.002);
    EXPECT_NEAR(report["grid"]["half_width"], 3, 1e-6);
    EXPECT_EQ(report["settings"]["sharp"], false);
    EXPECT_NEAR(report["settings"]["tolerance"].get<double>(), 0.001 * std::hypot(2.8, 2.8, 0.8),
                1e-4);
    for (const char* key : {"points", "dropped", "spacing", "noise"})
        EXPECT_TRUE(report["input"].contains(key)) << key;
    for (const char* key : {"cells", "leaves", "max_error"})
        EXPECT_TRUE(report["field"].contains(key)) << key;
    EXPECT_EQ(report["mesh"]["boundary_edges"], 0);
    EXPECT_EQ(report["mesh"]["components"], 1);
    EXPECT_EQ(report["mesh"]["euler_characteristic"], 0);
    EXPECT_NEAR(report["mesh"]["volume"], 2 * M_PI * M_PI * 0.16, 0.05);
    ASSERT_FALSE(report["stages"].empty());
    EXPECT_EQ(keysOf(report["stages"][0]), (Words{"cpu_seconds", "name", "peak_bytes", "seconds"}));
    EXPECT_EQ(mFolder.names(), (Words{"a.json", "a.ply", "a.vdb"}));
}

TEST_F(CommandTest, ReconstructInterpolatesWhereAsked)
{
    const Ended ended =
        mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--interpolate", "--report", "a.json"});
    ASSERT_EQ(ended.status, 0) << ended.err;
    EXPECT_NE(ended.err.find("alpha 1.25, min-points 15, interpolate"), std::string::npos)
        << ended.err;
    json settings = readJson("a.json")["settings"];
    EXPECT_EQ(settings["interpolate"], true);
    EXPECT_EQ(settings["sharp"], false);
    EXPECT_EQ(settings["alpha"], 1.25);

    const Ended given =
        mpuvdb({"reconstruct", scan(), "-o", "b.vdb", "--interpolate", "--alpha", "1.5",
                "--min-points", "12", "--tolerance", "0.2%", "--report", "b.json"});
    ASSERT_EQ(given.status, 0) << given.err;
    settings = readJson("b.json")["settings"];
    EXPECT_EQ(settings["alpha"], 1.5);
    EXPECT_EQ(settings["min_points"], 12);
    EXPECT_NEAR(settings["tolerance"].get<double>(), 0.002 * std::hypot(2.8, 2.8, 0.8), 2e-4);

    const Ended narrow =
        mpuvdb({"reconstruct", scan(), "-o", "c.vdb", "--interpolate", "--alpha", "0.75"});
    EXPECT_EQ(narrow.status, 2);
    EXPECT_NE(narrow.err.find("[1.05, 2] for interpolation"), std::string::npos) << narrow.err;
}

TEST_F(CommandTest, ErrorsAreReportedToo)
{
    writeFile(mFolder / "bad.ply", "ply\nformat ascii 1.0\nelement vertex 3\nend_header\n");
    const Ended bad = mpuvdb({"reconstruct", "bad.ply", "-o", "a.vdb", "--report", "a.json"});
    EXPECT_EQ(bad.status, 3) << bad.err;
    const json report = readJson("a.json");
    EXPECT_EQ(report["error"]["type"], "InputError");
    EXPECT_NE(report["error"]["message"].get<std::string>().find("bad.ply"), std::string::npos);
    EXPECT_EQ(mFolder.names(), (Words{"a.json", "bad.ply"}));

    const Ended missing = mpuvdb({"reconstruct", "none.ply", "-o", "a.vdb"});
    EXPECT_EQ(missing.status, 3) << missing.err;
    EXPECT_NE(missing.err.find("none.ply"), std::string::npos);
}

TEST_F(CommandTest, OutputsAreCheckedBeforeTheWork)
{
    for (const char* option : {"-o", "--mesh", "--report"}) {
        Words words{"reconstruct", scan(), "--progress", "json"};
        if (std::string(option) != "-o") words.insert(words.end(), {"-o", "a.vdb"});
        words.insert(words.end(),
                     {option, std::string(option) == "--mesh" ? "no/a.ply" : "no/a.vdb"});
        const Ended ended = mpuvdb(words);
        EXPECT_EQ(ended.status, 3) << ended.err;
        EXPECT_NE(ended.err.find("no folder no"), std::string::npos) << ended.err;
        EXPECT_EQ(ended.err.find("\"stage\""), std::string::npos) << ended.err;
    }
    EXPECT_TRUE(mFolder.names().empty());
}

TEST_F(CommandTest, UnwritableFolderIsAnError)
{
    if (geteuid() == 0) GTEST_SKIP() << "to root every folder is writable";
    std::filesystem::create_directory(mFolder / "locked");
    std::filesystem::permissions(mFolder / "locked", std::filesystem::perms(0500));
    const Ended ended = mpuvdb({"reconstruct", scan(), "-o", "locked/a.vdb"});
    EXPECT_EQ(ended.status, 3);
    EXPECT_NE(ended.err.find("cannot write in folder"), std::string::npos) << ended.err;
}

TEST_F(CommandTest, PipesWorkAtBothEnds)
{
    const Ended read =
        mpuvdb({"reconstruct", "-", "-o", "a.vdb", "--mesh", "-", "-q"}, readFile(scan()));
    ASSERT_EQ(read.status, 0) << read.err;
    EXPECT_EQ(read.err, "");
    EXPECT_EQ(read.out.rfind("ply\n", 0), 0u);
    const Ended meshed = mpuvdb({"mesh", "a.vdb", "-o", "-"});
    EXPECT_EQ(meshed.status, 0) << meshed.err;
    EXPECT_EQ(meshed.out, read.out);
    const std::string grid = readFile(mFolder / "a.vdb");
    EXPECT_EQ(mpuvdb({"mesh", "-", "-o", "-"}, grid).out, read.out);
    EXPECT_EQ(mpuvdb({"check", "-", "-q"}, grid).status, 0);
    EXPECT_EQ(mpuvdb({"mesh", "-", "-o", "-"}, "").status, 3);
    EXPECT_EQ(mFolder.names(), (Words{"a.vdb"}));
    EXPECT_EQ(mpuvdb({"render", "-", "-o", "a.png", "-q"}, grid).status, 0);
    EXPECT_EQ(mFolder.names(), (Words{"a.png", "a.vdb"}));
}

// Nothing is left behind, however the ends of the pipe behave.
TEST_F(CommandTest, BrokenPipesLeaveNothing)
{
    ASSERT_EQ(mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "-q"}).status, 0);
    std::filesystem::create_directory(mFolder / "scratch");
    const auto shell = [&](const std::string& line) {
        const std::string command = std::string(MPUVDB_COMMAND) + " ";
        return run(mFolder, {"bash", "-c",
                             "export TMPDIR=$PWD/scratch; set -o pipefail; " +
                                 std::regex_replace(line, std::regex("@"), command)});
    };
    const std::vector<std::pair<std::string, std::string>> cases = {
        {"@ mesh - -o - < a.vdb | head -c 80 > /dev/null", "cannot write to standard output"},
        {"@ mesh - -o - < a.vdb > /dev/full", "cannot write to standard output"},
        {"timeout 60 @ check - <&-", "cannot read standard input"},
        {"@ check a.vdb >&-", "cannot write to standard output"},
        {"head -c 3000 a.vdb | @ mesh - -o b.ply", "standard input: is truncated"},
        {"ulimit -f 10; @ offset a.vdb -o b.vdb --distance 1vx", "b.vdb: cannot be written"},
        {"ulimit -f 10; @ check - < a.vdb", "cannot keep what came from standard input"},
    };
    for (const auto& [line, said] : cases) {
        const Ended ended = shell(line);
        EXPECT_EQ(ended.status, 3) << line << "\n" << ended.err;
        EXPECT_NE(ended.err.find(said), std::string::npos) << line << "\n" << ended.err;
        EXPECT_TRUE(std::filesystem::is_empty(mFolder / "scratch")) << line;
        EXPECT_EQ(mFolder.names(), (Words{"a.vdb", "scratch"})) << line;
    }
    EXPECT_EQ(mpuvdb({"union", "-", "-", "-o", "b.vdb"}, readFile(mFolder / "a.vdb")).status, 2);
}

TEST_F(CommandTest, FullStandardOutputIsAnError)
{
    const Ended ended =
        run(mFolder, {"bash", "-c", std::string(MPUVDB_COMMAND) + " --help > /dev/full"});
    EXPECT_EQ(ended.status, 3);
    EXPECT_NE(ended.err.find("cannot write to standard output"), std::string::npos) << ended.err;
}

TEST_F(CommandTest, ProgressIsJsonLinesWhereAsked)
{
    const Ended ended = mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--progress", "json", "-q"});
    ASSERT_EQ(ended.status, 0) << ended.err;
    std::istringstream lines(ended.err);
    int count = 0;
    for (std::string line; std::getline(lines, line); ++count) {
        const json entry = json::parse(line);
        EXPECT_EQ(keysOf(entry), (Words{"fraction", "stage"}));
        EXPECT_GE(entry["fraction"], 0);
        EXPECT_LE(entry["fraction"], 1);
    }
    EXPECT_GT(count, 5);
}

TEST_F(CommandTest, MemoryLimitIsKept)
{
    const Ended ended = mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--voxels", "1500",
                                "--max-memory", "60M", "--report", "a.json"});
    EXPECT_EQ(ended.status, 5) << ended.err;
    EXPECT_EQ(readJson("a.json")["error"]["type"], "LimitError");
    for (const char* const noRoomForThreads : {"15M", "20M", "25M"}) {
        const Ended few =
            mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--max-memory", noRoomForThreads});
        EXPECT_EQ(few.status, 5) << noRoomForThreads << ": " << few.err;
    }
    EXPECT_EQ(mFolder.names(), (Words{"a.json"}));
}

/// OpenVDB and Blosc do not survive it where memory ends while they read.
TEST_F(CommandTest, GridsLargerThanTheLimitAreNotRead)
{
    ASSERT_EQ(mpuvdb({"reconstruct", scan(), "-o", "a.vdb", "--voxels", "400"}).status, 0);
    for (const Words& words : {Words{"offset", "a.vdb", "-o", "b.vdb", "--distance", "2vx"},
                               Words{"mesh", "a.vdb", "-o", "b.ply"}, Words{"check", "a.vdb"},
                               Words{"info", "a.vdb"}, Words{"render", "a.vdb", "-o", "b.png"}}) {
        Words limited = words;
        limited.insert(limited.end(), {"--max-memory", "24M"});
        const Ended ended = mpuvdb(limited);
        EXPECT_EQ(ended.status, 5) << words[0] << ": " << ended.err;
        EXPECT_NE(ended.err.find("grid 'surface' takes"), std::string::npos) << ended.err;
    }
    EXPECT_EQ(mFolder.names(), (Words{"a.vdb"}));
}

TEST_F(CommandTest, SameBytesForAnyNumberOfThreads)
{
    Words meshes, grids;
    for (const char* threads : {"1", "2", "8"}) {
        const Ended ended = mpuvdb(
            {"reconstruct", scan(), "-o", "a.vdb", "--mesh", "a.ply", "--threads", threads, "-q"});
        ASSERT_EQ(ended.status, 0) << ended.err;
        meshes.push_back(readFile(mFolder / "a.ply"));
        grids.push_back(readFile(mFolder / "a.vdb"));
    }
    EXPECT_GT(meshes[0].size(), 10000u);
    for (int i : {1, 2}) {
        EXPECT_TRUE(meshes[0] == meshes[i]);
        EXPECT_TRUE(grids[0] == grids[i]);
    }
}

TEST_F(CommandTest, PresetsSetWhatIsNotGiven)
{
    const auto settingsOf = [&](const Words& options) {
        Words words{"reconstruct", scan(), "-o", "p.vdb", "--report", "p.json"};
        words.insert(words.end(), options.begin(), options.end());
        const Ended ended = mpuvdb(words);
        EXPECT_EQ(ended.status, 0) << ended.err;
        return readJson("p.json")["settings"];
    };
    const json plain = settingsOf({});
    EXPECT_EQ(plain["preset"], "");
    const json clean = settingsOf({"--preset", "clean"});
    EXPECT_EQ(clean["outliers"], "keep");
    EXPECT_EQ(clean["normals"], "keep");
    EXPECT_EQ(clean["noise"], 0);
    const json particles = settingsOf({"--preset", "particles", "--outliers", "drop"});
    EXPECT_EQ(particles["outliers"], "drop"); // given, so the preset leaves it
    EXPECT_EQ(particles["sharp"], false);
    EXPECT_EQ(particles["alpha"], 1);
    const json terrain = settingsOf({"--preset", "terrain", "--normals", "keep"});
    EXPECT_EQ(terrain["holes"], "open");
    EXPECT_EQ(terrain["normals"], "keep");
    EXPECT_EQ(mpuvdb({"reconstruct", scan(), "-o", "p.vdb", "--preset", "film"}).status, 2);
}

TEST_F(CommandTest, NormalsAreEstimatedAndInsideOutIsCuredAndSaid)
{
    const Words sphere{"sample", "sphere(1)", "--points", "5000", "-o", "bare.xyz", "--no-normals"};
    ASSERT_EQ(mpuvdb(sphere).status, 0);
    const Ended bare = mpuvdb({"reconstruct", "bare.xyz", "-o", "a.vdb", "--report", "bare.json"});
    ASSERT_EQ(bare.status, 0) << bare.err;
    EXPECT_NE(bare.err.find("normals     estimated"), std::string::npos) << bare.err;

    // A solid that is inside out is turned, unless its normals are kept, or turned by the user.
    const std::string points = readFile(mFolder / "bare.xyz");
    std::istringstream lines(points);
    std::string inward;
    for (double x = 0, y = 0, z = 0; lines >> x >> y >> z;) {
        for (double value : {x, y, z, -x, -y, -z}) inward += std::to_string(value) + " ";
        inward += "\n";
    }
    writeFile(mFolder / "inward.xyz", inward);
    const Ended kept = mpuvdb({"reconstruct", "inward.xyz", "-o", "b.vdb", "--normals", "keep"});
    EXPECT_NE(kept.err.find("turn them with --flip-normals"), std::string::npos) << kept.err;
    const Ended room = mpuvdb({"reconstruct", "bare.xyz", "-o", "b.vdb", "--viewpoint", "0,0,0"});
    EXPECT_NE(room.err.find("that is right for a room"), std::string::npos) << room.err;
    const auto cured = [&](const Words& options) {
        Words words{"reconstruct", "inward.xyz", "-o",       "b.vdb",
                    "--mesh",      "b.ply",      "--report", "b.json"};
        words.insert(words.end(), options.begin(), options.end());
        const Ended ended = mpuvdb(words);
        EXPECT_EQ(ended.status, 0) << ended.err;
        EXPECT_EQ(ended.err.find("warning"), std::string::npos) << ended.err;
        EXPECT_NEAR(readJson("b.json")["mesh"]["volume"], 4 * M_PI / 3, 0.1);
        return ended.err;
    };
    const std::string said = cured({});
    EXPECT_NE(said.find("looked inward and were turned; --normals keep leaves them"),
              std::string::npos)
        << said;
    EXPECT_GT(readJson("b.json")["input"]["normals_turned"], 4000);
    EXPECT_EQ(cured({"--flip-normals"}).find("looked inward"), std::string::npos);
    const Ended spoilt = mpuvdb({"reconstruct", scan(), "-o", "c.vdb", "--flip-normals"});
    EXPECT_NE(spoilt.err.find("do without --flip-normals"), std::string::npos) << spoilt.err;
}

TEST_F(CommandTest, WarnsWhereManyNormalsAreTurned)
{
    const Words sphere{"sample", "sphere(1)", "--points", "5000", "-o", "sphere.xyz"};
    ASSERT_EQ(mpuvdb(sphere).status, 0);
    std::istringstream lines(readFile(mFolder / "sphere.xyz"));
    std::string mixed;
    std::mt19937 engine(3);
    for (double x = 0, y = 0, z = 0, nx = 0, ny = 0, nz = 0;
         lines >> x >> y >> z >> nx >> ny >> nz;) {
        const double side = engine() % 5 < 2 ? -1 : 1;
        mixed += fmt::format("{} {} {} {} {} {}\n", x, y, z, side * nx, side * ny, side * nz);
    }
    writeFile(mFolder / "mixed.xyz", mixed);
    const Ended said = mpuvdb({"reconstruct", "mixed.xyz", "-o", "a.vdb"});
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_NE(said.err.find("--normals estimate makes new ones"), std::string::npos) << said.err;
    const Ended cured =
        mpuvdb({"reconstruct", "mixed.xyz", "-o", "a.vdb", "--normals", "estimate"});
    EXPECT_EQ(cured.status, 0) << cured.err;
    EXPECT_EQ(cured.err.find("warning"), std::string::npos) << cured.err;
}

TEST_F(CommandTest, InfoKnowsPointsAndGrids)
{
    const Ended ended = mpuvdb({"info", scan(), grid(), "--json"});
    ASSERT_EQ(ended.status, 0) << ended.err;
    const json files = json::parse(ended.out)["files"];
    ASSERT_EQ(files.size(), 2u);
    EXPECT_NEAR(files[0]["points"].get<double>(), 8000, 800);
    EXPECT_EQ(files[0]["normals"], true);
    const json& surface = files[1]["grids"][0];
    EXPECT_EQ(surface["name"], "surface");
    EXPECT_EQ(surface["class"], "level set");
    for (const char* key : {"mpuvdb:tolerance", "mpuvdb:voxel_size", "mpuvdb:version"})
        EXPECT_TRUE(surface["metadata"].contains(key)) << key;
    const Ended text = mpuvdb({"info", grid()});
    EXPECT_NE(text.out.find("class: level set"), std::string::npos) << text.out;
}

TEST_F(CommandTest, CheckAcceptsOursAndRefusesWhatIsNoVdb)
{
    const Ended good = mpuvdb({"check", grid()});
    EXPECT_EQ(good.status, 0) << good.out << good.err;
    EXPECT_NE(good.out.find("sound"), std::string::npos);
    EXPECT_EQ(mpuvdb({"check", grid(), "--grid", "nix"}).status, 3);
    const std::string bytes = readFile(grid());
    writeFile(mFolder / "half.vdb", bytes.substr(0, bytes.size() / 2));
    const Ended half = mpuvdb({"check", "half.vdb"});
    EXPECT_EQ(half.status, 3) << half.err;
    EXPECT_NE(half.err.find("half.vdb"), std::string::npos);
}

TEST_F(CommandTest, MeshTellsOfSignsThatDisagree)
{
    // The band alone is negated, as programs do that turn active values only.
    const auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1, {}, 0.1f);
    grid->setName("surface");
    for (auto v = grid->beginValueOn(); v; ++v) v.setValue(-*v);
    openvdb::io::File(mFolder / "turned.vdb").write({grid});
    const Ended turned = mpuvdb({"mesh", "turned.vdb", "-o", "a.ply", "-q"});
    EXPECT_EQ(turned.status, 4) << turned.err;
    EXPECT_NE(turned.err.find("without a band of distances"), std::string::npos) << turned.err;
    EXPECT_EQ(mpuvdb({"offset", "turned.vdb", "-o", "b.vdb", "--distance", "0.1"}).status, 3);
    // A tenth of the radius lacks its band, and with it 5 % of the surface: distances enough for
    // operations, but not those of its mesh.
    const auto part = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1, {}, 0.1f);
    part->setName("surface");
    for (auto v = part->beginValueOn(); v; ++v)
        if (v.getCoord().x() > 9) v.setValueOff();
    openvdb::io::File(mFolder / "part.vdb").write({part});
    for (const Words& words :
         {Words{"mesh", "part.vdb", "-o", "c.ply"}, Words{"slice", "part.vdb", "-o", "c.svg"}}) {
        const Ended ended = mpuvdb(words);
        EXPECT_EQ(ended.status, 4) << words[0];
        EXPECT_NE(ended.err.find("without a band of distances"), std::string::npos) << ended.err;
    }
}

TEST_F(CommandTest, MeshAndRenderWriteTheirFormats)
{
    for (const char* name : {"a.ply", "a.obj", "a.stl"})
        EXPECT_EQ(mpuvdb({"mesh", grid(), "-o", name, "-q"}).status, 0) << name;
    const Ended drawn = mpuvdb({"render", grid(), "-o", "a.png", "--size", "64x48"});
    EXPECT_EQ(drawn.status, 0) << drawn.err;
    EXPECT_EQ(readFile(mFolder / "a.png").substr(1, 3), "PNG");
    EXPECT_EQ(mpuvdb({"render", grid(), "-o", "b.png", "--size", "64"}).status, 2);
    EXPECT_EQ(mpuvdb({"render", grid(), "-o", "b.png", "--up", "x"}).status, 2);
    EXPECT_EQ(mpuvdb({"render", grid(), "-o", "a.png", "--size", "64x48", "--up", "z"}).status, 0);
    EXPECT_EQ(mFolder.names(), (Words{"a.obj", "a.ply", "a.png", "a.stl"}));
}

/// A sphere of which a scanner sees one side.
class HolesTest : public CommandTest
{
protected:
    void SetUp() override
    {
        const Ended sampled = mpuvdb({"sample", "sphere(1)", "-o", "half.ply", "--points", "8000",
                                      "--pattern", "scan", "--viewpoint", "5", "0", "0", "-q"});
        ASSERT_EQ(sampled.status, 0) << sampled.err;
    }
};

TEST_F(HolesTest, StayOpenWhereAsked)
{
    const Ended made = mpuvdb({"reconstruct", "half.ply", "-o", "a.vdb", "--mesh", "a.ply",
                               "--holes", "open", "--report", "a.json"});
    ASSERT_EQ(made.status, 0) << made.err;
    EXPECT_EQ(made.err.find("warning"), std::string::npos) << made.err;
    const json report = readJson("a.json");
    EXPECT_EQ(report["settings"]["holes"], "open");
    EXPECT_EQ(report["coverage"]["active_voxels"], report["grid"]["active_voxels"]);
    EXPECT_EQ(report["holes"]["open"], 1);
    EXPECT_EQ(report["mesh"]["boundary_loops"], 1);
    EXPECT_EQ(report["mesh"]["components"], 1);
    EXPECT_EQ(report["mesh"]["non_manifold_edges"], 0);

    // The same from the file, and closed where the hole is small enough, or nothing is said.
    // (But for creases, which the field knows better than its values.)
    ASSERT_EQ(
        mpuvdb({"mesh", "a.vdb", "-o", "b.ply", "--holes", "open", "--report", "b.json", "-q"})
            .status,
        0);
    const json again = readJson("b.json");
    EXPECT_EQ(again["holes"], report["holes"]);
    EXPECT_EQ(again["mesh"]["boundary_loops"], 1);
    EXPECT_NEAR(again["mesh"]["area"].get<double>() / report["mesh"]["area"].get<double>(), 1,
                1e-2);
    for (const Words& closed : {Words{"--holes", "90%"}, Words{"--holes", "close"}, Words{}}) {
        Words words{"mesh", "a.vdb", "-o", "c.ply", "--report", "c.json"};
        words.insert(words.end(), closed.begin(), closed.end());
        ASSERT_EQ(mpuvdb(words).status, 0);
        EXPECT_EQ(readJson("c.json")["mesh"]["boundary_edges"], 0);
    }
    EXPECT_EQ(mpuvdb({"check", "a.vdb"}).status, 0);
}

TEST_F(HolesTest, NeedCoverage)
{
    ASSERT_EQ(mpuvdb({"reconstruct", "half.ply", "-o", "a.vdb", "-q"}).status, 0);
    const Ended without = mpuvdb({"mesh", "a.vdb", "-o", "a.ply", "--holes", "open"});
    EXPECT_EQ(without.status, 3);
    EXPECT_NE(without.err.find("reconstruct --coverage"), std::string::npos) << without.err;
    EXPECT_EQ(mpuvdb({"mesh", "a.vdb", "-o", "a.ply", "--holes", "ajar"}).status, 2);
    EXPECT_EQ(mpuvdb({"mesh", "a.vdb", "-o", "a.ply", "--holes", "-1"}).status, 2);
    EXPECT_EQ(mFolder.names(), (Words{"a.vdb", "half.ply"}));
}

TEST_F(HolesTest, CoverageOpensInPython)
{
    ASSERT_EQ(mpuvdb({"reconstruct", "half.ply", "-o", "a.vdb", "--coverage", "-q"}).status, 0);
    const auto python = [&](const std::string& code) {
        return run(mFolder, {"/usr/bin/python3", "-c", "import pyopenvdb as vdb\n" + code});
    };
    if (python("").status != 0) GTEST_SKIP() << "python3-openvdb is not installed";
    const Ended read = python("surface = vdb.read('a.vdb', 'surface')\n"
                              "grid = vdb.read('a.vdb', 'coverage')\n"
                              "values = [v.value for v in grid.iterOnValues()]\n"
                              "print(surface.gridClass, grid.gridClass, grid.background, "
                              "min(values), max(values), grid.transform == surface.transform)");
    EXPECT_EQ(read.status, 0) << read.err;
    EXPECT_EQ(read.out, "level set unknown 0.0 0.0 1.0 True\n");
}

TEST_F(CommandTest, SampleIsSeededAndListsItsSolids)
{
    const auto sample = [&](const char* seed) {
        const Ended ended = mpuvdb({"sample", "box(1,2,3)", "-o", "-", "--points", "2000",
                                    "--pattern", "scan", "--noise", "0.1%", "--seed", seed});
        EXPECT_EQ(ended.status, 0) << ended.err;
        return ended.out;
    };
    EXPECT_TRUE(sample("7") == sample("7"));
    EXPECT_FALSE(sample("7") == sample("8"));
    EXPECT_NE(mpuvdb({"sample", "--list"}).out.find("torus"), std::string::npos);
}

} // namespace
} // namespace mpuvdb::test
