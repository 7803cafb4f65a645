// Points to level set: the same bytes always, far from the origin, stopped, refused.
#include "field_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/error.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using test::Random;

test::Uncleaned voxelsOf(double voxelSize)
{
    test::Uncleaned settings;
    settings.voxelSize = Length{voxelSize, Length::Unit::World};
    return settings;
}

ReconstructResult reconstructedAt(PointCloud cloud, double voxelSize)
{
    Interrupter progress;
    return reconstruct(std::move(cloud), voxelsOf(voxelSize), &progress);
}

// --- Where data end

/// Unit normal of the zero set of @a field where the line through @a p along @a direction meets it
/// within @a reach; and the place.
struct ZeroSet {
    Vec3d place = Vec3d::Zero(), normal = Vec3d::Zero();
    bool supported = false;
};

ZeroSet zeroSetNear(const MpuField& field, const Vec3d& p, const Vec3d& direction, double reach)
{
    double low = -reach, high = reach;
    for (int i = 0; i < 40; ++i) {
        const double middle = 0.5 * (low + high);
        (field.evaluate(p + middle * direction).value < 0 ? low : high) = middle;
    }
    ZeroSet found{p + low * direction, Vec3d::Zero(), false};
    found.supported = field.evaluate(found.place).supported;
    for (int k = 0; k < 3; ++k) {
        const Vec3d step = 1e-3 * reach * Vec3d::Unit(k);
        found.normal[k] =
            field.evaluate(found.place + step).value - field.evaluate(found.place - step).value;
    }
    found.normal.normalize();
    return found;
}

