// What is left when a run is stopped: by Ctrl-C, by the system, by kill -9.
#include "command_process.h"

#include <gtest/gtest.h>

#include <csignal>
#include <random>
#include <thread>

namespace mpuvdb::test
{
namespace
{

using Clock = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using Words = std::vector<std::string>;

constexpr Milliseconds kPromise{250};

/// A run of a second or more, and how long it takes when left alone.
class InterruptTest : public testing::Test
{
protected:
    static void SetUpTestSuite()
    {
        ourInputs = new TemporaryFolder;
        const Ended ended =
            run(*ourInputs, {"mpuvdb", "sample", "blob(1,12,0.05)", "-o", "scan.ply", "--points",
                             "200000", "--pattern", "random"});
        ASSERT_EQ(ended.status, 0) << ended.err;
    }
    static void TearDownTestSuite() { delete ourInputs; }

    static Words work()
    {
        return {"mpuvdb",     "reconstruct", *ourInputs / "scan.ply",
                "-o",         "a.vdb",       "--voxels",
                "300",        "--mesh",      "a.ply",
                "--progress", "json"};
    }

    static Milliseconds duration()
    {
        static const Milliseconds once = [] {
            const TemporaryFolder folder;
            const Clock::time_point start = Clock::now();
            const Ended ended = run(folder, work());
            EXPECT_EQ(ended.status, 0) << ended.err;
            return Clock::now() - start;
        }();
        return once;
    }

    /// Signal a run at @a moment. @return how long it took to end; less than zero if it was done.
    static Milliseconds latency(const TemporaryFolder& folder, Milliseconds moment, int signal,
                                Ended& ended)
    {
        Process process(folder, work());
        std::this_thread::sleep_for(moment);
        if (!process.running()) {
            ended = process.wait();
            return Milliseconds(-1);
        }
        const Clock::time_point start = Clock::now();
        process.signal(signal);
        ended = process.wait();
        return Clock::now() - start;
    }

private:
    static TemporaryFolder* ourInputs;
};

TemporaryFolder* InterruptTest::ourInputs = nullptr;

TEST_F(InterruptTest, StopsInTimeAtAnyMomentAndLeavesNothing)
{
    const unsigned seed = std::random_device{}();
    std::mt19937 random(seed);
    int stopped = 0;
    for (int trial = 0; trial < 8; ++trial) {
        const Milliseconds moment =
            duration() * (0.05 + 0.1 * trial + 0.1 * double(random()) / 0x1p32);
        SCOPED_TRACE(testing::Message()
                     << "seed " << seed << ", after " << moment.count() << " ms");
        // The machine may be busy with other things: the best of three is what we answer for.
        Milliseconds best{1e9};
        for (int attempt = 0; attempt < 3 && best > kPromise; ++attempt) {
            const TemporaryFolder folder;
            Ended ended;
            const Milliseconds taken = latency(folder, moment, trial % 2 ? SIGTERM : SIGINT, ended);
            best = std::min(best, taken);
            if (taken < Milliseconds(0) || ended.status == 0) break; // it was faster this time
            ++stopped;
            EXPECT_EQ(ended.status, trial % 2 ? 143 : 130) << ended.err;
            for (const std::string& name : folder.names())
                EXPECT_TRUE(name == "a.vdb" || name == "a.ply") << name << " is left behind";
        }
        EXPECT_LE(best.count(), kPromise.count());
    }
    EXPECT_GE(stopped, 4);
}

TEST_F(InterruptTest, SecondSignalEndsAtOnce)
{
    const TemporaryFolder folder;
    Process process(folder, work());
    while (process.running() && process.said().find("fraction") == std::string::npos)
        std::this_thread::sleep_for(Milliseconds(1));
    process.signal(SIGINT);
    process.signal(SIGINT);
    EXPECT_EQ(process.wait().status, 130);
    EXPECT_TRUE(folder.names().empty());
}

TEST_F(InterruptTest, KillLeavesTheOldOutputWhole)
{
    const unsigned seed = std::random_device{}();
    std::mt19937 random(seed);
    const TemporaryFolder folder;
    for (int trial = 0; trial < 6; ++trial) {
        // The last third is where files are written.
        const Milliseconds moment = duration() * (0.6 + 0.45 * double(random()) / 0x1p32);
        SCOPED_TRACE(testing::Message()
                     << "seed " << seed << ", after " << moment.count() << " ms");
        writeFile(folder / "a.vdb", "the old one");
        Ended ended;
        latency(folder, moment, SIGKILL, ended);
        if (readFile(folder / "a.vdb") == "the old one") continue;
        const Ended checked = run(folder, {"mpuvdb", "check", "a.vdb"});
        EXPECT_EQ(checked.status, 0) << checked.out << checked.err;
    }
}

} // namespace
} // namespace mpuvdb::test
