// What the tests of operations on level sets share: exact solids, comparisons, a stop half way.
#pragma once
#include "field_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <chrono>
#include <functional>
#include <thread>

namespace mpuvdb::test
{

inline LevelSet solidLevelSet(const std::string& description, double voxelSize,
                              double halfWidth = 3)
{
    SampleSettings settings;
    settings.lattice = {Vec3d::Zero(), voxelSize};
    settings.halfWidth = halfWidth;
    settings.name = description;
    Interrupter progress;
    return sampleField(*makeSolidField(parseSolid(description)), settings, &progress);
}

inline LevelSet emptyLevelSet(double voxelSize, double halfWidth = 3)
{
    const auto grid = openvdb::FloatGrid::create(float(halfWidth * voxelSize));
    grid->setTransform(openvdb::math::Transform::createLinearTransform(voxelSize));
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    return LevelSet(grid);
}

/// Sound, and as near to a distance as smooth shapes are.
inline void expectSmoothDistance(const LevelSet& levelSet)
{
    Interrupter progress;
    const CheckReport report =
        check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << texts(report);
    EXPECT_LE(report.meanGradientError, 0.03);
}

inline SolidMeasures measured(const LevelSet& levelSet)
{
    Interrupter progress;
    return measure(levelSet, &progress);
}

/// Whether @a make gives the same bytes on one thread as on two.
inline void expectSameOnAnyThreads(const std::function<openvdb::FloatGrid::ConstPtr()>& make)
{
    const auto bytes = [&](std::size_t threads) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        return treeBytes(*make());
    };
    EXPECT_TRUE(bytes(1) == bytes(2));
}

/// Stops @a work, which would take long, after a moment; expects it to end soon.
inline void expectStops(const std::function<void(Interrupter&)>& work)
{
    using Clock = std::chrono::steady_clock;
    Interrupter progress;
    Clock::time_point stopped;
    std::thread stopper([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        stopped = Clock::now();
        progress.stop();
    });
    EXPECT_THROW(work(progress), Interrupted);
    const auto ended = Clock::now();
    stopper.join();
    // A quarter of a second is promised; busy machines and sanitizers take longer.
    EXPECT_LT(std::chrono::duration<double>(ended - stopped).count(), 2);
}

} // namespace mpuvdb::test
