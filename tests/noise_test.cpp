// Points with noise: what it does to fits, to fields and to grids, and what takes it out again.
#include "mpu/fit/fit_quality.h"
#include "mpu/fit/local_fit.h"
#include "noisy_points.h"
#include "uncleaned.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using test::append;
using test::normalDraw;
using test::Random;

constexpr std::uint64_t kSeed = 20030727;

/// Points of the ball of radius 1 about the origin, on z = height + bend (x^2 - y^2 / 2) with
/// noise along z and the surface's own normals.
CellPoints sheetOf(std::size_t count, double height, double bend, double noise, Random& random)
{
    PointBatch batch;
    while (batch.size() < count) {
        const double x = random.uniform(-1, 1), y = random.uniform(-1, 1);
        const double z = height + bend * (x * x - y * y / 2) + noise * normalDraw(random);
        if (x * x + y * y + z * z >= 1) continue;
        const Vec3d n = Vec3d(-2 * bend * x, bend * y, 1).normalized();
        append(batch, {x, y, z}, n);
    }
    CellPoints points;
    points.assign(batch, Vec3d::Zero(), 1);
    return points;
}

/// Height of the zero set above (x, y), to first order.
double heightOf(const Quadric& q, double x, double y)
{
    Vec3d p(x, y, 0);
    for (int step = 0; step < 5; ++step) p[2] -= q.value(p) / q.gradient(p)[2];
    return p[2];
}

/// Root mean square over a disc of what @a q errs about the sheet.
double errorOf(const Quadric& q, double height, double bend)
{
    double squares = 0;
    int count = 0;
    for (double x = -0.6; x < 0.61; x += 0.1) {
        for (double y = -0.6; y < 0.61; y += 0.1, ++count) {
            const double off = heightOf(q, x, y) - height - bend * (x * x - y * y / 2);
            squares += off * off;
        }
    }
    return std::sqrt(squares / count);
}

TEST(Noise, ExactNormalsChangeNoExactFit)
{
    Random random(kSeed);
    const CellPoints points = sheetOf(60, 0.1, 0.2, 0, random);
    const Vec3d normal = Vec3d::UnitZ();
    EXPECT_LT(errorOf(fitBivariate(points, normal), 0.1, 0.2), 1e-6);
    EXPECT_LT(errorOf(fitBivariate(points, normal, 6, 2.0), 0.1, 0.2), 1e-6);
}

// The slopes and the bend are then told by the normals, and the noise is left with one unknown.
TEST(Noise, NormalsSteadyTheFit)
{
    Random random(kSeed);
    constexpr double kNoise = 0.1;
    double plain = 0, steadied = 0;
    for (int trial = 0; trial < 100; ++trial) {
        const CellPoints points = sheetOf(60, 0.1, 0.2, kNoise, random);
        plain += errorOf(fitBivariate(points, Vec3d::UnitZ()), 0.1, 0.2);
        steadied += errorOf(fitBivariate(points, Vec3d::UnitZ(), 6, kNoise / 0.04), 0.1, 0.2);
    }
    EXPECT_LT(steadied, 0.55 * plain) << "seed " << kSeed;
}

// Weighed by the distance from the center, points thrown towards it count more.
TEST(Noise, WeightsAcrossTheSurfaceDoNotPullIt)
{
    Random random(kSeed);
    constexpr double kHeight = 0.25, kNoise = 0.2;
    constexpr int kTrials = 200;
    double pulled = 0, free = 0;
    for (int trial = 0; trial < kTrials; ++trial) {
        CellPoints points = sheetOf(200, kHeight, 0, kNoise, random);
        pulled += heightOf(fitBivariate(points, Vec3d::UnitZ(), 1000), 0, 0) - kHeight;
        points.weightLaterally(Vec3d::UnitZ(), 0.6); // where the ball cuts no noise off
        free += heightOf(fitBivariate(points, Vec3d::UnitZ(), 1000), 0, 0) - kHeight;
    }
    // About 50 points count in each trial.
    const double standardError = kNoise / std::sqrt(50.0 * kTrials);
    EXPECT_LT(pulled / kTrials, -0.1 * kHeight);
    EXPECT_LT(std::abs(free / kTrials), 5 * standardError) << "seed " << kSeed;
}

