// Re-distancing, widening, offsets and shells beside exact distances.
#include "field_fixture.h"
#include "scanned_cloud.h"
#include "uncleaned.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <thread>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using Distance = std::function<double(const Vec3d&)>;

constexpr double kVoxel = 0.04;
const Vec3d kOrigin(0.013, 0.027, -0.011);

LevelSet sampled(const std::string& solid, double voxelSize = kVoxel, double halfWidth = 3)
{
    SampleSettings settings;
    settings.lattice = {kOrigin, voxelSize};
    settings.halfWidth = halfWidth;
    Interrupter progress;
    return sampleField(*makeSolidField(parseSolid(solid)), settings, &progress);
}

struct Errors {
    double mean = 0, largest = 0; ///< voxels
    Coord worst;
};

/// Errors of the active values against @a distance.
Errors errorsOf(const LevelSet& levelSet, const Distance& distance)
{
    Errors errors;
    const Lattice lattice = levelSet.lattice();
    std::uint64_t count = 0;
    for (auto it = levelSet.grid().cbeginValueOn(); it; ++it, ++count) {
        const double d = distance(test::worldOf(lattice, it.getCoord()));
        const double error = std::abs(double(*it) - d) / lattice.voxelSize;
        errors.mean += error;
        if (error > errors.largest) {
            errors.largest = error;
            errors.worst = it.getCoord();
        }
    }
    EXPECT_GT(count, 0u);
    if (count) errors.mean /= double(count);
    return errors;
}

void expectErrors(const LevelSet& levelSet, const Distance& distance, double mean, double largest)
{
    const Errors errors = errorsOf(levelSet, distance);
    EXPECT_LE(errors.mean, mean);
    EXPECT_LE(errors.largest, largest) << "at " << errors.worst;
}