double median(std::vector<double> values)
{
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

TEST(Reconstruct, InventsWithoutACrease)
{
    struct Case {
        const char* solid;
        Vec3d hole;
    };
    for (const Case& c : {Case{"sphere(1)", {1, 0, 0}}, Case{"torus(1, 0.4)", {1.4, 0, 0}},
                          Case{"blob(1, 5, 0.05)", {1, 0, 0}}}) {
        const PointCloud whole = test::randomScan(c.solid, 40000);
        const double radius = 0.4;
        PointCloud cloud;
        cloud.frame = whole.frame;
        std::vector<std::size_t> rim;
        for (std::size_t i = 0; i < whole.size(); ++i) {
            const double distance = (whole.world(i) - c.hole).norm();
            if (std::abs(distance - radius) < 0.01) rim.push_back(i);
            if (distance < radius) continue;
            cloud.positions.push_back(whole.positions[i]);
            cloud.normals.push_back(whole.normals[i]);
        }
        const double h = 0.02;
        const ReconstructResult result = reconstructedAt(cloud, h);
        // Turns within a voxel, from well within the data to well within the hole, the surface's
        // own among them: where support ends, and the largest per place on the rim.
        std::vector<double> atSeam, largest;
        const auto solid = parseSolid(c.solid);
        for (const std::size_t i : rim) {
            const Vec3d p = whole.world(i), n = whole.normals[i].cast<double>();
            Vec3d across = p - c.hole;
            across = (across - across.dot(n) * n).normalized();
            ZeroSet last;
            double most = 0;
            for (int k = -6; k <= 12; ++k) {
                const Vec3d at = p - k * h * across;
                const Vec3d foot = at - solid->distance(at) * n;
                const ZeroSet next = zeroSetNear(*result.field, foot, n, 5 * h);
                if (k > -6) {
                    const double turn =
                        std::acos(std::min(1.0, next.normal.dot(last.normal))) * 180 / M_PI;
                    most = std::max(most, turn);
                    if (last.supported != next.supported) atSeam.push_back(turn);
                }
                last = next;
            }
            largest.push_back(most);
        }
        ASSERT_GT(atSeam.size(), 50u) << c.solid;
        EXPECT_LT(median(atSeam), 5) << c.solid;
        EXPECT_LT(median(largest), 8) << c.solid;
    }
}

// --- Determinism

/// Sharp, noisy with confidences, and incomplete, so that the coarse sign takes part.
std::vector<PointCloud> differentClouds()
{
    ScanSettings holed;
    holed.points = 8000;
    holed.pattern = ScanSettings::Pattern::Random;
    holed.holes = 2;
    holed.holeRadius = 0.12;
    ScanSettings noisy = holed;
    noisy.noise = 0.005;
    noisy.normalNoise = 5;
    noisy.confidence = true;
    noisy.holes = 0;
    PointCloud repeated = test::scanOf("torus(1, 0.4)", holed);
    Random random(1);
    for (int i = 0; i < 4000; ++i) {
        const std::size_t n = random.below(repeated.size());
        repeated.positions.push_back(repeated.positions[n]);
        // Of equal points some agree in everything, some in their position only.
        repeated.normals.push_back(i % 2 ? repeated.normals[n] : random.direction().cast<float>());
    }
    return {test::randomScan("rotate(box(2, 1.5, 1), 1, 2, 3, 25)", 8000),
            test::scanOf("sphere(1)", noisy), test::scanOf("blob(1, 5, 0.1)", holed), repeated};
}

TEST(Reconstruct, GivesTheSameBytesForAnyThreadsAndAnyOrder)
{
    const std::vector<PointCloud> clouds = differentClouds();
    for (std::size_t n = 0; n < clouds.size(); ++n) {
        SCOPED_TRACE(n);
        const double h = 2.0 / 48;
        const ReconstructResult first = reconstructedAt(clouds[n], h);
        const std::string bytes = test::treeBytes(first.levelSet().grid());
        for (const std::size_t threads : {1u, 2u, 8u}) {
            tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            const ReconstructResult other =
                reconstructedAt(test::shuffled(clouds[n], 10 + threads), h);
            EXPECT_TRUE(bytes == test::treeBytes(other.levelSet().grid())) << threads;
            EXPECT_EQ(first.field->statistics().cells, other.field->statistics().cells);
            EXPECT_EQ(first.field->statistics().maxError, other.field->statistics().maxError);
        }
    }
}

// --- Far from the origin

TEST(Reconstruct, GivesTheSameGridFarFromTheOrigin)
{
    const double h = 1.0 / 32, far = 5e6; // a multiple of the voxel size
    const Vec3d shift(far, -far, far);
    const PointCloud cloud = test::randomScan("torus(1, 0.4)", 16000);
    PointCloud moved = cloud;
    moved.frame += shift;
    const ReconstructResult near = reconstructedAt(cloud, h), there = reconstructedAt(moved, h);

    const Lattice lattice = there.levelSet().lattice();
    const Vec3d offset = (shift - lattice.origin + near.levelSet().lattice().origin) / h;
    const Vec3i steps = offset.array().round().cast<int>();
    ASSERT_EQ(steps.cast<double>(), offset); // whole voxels
    ASSERT_LT(offset.cwiseAbs().maxCoeff(), 1 << 20);
    const Coord by(steps[0], steps[1], steps[2]);
    const auto at = there.levelSet().grid().getConstAccessor();
    EXPECT_EQ(near.levelSet().grid().activeVoxelCount(),
              there.levelSet().grid().activeVoxelCount());
    // A double near 5e6 is a multiple of 2^-30, and takes part in a few sums.
    const double tolerance = 3e-4 * h;
    for (auto v = near.levelSet().grid().cbeginValueOn(); v; ++v)
        ASSERT_NEAR(double(at.getValue(v.getCoord() + by)), double(*v), tolerance) << v.getCoord();

    const openvdb::Vec3d world = there.levelSet().grid().indexToWorld(by.asVec3d());
    EXPECT_EQ(Vec3d(world[0], world[1], world[2]), shift);
    Interrupter progress;
    const CheckReport report =
        check(there.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << test::texts(report);
    const FieldSample sample = there.field->evaluate(shift + Vec3d(1, 0, 0.2));
    EXPECT_NEAR(sample.value, near.field->evaluate(Vec3d(1, 0, 0.2)).value, tolerance);
}

TEST(Reconstruct, GivesTheRightSurfaceOfPointsScannedFarFromTheOrigin)
{
    const std::string description = "translate(sphere(1), 5000000, 5000000, -5000000)";
    const auto solid = parseSolid(description);
    const double h = 1.0 / 32;
    const ReconstructResult r = reconstructedAt(test::randomScan(description, 13000), h);
    double worst = 0;
    for (auto v = r.levelSet().grid().cbeginValueOn(); v; ++v) {
        const double d = solid->distance(test::worldOf(r.levelSet().lattice(), v.getCoord()));
        if (std::abs(d) < 2 * h) worst = std::max(worst, std::abs(double(*v) - d));
    }
    EXPECT_LT(worst, 0.05 * h);
}

// --- Settings

TEST(Reconstruct, ChoosesWhatTheUserLeftOpen)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 10000);
    Interrupter progress;
    const ResolvedSettings open =
        preparePoints(PointCloud(cloud), test::Uncleaned(), &progress).report.settings;
    // Random points are as far from each other as the area gives each of them.
    EXPECT_NEAR(open.fit.voxelSize, std::sqrt(4 * M_PI / 10000), 0.1 * open.fit.voxelSize);
    EXPECT_EQ(open.grid.lattice.voxelSize, open.fit.voxelSize);
    EXPECT_GE(open.fit.tolerance, 0.1 * open.fit.voxelSize);
    EXPECT_NEAR(open.diagonal, 2 * std::sqrt(3.0), 0.02);

    test::Uncleaned given;
    given.voxels = 64;
    given.tolerance = Length::parse("0.25vx");
    const ResolvedSettings resolved =
        preparePoints(PointCloud(cloud), given, &progress).report.settings;
    EXPECT_NEAR(resolved.fit.voxelSize, 2.0 / 64, 1e-3 / 64);
    EXPECT_DOUBLE_EQ(resolved.fit.tolerance, 0.25 * resolved.fit.voxelSize);
    given.voxels.reset();
    given.voxelSize = Length::parse("1%");
    EXPECT_NEAR(preparePoints(PointCloud(cloud), given, &progress).report.settings.fit.voxelSize,
                0.02 * std::sqrt(3.0), 1e-3);
}