TEST(Noise, ResidualsAreToldFromShape)
{
    Random random(kSeed);
    constexpr double kNoise = 0.15;
    constexpr int kTrials = 200;
    int noise = 0, shape = 0;
    for (int trial = 0; trial < kTrials; ++trial) {
        const CellPoints flat = sheetOf(300, 0.05, 0, kNoise, random);
        LocalFit fit;
        fit.pieces[0] = fitBivariate(flat, Vec3d::UnitZ());
        noise += residualsAreNoise(fit, flat, 0.8, kNoise);
        const CellPoints bent = sheetOf(300, 0, 0.6, kNoise, random);
        fit.pieces[0] = fitBivariate(bent, Vec3d::UnitZ(), 1000); // a plane
        shape += !residualsAreNoise(fit, bent, 0.8, kNoise);
    }
    EXPECT_GT(noise, 0.9 * kTrials) << "seed " << kSeed;
    EXPECT_GT(shape, 0.9 * kTrials) << "seed " << kSeed;
}

/// Lift the points by waves along x.
void addWaves(CellPoints& points, double height)
{
    for (std::size_t i = 0; i < points.count; ++i)
        points.z[i] += height * std::sin(4 * points.x[i]);
}

TEST(Noise, ShapeThatOnlyPointsOfLowConfidenceShowIsNone)
{
    Random random(kSeed);
    constexpr double kNoise = 0.1;
    constexpr int kTrials = 200;
    int noise = 0, shape = 0;
    LocalFit plane;
    plane.pieces[0].b = Vec3d::UnitZ();
    for (int trial = 0; trial < kTrials; ++trial) {
        CellPoints points = sheetOf(300, 0, 0, kNoise, random);
        points.confidence.assign(points.confidence.size(), 0.1);
        noise += residualsAreNoise(plane, points, 0.8, kNoise);
        addWaves(points, 0.12);
        shape += !residualsAreNoise(plane, points, 0.8, kNoise);
    }
    EXPECT_GT(noise, 0.9 * kTrials) << "seed " << kSeed;
    EXPECT_GT(shape, 0.9 * kTrials) << "seed " << kSeed;
}

TEST(Noise, StraysAmongNormalsAreNoSecondSheet)
{
    Random random(kSeed);
    CellPoints points = sheetOf(300, 0, 0.1, 0.05, random);
    for (std::size_t i = 0; i < points.count; i += 60) points.nz[i] = -points.nz[i];
    FitSettings settings;
    settings.tolerance = 0.01;
    CellPoints scratch;
    EXPECT_TRUE(fitCell(points, 1, 1, settings, scratch).opposedNormals);
    settings.noise = 0.05;
    EXPECT_FALSE(fitCell(points, 1, 1, settings, scratch).opposedNormals);
}

PointCloud noisyScan(const std::string& solid, double points, double noise, double degrees,
                     std::uint64_t seed = 1)
{
    ScanSettings settings;
    settings.seed = seed;
    settings.points = std::uint64_t(points);
    settings.pattern = ScanSettings::Pattern::Random;
    settings.noise = noise;
    settings.normalNoise = degrees;
    return test::scanOf(solid, settings);
}

TEST(Noise, OfNormalsIsMeasured)
{
    Interrupter progress;
    for (const char* const solid : {"sphere(1)", "torus(1,0.4)", "box(2,2,1)"}) {
        for (const double degrees : {3.0, 10.0}) {
            for (const double noise : {0.0, 0.02}) {
                const PointCloud cloud = noisyScan(solid, 40000, noise, degrees);
                const double measured = measure(cloud, &progress).normalNoise * 180 / M_PI;
                EXPECT_NEAR(measured, degrees, 0.25 * degrees) << solid << " noise " << noise;
            }
        }
        const PointCloud exact = noisyScan(solid, 40000, 0, 0);
        EXPECT_LT(measure(exact, &progress).normalNoise, 0.02) << solid;
    }
    PointCloud bare = noisyScan("sphere(1)", 5000, 0.01, 0);
    bare.normals.clear();
    EXPECT_EQ(measure(bare, &progress).normalNoise, 0);
}

// A thousand neighbors then fill a ball not much larger than the noise.
TEST(Noise, OfDensePointsIsMeasured)
{
    Interrupter progress;
    for (const char* const solid : {"torus(1,0.4)", "difference(box(2,2,1), cylinder(0.4,3))"}) {
        constexpr double kNoise = 0.03;
        const PointCloud cloud = noisyScan(solid, 300000, kNoise, 5);
        EXPECT_NEAR(measure(cloud, &progress).noise, kNoise, 0.15 * kNoise) << solid;
    }
}

