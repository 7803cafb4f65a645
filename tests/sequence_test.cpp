// Sequences: a verb once for each frame, with failures, shares of memory, signals and reports.
#include "command_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <csignal>
#include <set>
#include <sstream>
#include <thread>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;
using Clock = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using Words = std::vector<std::string>;

class SequenceTest : public testing::Test
{
protected:
    Ended mpuvdb(Words words, int status = 0) const
    {
        words.insert(words.begin(), "mpuvdb");
        const Ended ended = run(folder, words);
        EXPECT_EQ(ended.status, status) << words[1] << "\n" << ended.err;
        return ended;
    }
    /// Scans of a torus, one for each frame, all different.
    void scans(const std::string& frames) const
    {
        mpuvdb({"sample", "torus(1,0.4)", "--points", "1500", "--seed", "$F", "-o", "in.####.ply",
                "--frames", frames, "-q"});
    }
    std::string bytes(const std::string& name) const { return readFile(folder / name); }
    bool has(const std::string& name) const { return std::filesystem::exists(folder / name); }

    TemporaryFolder folder;
};

TEST_F(SequenceTest, AllPatternsTakeTheNumberInPositionalsOptionsAndValues)
{
    scans("7-9x2");
    EXPECT_EQ(folder.names(), (Words{"in.0007.ply", "in.0009.ply"}));
    EXPECT_NE(bytes("in.0007.ply"), bytes("in.0009.ply")) << "the seed is the frame's number";
    const std::string alone = "alone.ply";
    mpuvdb({"sample", "torus(1,0.4)", "--points", "1500", "--seed", "9", "-o", alone, "-q"});
    EXPECT_EQ(bytes("in.0009.ply"), bytes(alone));

    mpuvdb({"reconstruct", "in.%04d.ply", "-o", "a.$F3.vdb", "--mesh", "a.$F.obj", "--usd",
            "a.##.usda", "--report", "a.%d.json", "--frames=7-9x2"});
    for (const char* name : {"a.007.vdb", "a.009.vdb", "a.7.obj", "a.9.obj", "a.07.usda",
                             "a.09.usda", "a.7.json", "a.9.json"})
        EXPECT_TRUE(has(name)) << name;
    const json report = json::parse(bytes("a.9.json"));
    EXPECT_EQ(report["input"]["points"], 1500) << "the frame's own report";
    EXPECT_NE(bytes("a.09.usda").find("@./a.009.vdb@"), std::string::npos);
    mpuvdb({"reconstruct", "in.0009.ply", "-o", "one.vdb"});
    EXPECT_EQ(bytes("a.009.vdb"), bytes("one.vdb")) << "as the same command without frames";
    // A single # beside others is part of a name.
    mpuvdb({"reconstruct", "in.%04d.ply", "-o", "shot#1.##.vdb", "--frames=7"});
    EXPECT_TRUE(has("shot#1.07.vdb"));
}

TEST_F(SequenceTest, AFrameThatFailsIsToldAndStopsNoOther)
{
    scans("1-5");
    std::filesystem::remove(folder / "in.0002.ply");
    writeFile(folder / "in.0004.ply", "no points\n");
    const Ended ended = mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames",
                                "1-5", "--jobs", "2", "--report", "r.json"},
                               3);
    EXPECT_NE(ended.err.find("frame 2: mpuvdb reconstruct: in.0002.ply: cannot be read"),
              std::string::npos)
        << ended.err;
    EXPECT_NE(ended.err.find("2 of 5 frames failed: 2 (status 3), 4 (status 3)"), std::string::npos)
        << ended.err;
    for (const int frame : {1, 2, 3, 4, 5})
        EXPECT_EQ(has("out.000" + std::to_string(frame) + ".vdb"), frame % 2 == 1) << frame;
    const json report = json::parse(bytes("r.json"));
    ASSERT_EQ(report["frames"].size(), 5u);
    EXPECT_EQ(report["error"]["type"], "FramesFailed");
    for (int n = 0; n < 5; ++n) {
        const json& frame = report["frames"][std::size_t(n)];
        EXPECT_EQ(frame["frame"], n + 1);
        EXPECT_EQ(frame["status"], n % 2 ? 3 : 0);
        EXPECT_EQ(frame.contains("message"), n % 2 == 1);
        EXPECT_EQ(frame["outputs"][0], "out.000" + std::to_string(n + 1) + ".vdb");
    }
    EXPECT_EQ(report["frames"][0]["report"]["input"]["points"], 1500);
}

