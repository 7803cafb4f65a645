// What the tests of jobs share: a job of small tiles, and the same at once.
#pragma once
#include "field_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/farm.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <functional>
#include <sstream>
#include <unistd.h>

namespace mpuvdb::test
{

namespace fs = std::filesystem;

constexpr const char* kBuild = "a build";

inline std::string bytesOf(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
}

/// A colored torus with holes in its data.
inline PointCloud coloredTorus(ScanSettings scan)
{
    scan.holes = 4;
    scan.holeRadius = 0.15;
    PointCloud cloud = scanOf("torus(1, 0.4)", scan);
    for (const Vec3f& p : cloud.positions)
        cloud.colors.push_back({std::uint8_t(100 + 50 * p[0]), std::uint8_t(100 + 50 * p[1]), 7});
    return cloud;
}

class JobFixture : public ::testing::Test
{
protected:
    void SetUp() override
    {
        const ::testing::TestInfo& test = *::testing::UnitTest::GetInstance()->current_test_info();
        mFolder = fs::temp_directory_path() / fmt::format("farm_{}_{}", test.name(), ::getpid());
        fs::create_directories(mFolder);
    }
    void TearDown() override { fs::remove_all(mFolder); }

    fs::path at(const std::string& name) const { return mFolder / name; }

    static ReconstructOptions voxelSize(double h)
    {
        Uncleaned options;
        options.voxelSize = Length{h, Length::Unit::World};
        return options;
    }

    static PreparedPoints prepared(const PointCloud& cloud, const ReconstructOptions& options)
    {
        PointInput input;
        input.cloud = cloud;
        return preparePoints(std::move(input), options);
    }

    /// Plan a job of small tiles and parts.
    fs::path plan(const PointCloud& cloud, const ReconstructOptions& options,
                  std::size_t partPoints = 2000, int tileVoxels = 128) const
    {
        JobOptions job;
        job.tileVoxels = tileVoxels;
        job.partPoints = partPoints;
        job.build = kBuild;
        Job::plan(at("job"), prepared(cloud, options), job);
        return at("job");
    }

    /// Do all tasks of the phase, the last first.
    static void runAll(const fs::path& folder)
    {
        const Job job(folder, kBuild);
        for (std::size_t n = job.tasks(); n-- > 0;) job.run(n);
    }

    /// The bytes of the level set made at once.
    std::string whole(const PointCloud& cloud, const ReconstructOptions& options) const
    {
        const ReconstructResult made = sampleFit(fitPoints(prepared(cloud, options)));
        openvdb::GridCPtrVec beside(made.attributes.begin(), made.attributes.end());
        if (made.coverage) beside.insert(beside.begin(), made.coverage);
        writeLevelSet(at("whole.vdb"), made.levelSet(),
                      {{"mpuvdb:max_error", fmt::format("{}", made.report.fit.maxError)}}, beside);
        return bytesOf(at("whole.vdb"));
    }

    /// The folder of a job all of whose tasks are done.
    fs::path done(const PointCloud& cloud, const ReconstructOptions& options,
                  int tileVoxels = 128) const
    {
        fs::path folder = plan(cloud, options, 2000, tileVoxels);
        runAll(folder);
        Job(folder, kBuild).gather();
        runAll(folder);
        return folder;
    }

    fs::path mFolder;
};

inline ScanSettings scanSettings(double points)
{
    ScanSettings scan;
    scan.points = std::uint64_t(points);
    scan.pattern = ScanSettings::Pattern::Random;
    return scan;
}

} // namespace mpuvdb::test