TEST(Reconstruct, RefusesWhatMakesNoSense)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 1000);
    Interrupter progress;
    const auto run = [&](const PointCloud& points, auto change) {
        test::Uncleaned settings = voxelsOf(0.1);
        change(settings);
        reconstruct(PointCloud(points), settings, &progress);
    };
    const auto nothing = [](test::Uncleaned&) {};
    EXPECT_NO_THROW(run(cloud, nothing));
    PointCloud tiny = cloud; // OpenVDB takes such a transform for singular
    for (Vec3f& p : tiny.positions) p *= 1e-5f;
    EXPECT_THROW(run(tiny,
                     [](auto& s) {
                         s.voxelSize = Length{1e-6, Length::Unit::World};
                     }),
                 LimitError);
    EXPECT_THROW(run({}, nothing), InputError);
    PointCloud bare = cloud;
    bare.normals.clear();
    EXPECT_THROW(run(bare, nothing), InputError);
    using S = test::Uncleaned;
    EXPECT_THROW(run(cloud, [](S& s) { s.voxels = 10; }), UsageError); // and the size
    EXPECT_THROW(run(cloud, [](S& s) { s.voxelSize = Length::parse("2vx"); }), UsageError);
    for (const double bad : {0.0, -1.0, std::nan("")}) {
        EXPECT_THROW(run(cloud,
                         [&](S& s) {
                             s.voxelSize = Length{bad, Length::Unit::World};
                         }),
                     UsageError);
        EXPECT_THROW(run(cloud,
                         [&](S& s) {
                             s.tolerance = Length{bad, Length::Unit::World};
                         }),
                     UsageError);
        EXPECT_THROW(run(cloud, [&](S& s) { s.halfWidth = bad; }), UsageError);
        EXPECT_THROW(run(cloud, [&](S& s) { s.alpha = bad; }), UsageError);
        EXPECT_THROW(run(cloud,
                         [&](S& s) {
                             s.voxelSize.reset();
                             s.voxels = bad;
                         }),
                     UsageError);
    }
    EXPECT_THROW(run(cloud, [](S& s) { s.tolerance = Length::parse("51%"); }), UsageError);
    EXPECT_THROW(run(cloud, [](S& s) { s.minPoints = 1; }), UsageError);
    EXPECT_THROW(run(cloud,
                     [](S& s) {
                         s.voxelSize = Length{1e-9, Length::Unit::World};
                     }),
                 LimitError);
}