TEST_F(SequenceTest, TheLargestStatusOfTheFramesIsTheSequences)
{
    scans("1-3");
    mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames", "1-3"});
    std::filesystem::remove(folder / "out.0002.vdb");
    writeFile(folder / "out.0002.vdb", "nothing");
    mpuvdb({"check", "out.####.vdb", "--frames", "1-3"}, 3);
    // Frames at the same time share the memory: 60 MB are enough for one of them, and 30 are not.
    const Words work = {"reconstruct", "in.####.ply", "-o",           "big.####.vdb",
                        "--frames",    "1-3",         "--voxels",     "3#",
                        "--jobs",      "1",           "--max-memory", "60M"};
    mpuvdb(work);
    Words shared = work;
    shared[9] = "2";
    const Ended ended = mpuvdb(shared, 5);
    EXPECT_NE(ended.err.find("3 of 3 frames failed: 1 (status 5)"), std::string::npos) << ended.err;
}

TEST_F(SequenceTest, SkipsWhatIsThereAndMakesOneFrameAlone)
{
    scans("1-3");
    const Words work = {"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames", "1-3"};
    Words one = work, rest = work, none = work;
    one.insert(one.end(), {"--only", "2"});
    mpuvdb(one);
    EXPECT_FALSE(has("out.0001.vdb"));
    ASSERT_TRUE(has("out.0002.vdb"));
    writeFile(folder / "out.0002.vdb", "mine");
    writeFile(folder / "out.0003.vdb", "");
    rest.insert(rest.end(), {"--skip-existing", "--report", "r.json"});
    mpuvdb(rest);
    EXPECT_EQ(bytes("out.0002.vdb"), "mine");
    EXPECT_TRUE(has("out.0001.vdb") && bytes("out.0003.vdb").size() > 1000);
    const json frames = json::parse(bytes("r.json"))["frames"];
    EXPECT_FALSE(frames[0].contains("skipped"));
    EXPECT_TRUE(frames[1]["skipped"]);
    none.insert(none.end(), {"--only", "4"});
    mpuvdb(none, 2);
    for (const char* option : {"--skip-existing", "--only=1", "--jobs=2"})
        mpuvdb({"reconstruct", "in.0001.ply", "-o", "x.vdb", option}, 2);
}

TEST_F(SequenceTest, ManyJobsGiveTheBytesOfOneAndPrintInOrder)
{
    scans("1-6");
    for (const char* jobs : {"1", "3"})
        mpuvdb({"reconstruct", "in.####.ply", "-o", std::string(jobs) + ".####.vdb", "--usd",
                std::string(jobs) + ".usda", "--frames", "1-6", "--jobs", jobs});
    for (int frame = 1; frame <= 6; ++frame) {
        const std::string name = ".000" + std::to_string(frame) + ".vdb";
        EXPECT_EQ(bytes("1" + name), bytes("3" + name)) << frame;
    }
    const auto told = [&](const char* jobs) {
        return mpuvdb({"check", "1.####.vdb", "--frames", "1-6", "--jobs", jobs}).out;
    };
    EXPECT_EQ(told("1"), told("3"));
    EXPECT_LT(told("3").find("1.0001.vdb"), told("3").find("1.0006.vdb"));
}

TEST_F(SequenceTest, JsonIsALineForEachFrame)
{
    scans("1-3");
    std::istringstream lines(
        mpuvdb({"info", "in.####.ply", "--json", "--frames", "1-3", "--jobs", "2"}).out);
    int frame = 0;
    for (std::string line; std::getline(lines, line);) {
        const json info = json::parse(line);
        EXPECT_EQ(info["frame"], ++frame);
        EXPECT_EQ(info["files"][0]["file"], "in.000" + std::to_string(frame) + ".ply");
    }
    EXPECT_EQ(frame, 3);
    EXPECT_FALSE(json::parse(mpuvdb({"info", "in.0001.ply", "--json"}).out).contains("frame"));
}

TEST_F(SequenceTest, OneUsdLayerHasATimeSampleForEachFrame)
{
    scans("1-4");
    std::filesystem::remove(folder / "in.0003.ply");
    mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--usd", "all.usda", "--frames",
            "1-4", "--up", "z"},
           3);
    const std::string layer = bytes("all.usda");
    for (const char* part :
         {"startTimeCode = 1\n", "endTimeCode = 4\n", "upAxis = \"Z\"", "extent.timeSamples = {",
          "asset filePath.timeSamples = {", "1: @./out.0001.vdb@,", "2: @./out.0002.vdb@,",
          "4: @./out.0004.vdb@,", "token fieldClass = \"levelSet\""})
        EXPECT_NE(layer.find(part), std::string::npos) << part << "\n" << layer;
    EXPECT_EQ(layer.find("out.0003"), std::string::npos);
}

