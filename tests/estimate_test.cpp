// What --dry-run foresees beside what the run then takes, and runs refused for their memory.
#include "command_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;
using Words = std::vector<std::string>;

class EstimateTest : public testing::Test
{
protected:
    Ended mpuvdb(Words words) const
    {
        words.insert(words.begin(), "mpuvdb");
        return run(mFolder, words);
    }

    /// Run reconstruct with @a words; its report.
    json reconstruct(Words words) const
    {
        words.insert(words.begin(), "reconstruct");
        words.insert(words.end(), {"--quiet", "--report", "r.json"});
        const Ended ended = mpuvdb(words);
        EXPECT_EQ(ended.status, 0) << ended.err;
        return json::parse(readFile(mFolder / "r.json"));
    }

    void sample(const std::string& solid, const std::string& file, const Words& options) const
    {
        Words words{"sample", solid, "-o", file, "--pattern", "random"};
        words.insert(words.end(), options.begin(), options.end());
        const Ended ended = mpuvdb(words);
        ASSERT_EQ(ended.status, 0) << ended.err;
    }

    /// Foresee a run, do it, and compare.
    void expectForeseen(const Words& words)
    {
        Words dry = words, real = words;
        dry.push_back("--dry-run");
        real.insert(real.end(), {"-o", "o.vdb"});
        const json foreseen = reconstruct(dry), report = reconstruct(real);
        std::string what;
        for (const std::string& word : words) what += word + " ";
        EXPECT_EQ(foreseen["settings"], report["settings"]) << what;
        EXPECT_EQ(foreseen["input"], report["input"]) << what;
        const json& estimate = foreseen["estimate"];
        double peak = 0;
        for (const json& stage : report["stages"])
            peak = std::max(peak, stage["peak_bytes"].get<double>());
        const auto ratio = [&](const char* key, double taken) {
            return estimate[key].get<double>() / taken;
        };
        // The sanitizers' memory is not the program's.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
        EXPECT_NEAR(ratio("peak_bytes", peak), 1, 0.2) << what;
#endif
        const double active = report["grid"]["active_voxels"];
        EXPECT_NEAR(ratio("active_voxels", active), 1, 0.12) << what;
        EXPECT_NEAR(ratio("leaves", report["field"]["leaves"]), 1, 0.35) << what;
        if (active > 3e5) { // of small files the part that all have is large
            const double file = double(readFile(mFolder / "o.vdb").size());
            EXPECT_NEAR(ratio("file_bytes", file), 1, 0.5) << what; // flat surfaces pack well
        }
    }

    TemporaryFolder mFolder;
};

TEST_F(EstimateTest, DryRunsWriteNothing)
{
    sample("torus(1,0.4)", "a.ply", {"--points", "8000"});
    const Ended ended = mpuvdb(
        {"reconstruct", "a.ply", "--dry-run", "-o", "a.vdb", "--mesh", "m.ply", "--voxels", "100"});
    EXPECT_EQ(ended.status, 0) << ended.err;
    EXPECT_EQ(mFolder.names(), (Words{"a.ply"}));
    for (const char* said :
         {"voxel size 0.02799", "tolerance 0.002799", "active voxels", "of memory"})
        EXPECT_NE(ended.err.find(said), std::string::npos) << said << " in " << ended.err;
    EXPECT_EQ(mpuvdb({"reconstruct", "a.ply", "--dry-run", "--voxels", "1"}).status, 2);
    EXPECT_EQ(mpuvdb({"reconstruct", "b.ply", "--dry-run"}).status, 3);
}

TEST_F(EstimateTest, ForeseesWhatRunsTake)
{
    sample("torus(1,0.4)", "torus.ply", {"--points", "20000"});
    expectForeseen({"torus.ply"});
    expectForeseen({"torus.ply", "--voxels", "180", "--mesh", "m.ply"});
    expectForeseen({"torus.ply", "--voxels", "160", "--coverage", "--half-width", "5"});
    expectForeseen({"torus.ply", "--voxels", "60", "--interpolate"});
    sample("blob(1,20,0.05)", "dense.ply", {"--points", "120000"});
    expectForeseen({"dense.ply", "--voxels", "70"});
    sample("blob(1,20,0.05)", "holes.ply",
           {"--points", "30000", "--holes", "3", "--hole-radius", "0.15", "--noise", "0.004"});
    expectForeseen({"holes.ply"});
    expectForeseen({"holes.ply", "--voxels", "160"});
    // Along the axes its values would repeat, and the file pack to nothing.
    sample("rotate(box(2,1.5,0.05),1,2,3,20)", "slab.ply", {"--points", "20000"});
    expectForeseen({"slab.ply", "--voxels", "200"});
}

TEST_F(EstimateTest, ForeseesWhatRunsOnScansTake)
{
    const char* const folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    const std::string data = std::string(folder) + "/";
    // Two of the ten scans of the bunny, together.
    writeFile(mFolder / "two.conf", "bmesh " + data + "bunny/bun000.ply 0 0 0 0 0 0 1\nbmesh " +
                                        data +
                                        "bunny/bun045.ply -0.0520211 -0.000383981 -0.0109223 "
                                        "0.00548449 -0.294635 -0.0038555 0.955586\n");
    expectForeseen({"two.conf"});
    expectForeseen({data + "bunny/bun000.ply"});
    expectForeseen({data + "clouds/bun0.pcd"});
    expectForeseen({data + "clouds/kitten.xyz", "--voxels", "300"});
}