TEST(Reconstruct, StaysWithinItsMemory)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 10000);
    Interrupter progress;
    test::Uncleaned settings = voxelsOf(2.0 / 128);
    settings.maxBytes = 2000000;
    EXPECT_THROW(reconstruct(PointCloud(cloud), settings, &progress), LimitError);
    settings.maxBytes = 2000000000;
    EXPECT_NO_THROW(reconstruct(PointCloud(cloud), settings, &progress));
}

// --- Stopping

using Clock = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;

/// How long a stop @a moment after the start takes; negative if the work ended before.
Milliseconds stopLatency(const PointCloud& cloud, double voxelSize, Milliseconds moment)
{
    Interrupter progress;
    PointCloud copy = cloud;
    std::atomic<Clock::rep> stoppedAt{0};
    std::thread stopper([&] {
        std::this_thread::sleep_for(moment);
        stoppedAt = Clock::now().time_since_epoch().count();
        progress.stop();
    });
    bool interrupted = false;
    try {
        reconstruct(std::move(copy), voxelsOf(voxelSize), &progress);
    } catch (const Interrupted&) {
        interrupted = true;
    }
    const Clock::time_point ended = Clock::now();
    stopper.join();
    return interrupted ? ended - Clock::time_point(Clock::duration(stoppedAt.load()))
                       : Milliseconds(-1);
}

TEST(Reconstruct, StopsWithinAQuarterOfASecond)
{
    ScanSettings scan;
    scan.points = 150000;
    scan.pattern = ScanSettings::Pattern::Random;
    scan.holes = 1; // the coarse sign takes part
    const PointCloud cloud = test::scanOf("blob(1, 8, 0.1)", scan);
    const double h = 2.2 / 200;
    const Clock::time_point start = Clock::now();
    reconstructedAt(cloud, h);
    const Milliseconds whole = Clock::now() - start;
    for (const double part : {0.05, 0.3, 0.5, 0.7, 0.9}) {
        Milliseconds best(1e9);
        int stopped = 0;
        for (int attempt = 0; attempt < 3 && best > Milliseconds(250); ++attempt) {
            const Milliseconds latency = stopLatency(cloud, h, part * whole);
            if (latency < Milliseconds(0)) continue;
            ++stopped;
            best = std::min(best, latency);
        }
        EXPECT_TRUE(stopped == 0 || best <= Milliseconds(250))
            << "at " << part << " of " << whole.count() << " ms: " << best.count();
        EXPECT_TRUE(stopped > 0 || part > 0.5) << part;
    }
}

TEST(Reconstruct, StoppedBeforeItStartsDoesNothing)
{
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(reconstruct(test::randomScan("sphere(1)", 1000), voxelsOf(0.1), &progress),
                 Interrupted);
}