/// Mean of the field's values at places on the sphere of radius 1.
double meanOnSphere(const MpuField& field, Random& random)
{
    constexpr int kPlaces = 2000;
    double sum = 0;
    for (int i = 0; i < kPlaces; ++i) sum += field.evaluate(random.direction()).value;
    return sum / kPlaces;
}

MpuSettings settingsFor(const PointCloud& cloud, double voxelSize)
{
    Interrupter progress;
    const PointStatistics statistics = measure(cloud, &progress);
    MpuSettings settings;
    settings.voxelSize = voxelSize;
    settings.tolerance = 0.1 * voxelSize;
    settings.noise = statistics.noise;
    settings.normalNoise = statistics.normalNoise;
    return settings;
}

// Thrown along the normals points are thinner outside: windows across a sphere of radius r see it
// at r - 2 noise^2 / r. The rest of the bias must be small beside that.
/// So few points that any ball about one holds much of the shape, which is no noise.
TEST(Noise, OfAFewExactPointsIsNone)
{
    for (const std::size_t count : {30u, 40u, 50u}) {
        PointCloud cloud;
        for (std::size_t n = 0; n < count; ++n) { // a spiral from pole to pole
            const double z = 1 - (2 * double(n) + 1) / double(count), r = std::sqrt(1 - z * z);
            const double turn = double(n) * M_PI * (3 - std::sqrt(5.0));
            cloud.normals.push_back(Vec3d(r * std::cos(turn), r * std::sin(turn), z).cast<float>());
        }
        cloud.positions = cloud.normals;
        Interrupter progress;
        EXPECT_LT(measure(cloud, &progress).noise, 1e-5) << count; // rounding
        const auto made = reconstruct(PointInput(std::move(cloud)), {}, &progress);
        // Flat between points, the volume is less by the spacing squared, to 15 %.
        EXPECT_NEAR(measure(made.levelSet()).volume, 4.0 / 3 * M_PI * (1 - 5.0 / double(count)),
                    0.15 * 4)
            << count;
    }
}

TEST(Noise, MovesNoSphere)
{
    constexpr double kNoise = 0.06, kShift = 2 * kNoise * kNoise;
    Random random(kSeed);
    Interrupter progress;
    PointCloud cloud = noisyScan("sphere(1)", 60000, kNoise, 5);
    const MpuSettings settings = settingsFor(cloud, 0.03);
    const MpuField field(std::move(cloud), settings, &progress);
    // Standard error of 60 000 points' mean: 0.00025.
    EXPECT_LT(std::abs(meanOnSphere(field, random)), 0.25 * kShift) << "seed " << kSeed;
}

/// Root mean square of the distances of a grid's zero crossings from @a solid.
double errorFrom(const std::string& solid, const LevelSet& levelSet)
{
    const auto truth = parseSolid(solid);
    const openvdb::FloatGrid& grid = levelSet.grid();
    const double h = grid.voxelSize()[0];
    double squares = 0;
    std::size_t count = 0;
    const auto access = grid.getConstAccessor();
    for (auto it = grid.cbeginValueOn(); it; ++it) {
        for (int axis = 0; axis < 3; ++axis) {
            openvdb::Coord next = it.getCoord();
            next[axis] += 1;
            const float a = *it, b = access.getValue(next);
            if ((a < 0) == (b < 0)) continue;
            openvdb::Vec3d p = grid.indexToWorld(it.getCoord());
            p[axis] += h * double(a / (a - b));
            const double d = truth->distance({p[0], p[1], p[2]});
            squares += d * d;
            ++count;
        }
    }
    return std::sqrt(squares / double(count));
}

TEST(Noise, IsTakenOutOfTheGrid)
{
    Interrupter progress;
    const double diagonal = std::sqrt(2.8 * 2.8 * 2 + 0.8 * 0.8);
    for (const double share : {0.005, 0.01}) {
        const double noise = share * diagonal;
        const ReconstructResult made =
            reconstruct(noisyScan("torus(1,0.4)", 100000, noise, 10), test::Uncleaned(), &progress);
        EXPECT_LT(errorFrom("torus(1,0.4)", made.levelSet()), noise / 12) << share;
        const CheckReport report =
            check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
        EXPECT_TRUE(report.sound()) << share << "\n" << test::texts(report);
    }
}