TEST_F(EstimateTest, RefusesBeforeTheWorkAndSaysWhatFits)
{
    sample("torus(1,0.4)", "a.ply", {"--points", "20000"});
    // A mesh needs the whole level set at once.
    const Ended refused =
        mpuvdb({"reconstruct", "a.ply", "-o", "a.vdb", "--mesh", "m.ply", "--voxels", "1500",
                "--max-memory", "120M", "--report", "r.json"});
    EXPECT_EQ(refused.status, 5) << refused.err;
    EXPECT_EQ(mFolder.names(), (Words{"a.ply", "r.json"}));
    const json report = json::parse(readFile(mFolder / "r.json"));
    EXPECT_EQ(report["error"]["type"], "LimitError");
    for (const json& stage : report["stages"]) EXPECT_NE(stage["name"], "check");
    const std::string option = "--voxel-size ";
    const std::size_t at = refused.err.find(option);
    ASSERT_NE(at, std::string::npos) << refused.err;
    const std::string size = refused.err.substr(at + option.size(), 8);
    const double fitting = std::atof(size.c_str());
    EXPECT_GT(fitting, 2.8 / 1500);
    EXPECT_LT(fitting, 2.8 / 150) << "far more than needed";
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    const Ended fits = mpuvdb({"reconstruct", "a.ply", "-o", "a.vdb", "--mesh", "m.ply",
                               "--voxel-size", std::to_string(fitting), "--max-memory", "120M"});
    EXPECT_EQ(fits.status, 0) << fits.err;
#endif
    const Ended hopeless = mpuvdb({"reconstruct", "a.ply", "-o", "b.vdb", "--max-memory", "20M"});
    EXPECT_EQ(hopeless.status, 5) << hopeless.err;
}

// The triangles that pictures are traced through are foreseen, and others refused.
TEST_F(EstimateTest, RenderForeseesItsMesh)
{
    sample("blob(1,20,0.05)", "blob.ply", {"--points", "40000"});
    reconstruct({"blob.ply", "-o", "a.vdb", "--voxels", "350"});
    const Ended refused =
        mpuvdb({"render", "a.vdb", "-o", "o.png", "--size", "80x60", "--max-memory", "95M"});
    EXPECT_EQ(refused.status, 5) << refused.err;
    EXPECT_FALSE(std::filesystem::exists(mFolder / "o.png"));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_NE(refused.err.find("mesh needs about"), std::string::npos) << refused.err;
#endif
    EXPECT_EQ(mpuvdb({"render", "a.vdb", "-o", "o.png", "--size", "80x60"}).status, 0);
}

// Verbs say beforehand what they take: within a factor of two, beside what the program has itself.
TEST_F(EstimateTest, VerbsForeseeWhatTheyTake)
{
    sample("blob(1,20,0.05)", "blob.ply", {"--points", "40000"});
    reconstruct({"blob.ply", "-o", "a.vdb", "--voxels", "140"});
    // An offset inward needs hardly more than a grid of the other's size takes to be read.
    reconstruct({"blob.ply", "-o", "larger.vdb", "--voxels", "200"});
    ASSERT_EQ(mpuvdb({"transform", "a.vdb", "-o", "b.vdb", "--translate", "0.6,0,0"}).status, 0);
    for (const Words& verb : std::vector<Words>{
             {"offset", "a.vdb", "--distance", "20vx"},
             {"offset", "larger.vdb", "--distance=-10vx"},
             {"shell", "a.vdb", "--thickness", "10vx"},
             {"smooth", "a.vdb", "--width", "2"},
             {"union", "a.vdb", "b.vdb", "--blend", "15vx"},
             {"morph", "a.vdb", "b.vdb"},
             {"resample", "a.vdb", "--half-width", "30"},
         }) {
        SCOPED_TRACE(verb[0] + " " + verb.back());
        Words free = verb, bound = verb;
        free.insert(free.end(), {"-o", "o.vdb", "--report", "r.json"});
        ASSERT_EQ(mpuvdb(free).status, 0);
        double peak = 0, read = 0;
        const json report = json::parse(readFile(mFolder / "r.json"));
        for (const json& stage : report["stages"]) {
            peak = std::max(peak, stage["peak_bytes"].get<double>());
            if (stage["name"] == "read") read = stage["peak_bytes"].get<double>();
        }
        std::filesystem::remove(mFolder / "o.vdb");
        const double limit = read + 0.1 * (peak - read);
        bound.insert(bound.end(),
                     {"-o", "o.vdb", "--max-memory", std::to_string(std::uint64_t(limit))});
        const Ended refused = mpuvdb(bound);
        EXPECT_EQ(refused.status, 5) << refused.err;
        EXPECT_FALSE(std::filesystem::exists(mFolder / "o.vdb"));
        const std::string needs = "needs about ";
        const std::size_t at = refused.err.find(needs);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
        ASSERT_NE(at, std::string::npos) << refused.err;
        constexpr double kProgram = 33e6;
        const double foreseen = 1e6 * std::atof(refused.err.c_str() + at + needs.size());
        EXPECT_GT(foreseen, (peak - kProgram) / 2);
        EXPECT_LT(foreseen, (peak - kProgram) * 2);
#endif
    }
}

} // namespace
} // namespace mpuvdb::test