TEST(Reconstruct, ReportsStagesWithFractionsThatDoNotFall)
{
    std::vector<std::pair<std::string, double>> heard;
    Interrupter progress(
        [&](const std::string& stage, double fraction) { heard.emplace_back(stage, fraction); });
    reconstruct(test::randomScan("sphere(1)", 5000), voxelsOf(0.05), &progress);
    for (std::size_t n = 0; n < heard.size(); ++n) {
        EXPECT_GE(heard[n].second, 0);
        EXPECT_LE(heard[n].second, 1);
        if (n == 0 || heard[n].first != heard[n - 1].first) continue;
        EXPECT_GE(heard[n].second, heard[n - 1].second);
    }
    std::vector<std::string> names;
    for (const StageTime& stage : progress.stages()) names.push_back(stage.name);
    for (const char* expected : {"measure", "sort", "fit", "sample"})
        EXPECT_NE(std::find(names.begin(), names.end(), expected), names.end()) << expected;
}

// --- Too little to go by

/// A level set that can be checked and meshed, or an InputError.
void expectDefined(const PointCloud& cloud, double voxelSize)
{
    Interrupter progress;
    try {
        const ReconstructResult r = reconstructedAt(cloud, voxelSize);
        const MeshReport mesh = measure(extractMesh(r.levelSet(), {}, &progress));
        EXPECT_EQ(mesh.boundaryEdges, 0u);
        EXPECT_EQ(mesh.nonManifoldEdges, 0u);
        for (auto v = r.levelSet().grid().cbeginValueOn(); v; ++v)
            ASSERT_TRUE(std::isfinite(*v)) << v.getCoord();
    } catch (const InputError& error) {
        EXPECT_GT(std::string(error.what()).size(), 20u);
    }
}

TEST(Reconstruct, IsDefinedForFewPoints)
{
    for (const std::size_t count : {1u, 2u, 3u, 10u, 100u}) {
        for (const char* solid : {"sphere(1)", "box(1, 1, 1)"}) {
            SCOPED_TRACE(testing::Message() << count << " points of " << solid);
            PointCloud cloud = test::randomScan(solid, 100);
            ASSERT_GE(cloud.size(), count);
            cloud.positions.resize(count);
            cloud.normals.resize(count);
            expectDefined(cloud, 0.1);
        }
    }
}

PointCloud cloudOf(const std::vector<Vec3d>& positions, const Vec3d& normal)
{
    PointCloud cloud;
    for (const Vec3d& p : positions) {
        cloud.positions.push_back(p.cast<float>());
        cloud.normals.push_back(normal.cast<float>());
    }
    return cloud;
}

// Voxels may lie in the plane of all points, and be all of one sign.
TEST(Reconstruct, ClosesAFlatSheetBehind)
{
    Random random(2);
    for (const bool round : {false, true}) {
        std::vector<Vec3d> points;
        while (points.size() < 8000) {
            const Vec3d p(random.uniform(-1, 1), random.uniform(-1, 1), 0);
            if (!round || p.norm() < 1) points.push_back(p);
        }
        for (const double voxelSize : {0.01, 0.02, 0.03, 0.05, 0.08}) {
            SCOPED_TRACE(fmt::format("{} {}", round ? "disc" : "square", voxelSize));
            const ReconstructResult made =
                reconstructedAt(cloudOf(points, Vec3d::UnitZ()), voxelSize);
            Interrupter progress;
            const MeshReport mesh = measure(extractMesh(made.levelSet(), {}, &progress));
            EXPECT_EQ(mesh.components, 1u);
            EXPECT_EQ(mesh.boundaryEdges, 0u);
            EXPECT_EQ(mesh.eulerCharacteristic, 2);
            EXPECT_GT(mesh.area, 2 * (round ? M_PI : 4)); // the sheet, and what closes it
            EXPECT_GT(mesh.volume, 0);
        }
    }
}