TEST_F(SequenceTest, WhatCannotBeASequenceIsAUsageErrorBeforeAnyWork)
{
    scans("1-2");
    const struct {
        Words words;
        const char* said;
    } cases[] = {
        {{"in.####.ply", "-o", "out.vdb"}, "-o out.vdb: has no place for the frame's number"},
        {{"in.####.ply", "-o", "out.####.vdb", "--mesh", "m.ply"}, "--mesh m.ply: has no place"},
        {{"in.0001.ply", "-o", "out.####.vdb"}, "all frames would be the same"},
        {{"-", "-o", "out.####.vdb", "--voxels", "1$F0"}, "standard input can be read once"},
        {{"in.####.ply", "-o", "out.####.txt"}, "use .vdb"},
        {{"in.####.ply", "-o", "out.####.vdb", "--tolerence", "1"}, "did you mean --tolerance?"},
        {{"in.####.ply", "-o", "in.####.ply"}, "is also an input"},
    };
    for (const auto& c : cases) {
        Words words = {"reconstruct", "--frames", "1-2"};
        words.insert(words.end(), c.words.begin(), c.words.end());
        const Ended ended = mpuvdb(words, 2);
        EXPECT_NE(ended.err.find(c.said), std::string::npos) << ended.err;
    }
    const Ended single = mpuvdb({"reconstruct", "in.0001.ply", "-o", "out.####.vdb"}, 2);
    EXPECT_NE(single.err.find("there is no --frames"), std::string::npos) << single.err;
    mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames", "2-1"}, 2);
    mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames", "1-2", "--jobs", "0"},
           2);
    for (const char* range : {"3-1", "1,3", "a", "1-3x0"}) {
        const Ended ended =
            mpuvdb({"twist", "a.vdb", "-o", "t.####.vdb", "--turn", "$F", "--frames", range}, 2);
        EXPECT_NE(ended.err.find(std::string("--frames ") + range), std::string::npos) << ended.err;
    }
    EXPECT_EQ(folder.names(), (Words{"in.0001.ply", "in.0002.ply"}));
}

TEST_F(SequenceTest, TellsItsProgressByFrame)
{
    scans("1-2");
    const Ended ended = mpuvdb({"reconstruct", "in.####.ply", "-o", "out.####.vdb", "--frames",
                                "1-2", "--jobs", "2", "--progress", "json", "-q"});
    std::istringstream lines(ended.err);
    std::set<int> frames;
    for (std::string line; std::getline(lines, line);) {
        const json step = json::parse(line);
        frames.insert(step["frame"].get<int>());
        EXPECT_TRUE(step["fraction"].is_number());
    }
    EXPECT_EQ(frames, (std::set<int>{1, 2}));
}

/// A sequence of frames that take a second or more each.
TEST_F(SequenceTest, ASignalStopsAllFramesAndLeavesWholeOnes)
{
    constexpr Milliseconds kPromise{250};
    mpuvdb({"sample", "blob(1,12,0.05)", "-o", "scan.ply", "--points", "50000", "-q"});
    for (const int signal : {SIGINT, SIGTERM}) {
        for (const char* name : {"out.0001.vdb", "out.0002.vdb", "out.0003.vdb", "out.0004.vdb"})
            std::filesystem::remove(folder / name);
        // The first frame is small, the others are not.
        Process process(folder,
                        {"mpuvdb", "reconstruct", "scan.ply", "-o", "out.####.vdb", "--voxels",
                         "3#0", "--frames", "1-99x2", "--jobs", "2", "--report", "r.json"});
        const Clock::time_point patience = Clock::now() + std::chrono::seconds(60);
        while (!has("out.0001.vdb") && Clock::now() < patience)
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        const Clock::time_point start = Clock::now();
        process.signal(signal);
        const Ended ended = process.wait();
        EXPECT_LT(Milliseconds(Clock::now() - start), kPromise);
        EXPECT_EQ(ended.status, 128 + signal) << ended.err;
        for (const std::string& name : folder.names()) {
            EXPECT_EQ(name.find(".tmp"), std::string::npos) << name;
            if (name.rfind("out.", 0) == 0) mpuvdb({"check", name});
        }
        EXPECT_EQ(json::parse(bytes("r.json"))["error"]["type"], "Interrupted");
    }
}

} // namespace
} // namespace mpuvdb::test