// The points of the two sides lie among each other; only their normals tell them apart. Where the
// wall ends in nothing a handle may be left now and then.
TEST(Noise, LeavesThinWallsWhole)
{
    constexpr double kNoise = 0.02;
    constexpr std::uint64_t kSeeds = 4;
    const char* const wall = "ellipsoid(1, 0.8, 0.03)";
    std::int64_t handles = 0;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
        Interrupter progress;
        const ReconstructResult made =
            reconstruct(noisyScan(wall, 60000, kNoise, 5, seed), test::Uncleaned(), &progress);
        const CheckReport checked =
            check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
        EXPECT_TRUE(checked.sound()) << seed << "\n" << test::texts(checked);
        const MeshReport report = measure(extractMesh(made.levelSet(), {}, &progress));
        handles += std::int64_t(report.components) - report.eulerCharacteristic / 2;
        EXPECT_LT(errorFrom(wall, made.levelSet()), kNoise / 4) << seed;
    }
    EXPECT_LT(handles, std::int64_t(kSeeds) / 2);
}

TEST(Noise, LeavesThinGapsOpen)
{
    constexpr double kNoise = 0.02;
    const char* const gap = "difference(box(2, 2, 1), box(3, 3, 0.05))";
    Interrupter progress;
    const ReconstructResult made =
        reconstruct(noisyScan(gap, 60000, kNoise, 5), test::Uncleaned(), &progress);
    EXPECT_LT(errorFrom(gap, made.levelSet()), 0.4 * kNoise);
}

// Fits of rods as thin as the noise disagree with each other.
TEST(Noise, LeavesDistancesBesideThinRods)
{
    Interrupter progress;
    const ReconstructResult made =
        reconstruct(noisyScan("torus(1, 0.05)", 30000, 0.04, 5), test::Uncleaned(), &progress);
    const CheckReport checked =
        check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(checked.sound()) << test::texts(checked);
}

// Balls that tell a surface from noise hold all sides of such parts: no fit shows them, and each
// would lean another way.
TEST(Noise, LeavesLimbsAndPlatesSmooth)
{
    struct Part {
        const char* solid;
        double noise;
    };
    for (const Part& part : {Part{"union(sphere(0.5), capsule(0.09, 2.6))", 0.03},
                             Part{"capsule(0.1, 2.4)", 0.026}, Part{"slab(2, 2, 0.15)", 0.028}}) {
        Interrupter progress;
        const ReconstructResult made =
            reconstruct(noisyScan(part.solid, 30000, part.noise, 0), test::Uncleaned(), &progress);
        EXPECT_LT(errorFrom(part.solid, made.levelSet()), 0.3 * part.noise) << part.solid;
        const CheckReport checked =
            check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
        EXPECT_TRUE(checked.sound()) << part.solid << "\n" << test::texts(checked);
        const MeshReport report = measure(extractMesh(made.levelSet(), {}, &progress));
        EXPECT_EQ(report.components, 1u) << part.solid;
        EXPECT_EQ(report.eulerCharacteristic, 2) << part.solid;
    }
}

TEST(Noise, BelowAVoxelBlursNoEdges)
{
    Interrupter progress;
    constexpr double kNoise = 0.003; // a sixth of a voxel
    const std::string solid = "difference(box(2,2,1), cylinder(0.4,3))";
    const ReconstructResult made =
        reconstruct(noisyScan(solid, 100000, kNoise, 0), test::Uncleaned(), &progress);
    EXPECT_LT(errorFrom(solid, made.levelSet()), kNoise / 4);
}

// At its edges a few normals out of many are turned by a right angle or more from the mean.
TEST(Noise, MakesNoHandlesAtEdges)
{
    Interrupter progress;
    const ReconstructResult made =
        reconstruct(noisyScan("difference(box(2,2,1), cylinder(0.4,3))", 50000, 0.03, 10),
                    test::Uncleaned(), &progress);
    const MeshReport report = measure(extractMesh(made.levelSet(), {}, &progress));
    EXPECT_EQ(report.components, 1u);
    EXPECT_EQ(report.eulerCharacteristic, 0);
}

} // namespace
} // namespace mpuvdb