// Flat faces between two layers of voxels: all points may be in voxels on one side of them.
TEST(Reconstruct, KeepsBoxesAlongTheAxes)
{
    const auto measured = [](const std::string& solid, double points) {
        Interrupter progress;
        const ReconstructResult made =
            reconstruct(test::randomScan(solid, points), test::Uncleaned(), &progress);
        return measure(extractMesh(made.levelSet(), {}, &progress));
    };
    for (const double points : {300, 500, 1000, 3000}) {
        const MeshReport box = measured("box(1,1,1)", points);
        EXPECT_EQ(box.components, 1u) << points;
        EXPECT_NEAR(box.volume, 1, 0.1) << points;
    }
    const MeshReport slab = measured("slab(2,2,0.04)", 80000);
    EXPECT_EQ(slab.components, 1u);
    EXPECT_NEAR(slab.volume, 0.16, 0.016);
    const MeshReport hollow = measured("difference(box(1,1,1),box(0.4,0.4,0.4))", 20000);
    EXPECT_EQ(hollow.components, 2u);
    EXPECT_NEAR(hollow.volume, 1 - 0.064, 0.02);
}

// The blocks between them are none that anything is kept for.
TEST(Reconstruct, TakesObjectsFarApart)
{
    PointCloud cloud = test::randomScan("sphere(1)", 2000);
    const std::size_t count = cloud.size();
    for (std::size_t i = 0; i < count; ++i) {
        cloud.positions.push_back(cloud.positions[i] + Vec3f(3000, 3000, 0));
        cloud.normals.push_back(cloud.normals[i]);
    }
    test::Uncleaned settings = voxelsOf(0.1);
    settings.maxBytes = 200 << 20;
    Interrupter progress;
    const ReconstructResult made = reconstruct(std::move(cloud), settings, &progress);
    const MeshReport mesh = measure(extractMesh(made.levelSet(), {}, &progress));
    EXPECT_EQ(mesh.components, 2u);
    EXPECT_NEAR(mesh.volume, 2 * 4 * M_PI / 3, 0.2);
}

TEST(Reconstruct, IsDefinedForDegenerateClouds)
{
    Random random(1);
    std::vector<Vec3d> flat, line, same(50, Vec3d(1, 2, 3)), dust;
    for (int i = 0; i < 500; ++i) {
        flat.emplace_back(random.uniform(), random.uniform(), 0);
        line.emplace_back(random.uniform(), 0, 0);
        dust.push_back(random.inCube(1));
    }
    const Vec3d up(0, 0, 1);
    {
        SCOPED_TRACE("coplanar");
        expectDefined(cloudOf(flat, up), 0.05);
        expectDefined(cloudOf(flat, Vec3d(1, 0, 0)), 0.05); // normals along the plane
    }
    {
        SCOPED_TRACE("collinear");
        expectDefined(cloudOf(line, up), 0.05);
    }
    {
        SCOPED_TRACE("all equal");
        expectDefined(cloudOf(same, up), 0.05);
    }
    {
        SCOPED_TRACE("dust, any normals");
        PointCloud cloud = cloudOf(dust, up);
        for (Vec3f& n : cloud.normals) n = random.direction().cast<float>();
        expectDefined(cloud, 0.1);
    }
    {
        SCOPED_TRACE("opposed normals everywhere");
        PointCloud cloud = cloudOf(flat, up);
        for (std::size_t i = 0; i < cloud.size(); i += 2) cloud.normals[i] = -cloud.normals[i];
        expectDefined(cloud, 0.05);
    }
    {
        SCOPED_TRACE("two clusters far from each other");
        PointCloud cloud = test::randomScan("sphere(0.01)", 300);
        const std::size_t count = cloud.size();
        for (std::size_t i = 0; i < count; ++i) {
            cloud.positions.push_back(cloud.positions[i] + Vec3f(100, 0, 0));
            cloud.normals.push_back(cloud.normals[i]);
        }
        expectDefined(cloud, 0.002);
    }
    {
        SCOPED_TRACE("inside out");
        PointCloud cloud = test::randomScan("sphere(1)", 3000);
        for (Vec3f& n : cloud.normals) n = -n;
        expectDefined(cloud, 0.1);
    }
}

} // namespace
} // namespace mpuvdb
