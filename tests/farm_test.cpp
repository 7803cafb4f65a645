// Jobs: tiles are the whole, byte for byte, whatever happens to their tasks.
#include "farm_fixture.h"

#include <mpuvdb/error.h>

#include <tbb/global_control.h>

#include <sys/wait.h>
#include <unistd.h>

namespace mpuvdb::test
{
namespace
{

class FarmTest : public JobFixture
{
protected:
    /// The bytes of the level set made by tasks; says how many tiles there were.
    std::string tiled(const PointCloud& cloud, const ReconstructOptions& options,
                      std::size_t& tiles) const
    {
        const Job job(done(cloud, options), kBuild);
        tiles = job.tasks();
        job.merge(at("tiled.vdb"));
        return bytesOf(at("tiled.vdb"));
    }

    void expectSame(const PointCloud& cloud, double h)
    {
        std::size_t tiles = 0;
        const ReconstructOptions options = voxelSize(h);
        const std::string parts = tiled(cloud, options, tiles);
        EXPECT_GE(tiles, 8u);
        EXPECT_TRUE(parts == whole(cloud, options)) << "the files differ";
    }
};

TEST_F(FarmTest, TilesOfExactPointsAreTheWhole)
{
    expectSame(
        randomScan("rotate(difference(box(2, 1.5, 1), cylinder(0.4, 3)), 1, 2, 3, 25)", 40000),
        0.008);
}

TEST_F(FarmTest, TilesOfNoisyPointsAreTheWhole)
{
    ScanSettings scan = scanSettings(30000);
    scan.noise = 0.01;
    expectSame(scanOf("torus(1, 0.4)", scan), 0.01);
}

TEST_F(FarmTest, TilesOfPointsWithHolesAreTheWhole)
{
    ScanSettings scan = scanSettings(30000);
    scan.holes = 6;
    scan.holeRadius = 0.15;
    scan.noise = 0.004;
    expectSame(scanOf("blob(1, 20, 0.05)", scan), 0.01);
}

TEST_F(FarmTest, TilesOfOneSideAreTheWhole)
{
    ScanSettings scan = scanSettings(30000);
    scan.pattern = ScanSettings::Pattern::Scan;
    scan.viewpoints = {Vec3d(3, 4, 2)};
    expectSame(scanOf("difference(box(2, 1.5, 1), cylinder(0.4, 3))", scan), 0.01);
}

TEST_F(FarmTest, TilesOfThinWallsAreTheWhole)
{
    expectSame(randomScan("difference(sphere(1), sphere(0.98))", 60000), 0.01);
}

TEST_F(FarmTest, TilesWithCoverageAndAttributesAreTheWhole)
{
    ScanSettings scan = scanSettings(30000);
    scan.confidence = true;
    scan.noise = 0.003;
    const PointCloud cloud = coloredTorus(scan);
    ReconstructOptions options = voxelSize(0.012);
    options.coverage = true;
    options.attributes = {kColorName, "confidence"};
    std::size_t tiles = 0;
    const std::string parts = tiled(cloud, options, tiles);
    EXPECT_GE(tiles, 8u);
    EXPECT_TRUE(parts == whole(cloud, options)) << "the files differ";
}

// Blunt edges of noisy points may have values that are restored again and again along an edge,
// across the borders of tiles: of these clouds the first has.
TEST_F(FarmTest, TilesOfBluntEdgesAreTheWhole)
{
    for (const std::uint64_t seed : {1, 2}) {
        ScanSettings scan = scanSettings(30000);
        scan.pattern = ScanSettings::Pattern::Even;
        scan.seed = seed;
        scan.noise = 0.003;
        const PointCloud cloud = scanOf("difference(box(2, 2, 1), cylinder(0.4, 3))", scan);
        ReconstructOptions options;
        options.sharp = false;
        std::size_t tiles = 0;
        const std::string parts = tiled(cloud, options, tiles);
        EXPECT_TRUE(parts == whole(cloud, options)) << "the files differ, seed " << seed;
        fs::remove_all(at("job"));
    }
}

TEST_F(FarmTest, WideBandsInTilesAreTheWhole)
{
    ReconstructOptions options = voxelSize(0.02);
    options.halfWidth = 12;
    const PointCloud cloud = randomScan("torus(1, 0.4)", 20000);
    std::size_t tiles = 0;
    const std::string parts = tiled(cloud, options, tiles);
    EXPECT_TRUE(parts == whole(cloud, options)) << "the files differ";
}

/// What is done again, by another number of threads, in parts of other sizes, changes nothing.
TEST_F(FarmTest, TheOrderAndTheNumberOfThreadsDoNotCount)
{
    const PointCloud cloud = randomScan("torus(1, 0.4)", 20000);
    const ReconstructOptions options = voxelSize(0.015);
    const std::string expected = whole(cloud, options);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const fs::path folder = plan(cloud, options, 700);
    runAll(folder);
    Job(folder, kBuild).gather();
    runAll(folder);
    runAll(folder);
    Job(folder, kBuild).merge(at("tiled.vdb"));
    EXPECT_TRUE(bytesOf(at("tiled.vdb")) == expected);
}

TEST_F(FarmTest, LostAndDamagedResultsAreFoundAndMadeAgain)
{
    const PointCloud cloud = randomScan("torus(1, 0.4)", 20000);
    const ReconstructOptions options = voxelSize(0.015);
    const fs::path folder = plan(cloud, options);
    {
        Job job(folder, kBuild);
        EXPECT_THROW(job.gather(), InputError); // nothing is done yet
        EXPECT_THROW(job.merge(at("tiled.vdb")), InputError);
    }
    runAll(folder);
    Job(folder, kBuild).gather();
    runAll(folder);
    const fs::path result = folder / "tiles" / "00001.bin";
    const std::string before = bytesOf(result);
    const auto turnBit = [](const fs::path& of) {
        const std::string bytes = bytesOf(of);
        std::fstream file(of, std::ios::in | std::ios::out | std::ios::binary);
        file.seekp(std::streamoff(bytes.size() / 2));
        file.put(char(bytes[bytes.size() / 2] ^ 4));
    };
    // A bit that turns, a file that ends early, one that is gone, a kill before its record, and a
    // record that ends early.
    const fs::path record = fs::path(result).replace_extension(".json");
    const std::vector<std::function<void()>> damages = {
        [&] { turnBit(result); }, [&] { fs::resize_file(result, before.size() - 10); },
        [&] { fs::remove(result); }, [&] { fs::remove(record); },
        [&] { fs::resize_file(record, 5); }};
    for (const auto& damage : damages) {
        damage();
        const Job job(folder, kBuild);
        EXPECT_THROW(job.merge(at("tiled.vdb")), InputError);
        EXPECT_FALSE(fs::exists(at("tiled.vdb")));
        job.dropDamaged();
        runAll(folder);
        EXPECT_TRUE(bytesOf(result) == before);
    }
    // What all tiles were made from cannot be made again alone.
    for (const char* const name : {"points.bin", "field.bin"}) {
        turnBit(folder / name);
        EXPECT_THROW(Job(folder, kBuild).merge(at("tiled.vdb")), InputError) << name;
        EXPECT_FALSE(fs::exists(at("tiled.vdb")));
        turnBit(folder / name);
    }
    Job(folder, kBuild).merge(at("tiled.vdb"));
    EXPECT_TRUE(bytesOf(at("tiled.vdb")) == whole(cloud, options));
}

// Between tiles that no data are in, nothing says where such a solid ends.
TEST_F(FarmTest, SolidsAllAboutThePointsAreRefused)
{
    PointCloud cloud = randomScan("torus(1, 0.4)", 20000);
    for (Vec3f& normal : cloud.normals) normal = -normal;
    const fs::path folder = plan(cloud, voxelSize(0.02));
    runAll(folder);
    EXPECT_THROW(Job(folder, kBuild).gather(), InputError);
}

TEST_F(FarmTest, OtherBuildsPlansAndInputsAreRefused)
{
    const PointCloud cloud = randomScan("torus(1, 0.4)", 5000);
    const ReconstructOptions options = voxelSize(0.05);
    const fs::path input = at("points.ply");
    std::ofstream(input) << "as they were";
    JobOptions job;
    job.build = kBuild;
    job.inputs = {input.string()};
    job.tileVoxels = 100;
    EXPECT_THROW(Job::plan(at("job"), prepared(cloud, options), job), UsageError);
    job.tileVoxels = 128;
    Job::plan(at("job"), prepared(cloud, options), job);
    EXPECT_THROW(Job::plan(at("job"), prepared(cloud, options), job), UsageError);
    EXPECT_THROW(Job(at("job"), "another build"), InputError);
    EXPECT_THROW(Job(at("nowhere"), kBuild), InputError);
    EXPECT_THROW(Job(at("job"), kBuild).run(10000), UsageError);
    std::ofstream(input) << "as they are now, which is not the same";
    EXPECT_THROW(Job(at("job"), kBuild), InputError);
    fs::remove(input); // not needed any more
    EXPECT_NO_THROW(Job(at("job"), kBuild));
}

TEST_F(FarmTest, ATaskIsRunningWhereItsProcessIs)
{
    const fs::path folder = plan(randomScan("torus(1, 0.4)", 5000), voxelSize(0.05));
    const auto stateUnder = [&](const std::string& mark) {
        std::ofstream(folder / "fit" / "00000.running") << mark << '\n';
        return Job(folder, kBuild).states().front().state;
    };
    char host[256] = {};
    ::gethostname(host, sizeof host - 1);
    EXPECT_EQ(stateUnder(fmt::format("{} {}", host, ::getpid())), TaskState::State::Running);
    EXPECT_EQ(stateUnder("elsewhere 1"), TaskState::State::Running);
    const pid_t ended = ::fork();
    if (ended == 0) ::_exit(0);
    ::waitpid(ended, nullptr, 0);
    EXPECT_EQ(stateUnder(fmt::format("{} {}", host, ended)), TaskState::State::Waiting);
}

TEST_F(FarmTest, WhatIsEstimatedComes)
{
    const PointCloud cloud = randomScan("torus(1, 0.4)", 100000);
    ReconstructOptions options = voxelSize(0.007); // 400 voxels across
    const PreparedPoints points = prepared(cloud, options);
    const ReconstructionEstimate run = estimate(points);
    const JobEstimate small = estimateJob(points, run, 128, 0);
    EXPECT_EQ(small.tileVoxels, 128);
    std::size_t tiles = 0;
    const fs::path file = at("tiled.vdb");
    tiled(cloud, options, tiles);
    // Those of the band beside the points, and all that hold some.
    EXPECT_LE(small.tiles, tiles);
    EXPECT_GE(double(small.tiles), 0.7 * double(tiles));
    std::uint64_t disk = fs::file_size(file);
    for (const auto& entry : fs::recursive_directory_iterator(at("job")))
        if (entry.is_regular_file()) disk += entry.file_size();
    EXPECT_NEAR(double(small.diskBytes) / double(disk), 1, 0.5);
    // Less memory makes smaller tiles, and then there are none.
    EXPECT_EQ(estimateJob(points, run, {}, 0).tileVoxels, 512);
    const JobEstimate large = estimateJob(points, run, 512, 0);
    EXPECT_GT(large.taskBytes, small.taskBytes);
    const JobEstimate fitting = estimateJob(points, run, {}, large.taskBytes);
    EXPECT_LT(fitting.tileVoxels, 512);
    EXPECT_THROW(estimateJob(points, run, {}, small.taskBytes / 2), LimitError);
}

TEST_F(FarmTest, WhatIsLeftOfAnotherPlanDoesNotCount)
{
    const PointCloud cloud = randomScan("torus(1, 0.4)", 20000);
    const ReconstructOptions options = voxelSize(0.015);
    runAll(plan(randomScan("torus(1, 0.3)", 20000), options));
    fs::remove(at("job") / "plan.json");
    std::size_t tiles = 0;
    EXPECT_TRUE(tiled(cloud, options, tiles) == whole(cloud, options));
    // A plan that fails leaves none of its own.
    fs::remove_all(at("job"));
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(Job::plan(at("job"), prepared(cloud, options), {}, &stopped), Interrupted);
    EXPECT_FALSE(fs::exists(at("job")));
}

TEST_F(FarmTest, AStopLeavesNothing)
{
    const fs::path folder = plan(randomScan("torus(1, 0.4)", 20000), voxelSize(0.015));
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(Job(folder, kBuild).run(0, &stopped), Interrupted);
    EXPECT_TRUE(fs::is_empty(folder / "fit"));
    EXPECT_EQ(Job(folder, kBuild).states().front().state, TaskState::State::Waiting);
}

} // namespace
} // namespace mpuvdb::test