void expectSoundGrid(const LevelSet& levelSet, double gradientTolerance = 0.03)
{
    Interrupter progress;
    const CheckReport report =
        check(levelSet.grid(), gradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << test::texts(report);
    EXPECT_EQ(levelSet.grid().getName(), "surface");
}

/// Every voxel in a box, active or not, has the sign of @a distance.
void expectSigns(const LevelSet& levelSet, const Distance& distance, int reach)
{
    const auto at = levelSet.grid().getConstAccessor();
    const Lattice lattice = levelSet.lattice();
    std::uint64_t wrong = 0;
    for (int x = -reach; x <= reach; x += 3)
        for (int y = -reach; y <= reach; y += 3)
            for (int z = -reach; z <= reach; z += 3) {
                const double d = distance(test::worldOf(lattice, {x, y, z}));
                if (std::abs(d) < 0.2 * lattice.voxelSize) continue;
                wrong += (at.getValue({x, y, z}) < 0) != (d < 0);
            }
    EXPECT_EQ(wrong, 0u);
}

/// The same zero set, but values up to three times the distance.
FloatGrid::Ptr distorted(const LevelSet& levelSet)
{
    FloatGrid::Ptr grid = levelSet.grid().deepCopy();
    for (auto it = grid->beginValueOn(); it; ++it) {
        const Vec3d p = test::worldOf(levelSet.lattice(), it.getCoord());
        it.setValue(float(*it * (1.8 + 0.9 * std::sin(3 * p[0] + 2 * p[1]))));
    }
    return grid;
}

struct Case {
    const char* solid;
    double mean, largest;    ///< of distances widened, voxels
    double largestDistorted; ///< of those made from other values; at tips they cost half a voxel
};

class Redistance : public testing::TestWithParam<Case>
{
};

TEST_P(Redistance, WidensToTheExactDistance)
{
    Interrupter progress;
    const auto solid = parseSolid(GetParam().solid);
    const LevelSet narrow = sampled(GetParam().solid);
    const LevelSet wide = withHalfWidth(narrow, 6, &progress);
    EXPECT_DOUBLE_EQ(wide.halfWidth(), sampled("sphere(1)", kVoxel, 6).halfWidth());
    expectSoundGrid(wide);
    const auto exact = [&](const Vec3d& p) { return solid->distance(p); };
    expectErrors(wide, exact, GetParam().mean, GetParam().largest);
    expectSigns(wide, exact, 40);
    const auto at = wide.grid().getConstAccessor();
    for (auto it = narrow.grid().cbeginValueOn(); it; ++it)
        ASSERT_NEAR(at.getValue(it.getCoord()), *it, 1e-6 * kVoxel) << it.getCoord();
}

TEST_P(Redistance, MakesDistancesOfOtherValues)
{
    Interrupter progress;
    const auto solid = parseSolid(GetParam().solid);
    const LevelSet made = redistance(*distorted(sampled(GetParam().solid)), 4, &progress);
    expectSoundGrid(made);
    expectErrors(
        made, [&](const Vec3d& p) { return solid->distance(p); }, 0.012 + GetParam().mean,
        GetParam().largestDistorted);
}

TEST_P(Redistance, OffsetsAreTheDistanceLessTheShift)
{
    Interrupter progress;
    const auto solid = parseSolid(GetParam().solid);
    const LevelSet grown = offset(sampled(GetParam().solid), 7 * kVoxel, &progress);
    expectSoundGrid(grown);
    const auto exact = [&](const Vec3d& p) { return solid->distance(p) - 7 * kVoxel; };
    expectErrors(grown, exact, GetParam().mean, GetParam().largest);
    expectSigns(grown, exact, 50);
}

INSTANTIATE_TEST_SUITE_P(
    Solids, Redistance,
    testing::Values(Case{"sphere(1)", 0.002, 0.08, 0.31}, Case{"torus(1,0.4)", 0.003, 0.1, 0.35},
                    Case{"roundedbox(1.6,1.2,1.4,0.25)", 0.005, 0.1, 0.35},
                    Case{"box(1.6,1.2,1.4)", 0.0005, 0.01, 0.2},
                    Case{"rotate(box(1.6,1.2,1.4),1,2,3,40)", 0.001, 0.1, 0.3},
                    Case{"rotate(box(1.6,1.2,1.4),3,-1,2,75)", 0.001, 0.1, 0.6},
                    Case{"rotate(cylinder(0.6,1.4),1,2,3,40)", 0.002, 0.1, 0.5},
                    Case{"capsule(0.3,0.8)", 0.004, 0.1, 0.35}));

/// A bored cylinder whose axis is @a turn's z.
double tubeDistance(const Vec3d& p, const Eigen::Matrix3d& turn, double inner, double outer,
                    double height)
{
    const Vec3d q = turn.transpose() * p;
    const double across = std::abs(std::hypot(q[0], q[1]) - 0.5 * (inner + outer)) -
                          0.5 * (outer - inner),
                 along = std::abs(q[2]) - 0.5 * height;
    return std::hypot(std::max(across, 0.0), std::max(along, 0.0)) +
           std::min(std::max(across, along), 0.0);
}

TEST(Redistancing, IsExactBesideTheCreasesOfBooleans)
{
    Interrupter progress;
    const LevelSet tube = combine(
        Boolean::Difference,
        {sampled("rotate(cylinder(0.9,1),1,2,3,40)"), sampled("rotate(cylinder(0.45,2),1,2,3,40)")},
        0, &progress);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(40 * M_PI / 180, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
    const auto exact = [&](const Vec3d& p) { return tubeDistance(p, turn, 0.45, 0.9, 1); };
    const LevelSet made = redistance(tube.grid(), 4, &progress);
    expectSoundGrid(made);
    expectErrors(made, exact, 0.003, 0.15);
    // Inward, where all creases stay creases.
    const LevelSet shrunk = offset(tube, -2.5 * kVoxel, &progress);
    expectSoundGrid(shrunk);
    const double by = 5 * kVoxel;
    expectErrors(
        shrunk,
        [&](const Vec3d& p) { return tubeDistance(p, turn, 0.45 + by / 2, 0.9 - by / 2, 1 - by); },
        0.004, 0.2);
}

// Fields of points, and of planes, are the larger of two distances beside an edge: a band of such
// values does not tell where the nearest place is.
TEST(Offset, GoesByTheZeroSetWhereValuesAreNoDistances)
{
    Interrupter progress;
    const auto box = parseSolid("box(1.6,1.2,1.4)");
    const LevelSet start = sampled("box(1.6,1.2,1.4)");
    const FloatGrid::Ptr grid = start.grid().deepCopy();
    for (auto it = grid->beginValueOn(); it; ++it) {
        const Vec3d p = test::worldOf(start.lattice(), it.getCoord()).cwiseAbs();
        it.setValue(float((p - Vec3d(0.8, 0.6, 0.7)).maxCoeff()));
    }
    const LevelSet grown = offset(LevelSet(grid), 7 * kVoxel, &progress);
    expectErrors(
        grown, [&](const Vec3d& p) { return box->distance(p) - 7 * kVoxel; }, 0.0005, 0.01);
}

/// What noisy points on @a solid, some of them wrong, are reconstructed as.
LevelSet reconstructed(const std::string& solid, double noise, double outliers)
{
    Interrupter progress;
    PointCloud cloud = scanned(solid, 20000, Pattern::Random, noise, outliers);
    clean(cloud, {}, &progress);
    return reconstruct(std::move(cloud), test::Uncleaned(), &progress).levelSet();
}

/// The same surface with distances to the triangles of its mesh.
LevelSet measuredAnew(const LevelSet& levelSet)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice = levelSet.lattice();
    settings.halfWidth = levelSet.halfWidth();
    return voxelize(extractMesh(levelSet, {}, &progress), settings, &progress);
}

struct Deviation {
    double mean = 0, rms = 0; ///< voxels
};

/// How far the values within a voxel of the zero set are from those of @a truth.
Deviation deviation(const LevelSet& levelSet, const LevelSet& truth)
{
    const auto at = truth.grid().getConstAccessor();
    const double h = levelSet.voxelSize();
    Deviation d;
    double count = 0;
    for (auto it = levelSet.grid().cbeginValueOn(); it; ++it) {
        if (std::abs(*it) > h) continue;
        const double off = double(*it - at.getValue(it.getCoord())) / h;
        d.mean += off;
        d.rms += off * off;
        ++count;
    }
    return {d.mean / count, std::sqrt(d.rms / count)};
}

// At the rim of the band, values that few points speak for are up to voxels from the distance.
TEST(Offset, OfNoisyPointsIsOneSmoothBody)
{
    struct Input {
        const char* solid;
        double noise, outliers;
    };
    constexpr const char* kCross =
        "rotate(union(union(box(2,0.4,0.4),box(0.4,2,0.4)),box(0.4,0.4,2)),1,2,3,30)";
    Interrupter progress;
    for (const Input& input : {Input{kCross, 0.008, 0.01}, Input{"gear(12,1,0.5)", 0.01, 0}}) {
        const LevelSet body = reconstructed(input.solid, input.noise, input.outliers);
        const LevelSet exact = measuredAnew(body);
        ASSERT_EQ(components(body, &progress).size(), 1u) << input.solid;
        for (const double voxels : {2.0, 2.5, 2.8, 3.0, 3.5, 4.0}) {
            SCOPED_TRACE(fmt::format("{}, offset by {} voxels", input.solid, voxels));
            const double shift = voxels * body.voxelSize();
            const LevelSet grown = offset(body, shift, &progress);
            EXPECT_EQ(components(grown, &progress).size(), 1u);
            const Deviation d = deviation(grown, offset(exact, shift, &progress));
            EXPECT_LE(std::abs(d.mean), 0.03);
            EXPECT_LE(d.rms, 0.1);
        }
    }
}

TEST(Offset, InwardReachesIntoTheFullInside)
{
    Interrupter progress;
    const LevelSet ball = sampled("sphere(1.5)");
    const LevelSet shrunk = offset(ball, -20 * kVoxel, &progress);
    expectSoundGrid(shrunk);
    const auto exact = [](const Vec3d& p) { return p.norm() - 1.5 + 20 * kVoxel; };
    expectErrors(shrunk, exact, 0.01, 0.06);
    expectSigns(shrunk, exact, 45);
}

TEST(Offset, ThereAndBackIsTheSame)
{
    Interrupter progress;
    for (const char* solid : {"sphere(1)", "torus(1,0.4)", "roundedbox(1.6,1.2,1.4,0.3)"}) {
        SCOPED_TRACE(solid);
        const auto exact = parseSolid(solid);
        const LevelSet start = sampled(solid);
        const LevelSet back = offset(offset(start, 4 * kVoxel, &progress), -4 * kVoxel, &progress);
        expectErrors(
            back, [&](const Vec3d& p) { return exact->distance(p); }, 0.004, 0.12);
    }
}

/// What two balls about (0, 0, -+c) have in common: its rim is an edge of any angle.
struct Lens {
    double radius, c;

    double operator()(const Vec3d& p) const
    {
        const double across = std::hypot(p.x(), p.y()), z = std::abs(p.z());
        const double ball = std::hypot(across, z + c) - radius;
        // The place on the ball that is nearest to p is cut off beyond the rim.
        const bool isCut = radius * (z + c) < c * std::hypot(across, z + c);
        const double rim = std::sqrt(radius * radius - c * c);
        return isCut && ball > 0 ? std::hypot(across - rim, z) : ball;
    }
};

TEST(Offset, KeepsTheTipsOfAcuteEdges)
{
    for (const double degrees : {100.0, 70.0, 50.0, 35.0, 25.0}) {
        SCOPED_TRACE(degrees);
        const double half = 0.5 * degrees * M_PI / 180;
        const double radius = 0.7 / std::sin(half), c = radius * std::cos(half);
        const Lens lens{radius, c};
        Interrupter progress;
        const std::string ball = fmt::format("sphere({})", radius);
        const LevelSet both = combine(Boolean::Intersection,
                                      {sampled(fmt::format("translate({}, 0, 0, {})", ball, -c)),
                                       sampled(fmt::format("translate({}, 0, 0, {})", ball, c))},
                                      0, &progress);
        // The tip ends up to a voxel and more beyond where signs show it.
        expectErrors(both, lens, 0.002, 0.05);
        for (const double shift : {2.0, 4.0, 8.0}) {
            SCOPED_TRACE(shift);
            const LevelSet grown = offset(both, shift * kVoxel, &progress);
            expectErrors(
                grown, [&](const Vec3d& p) { return lens(p) - shift * kVoxel; }, 0.05, 0.5);
            expectSoundGrid(grown);
        }
    }
}

TEST(Offset, TellsItsProgress)
{
    const LevelSet ball = sampled("sphere(1)");
    for (const double voxels : {12.0, -12.0}) {
        std::vector<double> fractions;
        Interrupter progress(
            [&](const std::string&, double fraction) { fractions.push_back(fraction); });
        progress.beginStage("offset");
        offset(ball, voxels * kVoxel, &progress);
        EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
        EXPECT_GE(fractions.size(), 5u);
        EXPECT_GT(fractions.back(), 0.5);
    }
}

TEST(Offset, ToNothingIsEmpty)
{
    Interrupter progress;
    const LevelSet gone = offset(sampled("sphere(0.3)"), -0.5, &progress);
    EXPECT_EQ(gone.grid().activeVoxelCount(), 0u);
    EXPECT_GT(gone.grid().getConstAccessor().getValue({0, 0, 0}), 0);
    expectSoundGrid(gone);
}

TEST(Offset, BallsThatMeetHaveADistanceInTheirCrease)
{
    Interrupter progress;
    const double radius = 0.5, apart = 0.65, shift = 8 * kVoxel;
    const LevelSet grown =
        offset(sampled("union(translate(sphere(0.5),-0.65,0,0),translate(sphere(0.5),0.65,0,0))"),
               shift, &progress);
    expectSoundGrid(grown);
    const double r = radius + shift, crease = std::sqrt(r * r - apart * apart);
    const auto exact = [&](const Vec3d& p) {
        const Vec3d q(std::abs(p[0]), p[1], p[2]);
        const double d = (q - Vec3d(apart, 0, 0)).norm() - r;
        const double across = std::hypot(p[1], p[2]);
        // Inside, beyond the cone from the center to the crease, the crease is nearest.
        const bool wedge = (apart - q[0]) * crease > across * apart && d < 0;
        return wedge ? -std::hypot(q[0], across - crease) : d;
    };
    expectErrors(grown, exact, 0.005, 0.65);
}

TEST(Offset, RefusesWhatIsNoDistance)
{
    Interrupter progress;
    const LevelSet ball = sampled("sphere(0.3)");
    EXPECT_THROW(offset(ball, std::nan(""), &progress), UsageError);
    EXPECT_THROW(offset(ball, 1e9, &progress), LimitError);
    EXPECT_THROW(withHalfWidth(ball, 1, &progress), UsageError);
    EXPECT_THROW(redistance(ball.grid(), std::nan(""), &progress), UsageError);
    EXPECT_THROW(shell(ball, 0, Wall::Inward, &progress), UsageError);
    EXPECT_THROW(shell(ball, kVoxel, Wall::Inward, &progress), LimitError);
}

TEST(Shell, IsAWallBesideTheSurface)
{
    Interrupter progress;
    const LevelSet ball = sampled("sphere(1)");
    const double thickness = 8 * kVoxel;
    const std::pair<Wall, double> walls[] = {
        {Wall::Inward, 1 - thickness / 2}, {Wall::Centered, 1}, {Wall::Outward, 1 + thickness / 2}};
    for (const auto& [wall, middle] : walls) {
        const LevelSet made = shell(ball, thickness, wall, &progress);
        expectSoundGrid(made);
        const auto exact = [&, m = middle](const Vec3d& p) {
            return std::abs(p.norm() - m) - thickness / 2;
        };
        expectErrors(made, exact, 0.003, 0.1);
        expectSigns(made, exact, 40);
    }
}

TEST(Redistancing, AThinSlabKeepsBothSides)
{
    Interrupter progress;
    const auto solid = parseSolid("box(1.5,1.5,0.06)"); // one and a half voxels thick
    const LevelSet slab = sampled("box(1.5,1.5,0.06)");
    const auto exact = [&](const Vec3d& p) { return solid->distance(p); };
    expectErrors(redistance(slab.grid(), 3, &progress), exact, 0.025, 0.7);
    const LevelSet wide = withHalfWidth(slab, 5, &progress);
    expectErrors(wide, exact, 0.01, 0.4);
    expectSigns(wide, exact, 30);
}

/// Cells that both sides of a wall pass have a sheet of each.
TEST(Redistancing, TurnedWallsOfOneVoxelKeepBothSides)
{
    const unsigned seed = 20261128;
    std::printf("seed %u\n", seed);
    test::Random random(seed);
    for (int n = 0; n < 4; ++n) {
        const Vec3d axis = random.direction();
        const std::string name = fmt::format("rotate(box(1.5,1.5,{}),{},{},{},{})", kVoxel,
                                             axis.x(), axis.y(), axis.z(), random.uniform(10, 80));
        SCOPED_TRACE(name);
        const auto solid = parseSolid(name);
        Interrupter progress;
        const LevelSet made = redistance(sampled(name).grid(), 3, &progress);
        const Errors errors = errorsOf(made, [&](const Vec3d& p) { return solid->distance(p); });
        // Half a voxel within a voxel of the rim, which edges between voxels do not resolve.
        EXPECT_LE(errors.mean, 0.5 * 4 * kVoxel / 1.5);
    }
}

TEST(Redistancing, WideBandsOfReconstructedSolidsAreSound)
{
    // Outside their edges fits are the larger of the faces' distances: too small, by more the
    // farther from the edge.
    for (const std::string description : {"box(2, 1.5, 1)", "cylinder(1, 2)", "cone(1, 1)",
                                          "difference(box(2, 1.5, 1), cylinder(0.4, 3))"}) {
        ReconstructOptions options;
        options.voxelSize = Length{0.015, Length::Unit::World};
        Interrupter progress;
        const ReconstructResult made =
            reconstruct(test::randomScan(description, 40000), options, &progress);
        const LevelSet narrow = made.levelSet();
        for (const double halfWidth : {5, 10}) {
            SCOPED_TRACE(fmt::format("{}, {} voxels", description, halfWidth));
            const LevelSet wide = withHalfWidth(narrow, halfWidth, &progress);
            expectSoundGrid(wide);
            // Values that define the zero set stay: a third of the distance outside an edge of 45
            // degrees.
            const auto at = wide.grid().getConstAccessor();
            for (auto it = narrow.grid().cbeginValueOn(); it; ++it) {
                if (!(std::abs(*it) < narrow.voxelSize() / 3)) continue;
                ASSERT_EQ(at.getValue(it.getCoord()), *it) << it.getCoord();
            }
        }
    }
}

TEST(Redistancing, AnEmptyGridStaysEmpty)
{
    Interrupter progress;
    const FloatGrid::Ptr grid = FloatGrid::create(0.3f);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
    EXPECT_EQ(redistance(*grid, 3, &progress).grid().activeVoxelCount(), 0u);
    EXPECT_EQ(offset(LevelSet(grid), 1, &progress).grid().activeVoxelCount(), 0u);
    EXPECT_EQ(withHalfWidth(LevelSet(grid), 5, &progress).halfWidth(),
              double(float(5 * 0.1)) / 0.1);
}

TEST(Redistancing, ErrorFallsWithTheSquareOfTheVoxelSize)
{
    Interrupter progress;
    std::vector<double> means; // world units
    for (const double h : {0.08, 0.04, 0.02}) {
        const LevelSet made = redistance(*distorted(sampled("torus(1,0.4)", h)), 3, &progress);
        const auto solid = parseSolid("torus(1,0.4)");
        means.push_back(h *
                        errorsOf(made, [&](const Vec3d& p) { return solid->distance(p); }).mean);
    }
    for (std::size_t n = 1; n < means.size(); ++n)
        EXPECT_GT(std::log2(means[n - 1] / means[n]), 1.8) << means[n - 1] << " " << means[n];
}

TEST(Redistancing, NothingDependsOnThreadsAndInputsStay)
{
    const LevelSet start = sampled("difference(box(1.6,1.2,1.4),sphere(0.75))");
    const std::string before = test::treeBytes(start.grid());
    std::string first;
    for (const std::size_t threads : {1, 2, 5}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Interrupter progress;
        const std::string bytes =
            test::treeBytes(redistance(start.grid(), 4, &progress).grid()) +
            test::treeBytes(offset(start, 0.3, &progress).grid()) +
            test::treeBytes(offset(start, -0.2, &progress).grid()) +
            test::treeBytes(shell(start, 0.2, Wall::Centered, &progress).grid());
        if (first.empty()) first = bytes;
        EXPECT_EQ(bytes == first, true) << threads << " threads";
    }
    EXPECT_EQ(test::treeBytes(start.grid()) == before, true);
}

TEST(Redistancing, StopsWithinAQuarterSecond)
{
    using Clock = std::chrono::steady_clock;
    const LevelSet ball = sampled("sphere(3)", 0.02);
    Interrupter progress;
    Clock::time_point stopped;
    std::thread stopper([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(60));
        stopped = Clock::now();
        progress.stop();
    });
    EXPECT_THROW(offset(ball, 60 * 0.02, &progress), Interrupted);
    const auto late = Clock::now();
    stopper.join();
    EXPECT_LT(std::chrono::duration<double>(late - stopped).count(), 0.25);
}

} // namespace
} // namespace mpuvdb
