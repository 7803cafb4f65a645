// Interpolation: a field that is zero at every point, and the surface it makes.
#include "field_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>
#include <openvdb/math/Proximity.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <tbb/global_control.h>

namespace mpuvdb
{
namespace
{

using test::Random;

MpuField fieldOf(PointCloud cloud, double voxelSize)
{
    MpuSettings settings;
    settings.voxelSize = voxelSize;
    settings.tolerance = 0.1 * voxelSize;
    settings.interpolate = true;
    settings.alpha = kInterpolationAlpha;
    Interrupter progress;
    return MpuField(std::move(cloud), settings, &progress);
}

/// Largest value at a point, in diagonals of the points' box.
double largestAtPoints(const MpuField& field, const PointCloud& cloud)
{
    double largest = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const FieldSample sample = field.evaluate(cloud.world(i));
        EXPECT_TRUE(sample.supported && std::isfinite(sample.value)) << "point " << i;
        largest = std::max(largest, std::abs(sample.value));
    }
    return largest / cloud.localBounds().diagonal().norm();
}

void addPoint(PointCloud& cloud, const Vec3f& position, const Vec3f& normal)
{
    cloud.positions.push_back(position);
    cloud.normals.push_back(normal);
}

constexpr double kRounding = 1e-7; ///< of the diagonal, where 1e-6 is asked for

// --- Zero at the points

class InterpolatedShape : public testing::TestWithParam<const char*>
{
};

TEST_P(InterpolatedShape, IsZeroAtEveryPoint)
{
    // Also with far fewer voxels than points ask for: the points rule the octree's depth.
    const PointCloud cloud = test::randomScan(GetParam(), 2000);
    for (const double h : {0.04, 0.3})
        EXPECT_LT(largestAtPoints(fieldOf(cloud, h), cloud), kRounding) << "voxel size " << h;
}

INSTANTIATE_TEST_SUITE_P(Shapes, InterpolatedShape,
                         testing::Values("sphere(1)", "torus(1, 0.4)", "box(2, 1.5, 1)",
                                         "roundedbox(2, 1.6, 1.2, 0.3)", "blob(1, 8, 0.1)",
                                         "difference(box(2,2,1), cylinder(0.4,3))"));

TEST(Interpolation, IsZeroAtPointsWithHolesAndNoise)
{
    ScanSettings scan;
    scan.points = 5000;
    scan.pattern = ScanSettings::Pattern::Random;
    scan.holes = 1;
    scan.holeRadius = 0.15;
    scan.noise = 0.01;
    const PointCloud cloud = test::scanOf("sphere(1)", scan);
    EXPECT_LT(largestAtPoints(fieldOf(cloud, 0.05), cloud), kRounding);
}

TEST(Interpolation, IsZeroAtPointsOfNoShape)
{
    // Nothing that a surface could follow, in a cube and crowded at the origin, where floats are
    // dense and cells can be split for ever.
    Random random(11);
    PointCloud cloud;
    for (int i = 0; i < 600; ++i) {
        const double scale = i % 2 ? 1.0 : std::pow(10.0, -random.uniform(1, 6));
        addPoint(cloud, random.inCube(scale).cast<float>(), random.direction().cast<float>());
    }
    EXPECT_LT(largestAtPoints(fieldOf(cloud, 0.1), cloud), kRounding) << "seed 11";
}

TEST(Interpolation, IsZeroAtPointsMuchCloserThanAnythingElse)
{
    PointCloud cloud = test::randomScan("sphere(1)", 2000);
    Random random(12);
    const std::size_t count = cloud.size();
    for (std::size_t i = 0; i < count; i += 10) {
        const double apart = std::pow(10.0, -random.uniform(3, 12));
        addPoint(cloud, cloud.positions[i] + random.inBall(apart).cast<float>(), cloud.normals[i]);
    }
    EXPECT_LT(largestAtPoints(fieldOf(cloud, 0.05), cloud), kRounding) << "seed 12";
}

TEST(Interpolation, IsZeroFarFromTheOrigin)
{
    PointCloud cloud = test::randomScan("torus(1, 0.4)", 4000);
    cloud.frame = Vec3d(5000000, 5000000, 5000000);
    EXPECT_LT(largestAtPoints(fieldOf(cloud, 0.05), cloud), kRounding);
}

TEST(Interpolation, TakesCopiesOfAPointAsOne)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 3000);
    const MpuField once = fieldOf(cloud, 0.05);
    PointCloud copied = cloud, turned = cloud;
    Random random(13);
    for (std::size_t i = 0; i < cloud.size(); i += 2) {
        addPoint(copied, cloud.positions[i], cloud.normals[i]);
        for (int k = 0; k < 3; ++k) {
            const Vec3d normal = cloud.normals[i].cast<double>() + random.inBall(0.5);
            addPoint(turned, cloud.positions[i], normal.normalized().cast<float>());
        }
    }
    const MpuField twice = fieldOf(copied, 0.05), bent = fieldOf(turned, 0.05);
    EXPECT_EQ(twice.statistics().cells, once.statistics().cells);
    EXPECT_LT(largestAtPoints(bent, turned), kRounding);
    for (int i = 0; i < 200; ++i) {
        const Vec3d p = random.uniform(0.9, 1.1) * random.direction();
        EXPECT_NEAR(twice.evaluate(p).value, once.evaluate(p).value, 1e-7) << "seed 13";
        EXPECT_NEAR(bent.evaluate(p).value, once.evaluate(p).value, 0.005) << "seed 13";
    }
}

TEST(Interpolation, CopiesWithOpposedNormalsAreNoTrap)
{
    PointCloud cloud = test::randomScan("sphere(1)", 1000);
    const std::size_t count = cloud.size();
    for (std::size_t i = 0; i < count; i += 50)
        addPoint(cloud, cloud.positions[i], -cloud.normals[i]);
    for (int i = 0; i < 5000; ++i) addPoint(cloud, cloud.positions[3], cloud.normals[3]);
    EXPECT_LT(largestAtPoints(fieldOf(cloud, 0.1), cloud), kRounding);
}

TEST(Interpolation, OfAFewPoints)
{
    for (const int count : {1, 2, 5, 20}) {
        PointCloud cloud = test::randomScan("sphere(1)", 200);
        cloud.positions.resize(std::size_t(count));
        cloud.normals.resize(std::size_t(count));
        const MpuField field = fieldOf(cloud, 0.1);
        for (int i = 0; i < count; ++i)
            EXPECT_LT(std::abs(field.evaluate(cloud.world(std::size_t(i))).value), 1e-7) << count;
    }
}

// --- Blocks

TEST(Interpolation, BlocksHaveTheValuesOfThePointsAlsoOnThem)
{
    // Every third point is on a voxel, where its weight is infinite.
    const double h = 0.0625;
    PointCloud cloud = test::randomScan("sphere(1)", 3000);
    for (std::size_t i = 0; i < cloud.size(); i += 3) {
        cloud.positions[i] = ((cloud.positions[i] / float(h)).array().round() * float(h)).matrix();
        cloud.normals[i] = cloud.positions[i].normalized();
    }
    const MpuField field = fieldOf(cloud, h);
    const Lattice lattice{cloud.frame, h};
    const auto sampler = field.sampler(lattice, 3 * h);
    BlockValues values;
    std::size_t onPoints = 0;
    const std::vector<Vec3i> blocks = field.seedBlocks(lattice);
    for (std::size_t n = 0; n < blocks.size(); n += 3) {
        const Vec3i& block = blocks[n];
        sampler->evaluate(block, values);
        for (int i = 0; i < kBlockVoxels; ++i) {
            const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
            const Vec3d p = lattice.origin + h * voxel.cast<double>();
            const double expected = std::clamp(field.evaluate(p).value, -3 * h, 3 * h);
            ASSERT_NEAR(values[std::size_t(i)], expected, 2e-4 * h) << voxel.transpose();
            onPoints += std::abs(expected) < 1e-12;
        }
    }
    EXPECT_GT(onPoints, 100u);
}

// --- The surface

double distanceTo(const openvdb::Vec3d& p, const Mesh& mesh, const Mesh::Triangle& t)
{
    const auto at = [&](std::size_t k) {
        const Vec3f& v = mesh.positions[t[k]];
        return openvdb::Vec3d(v[0], v[1], v[2]);
    };
    openvdb::Vec3d uvw;
    return (p - openvdb::math::closestPointOnTriangleToPoint(at(0), at(1), at(2), p, uvw)).length();
}

/// Largest distance of a point from the mesh, up to @a far.
double largestDistance(const PointCloud& cloud, const Mesh& mesh, double far)
{
    using Bin = std::array<int, 3>;
    const auto binOf = [far](const Vec3d& p) {
        return Bin{int(std::floor(p[0] / far)), int(std::floor(p[1] / far)),
                   int(std::floor(p[2] / far))};
    };
    std::map<Bin, std::vector<std::size_t>> bins; // triangles are smaller than far
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
        bins[binOf(mesh.positions[mesh.triangles[t][0]].cast<double>())].push_back(t);
    double largest = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d p = cloud.world(i) - mesh.frame;
        const Bin bin = binOf(p);
        double nearest = far;
        for (int n = 0; n < 27; ++n) {
            const auto found =
                bins.find({bin[0] + n % 3 - 1, bin[1] + n / 3 % 3 - 1, bin[2] + n / 9 - 1});
            if (found == bins.end()) continue;
            for (const std::size_t t : found->second)
                nearest =
                    std::min(nearest, distanceTo({p[0], p[1], p[2]}, mesh, mesh.triangles[t]));
        }
        largest = std::max(largest, nearest);
    }
    return largest;
}

ReconstructResult interpolated(PointCloud cloud, double voxelSize)
{
    test::Uncleaned settings;
    settings.voxelSize = Length{voxelSize, Length::Unit::World};
    settings.interpolate = true;
    Interrupter progress;
    return reconstruct(std::move(cloud), settings, &progress);
}

struct Limits {
    const char* solid;
    double area, extent;
    int euler;
    double rms; ///< voxels
};

class InterpolatedSurface : public testing::TestWithParam<Limits>
{
};

TEST_P(InterpolatedSurface, IsSoundAccurateAndNearThePoints)
{
    const Limits& model = GetParam();
    const double h = model.extent / 64;
    PointCloud cloud = test::randomScan(model.solid, model.area / (h * h));
    Interrupter progress;
    const ReconstructResult made = interpolated(cloud, h);
    const CheckReport report =
        check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << test::texts(report);
    const Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
    const MeshReport measured = measure(mesh);
    EXPECT_EQ(measured.components, 1u);
    EXPECT_EQ(measured.boundaryEdges, 0u);
    EXPECT_EQ(measured.nonManifoldEdges, 0u);
    EXPECT_EQ(measured.eulerCharacteristic, model.euler);
    EXPECT_LT(largestDistance(cloud, mesh, 2 * h), 0.5 * h);

    const auto solid = parseSolid(model.solid);
    double sum = 0;
    for (auto v = made.levelSet().grid().cbeginValueOn(); v; ++v)
        sum += std::pow(double(*v) -
                            solid->distance(test::worldOf(made.levelSet().lattice(), v.getCoord())),
                        2);
    EXPECT_LT(std::sqrt(sum / double(made.levelSet().grid().activeVoxelCount())), model.rms * h);
}

INSTANTIATE_TEST_SUITE_P(
    Models, InterpolatedSurface,
    testing::Values(Limits{"sphere(1)", 4 * M_PI, 2, 2, 0.02},
                    Limits{"torus(1, 0.4)", 4 * M_PI* M_PI * 0.4, 2.8, 0, 0.03},
                    Limits{"rotate(box(2, 1.5, 1), 1, 2, 3, 25)", 13, 2.4, 2, 0.3}));

TEST(Interpolation, PassesWhereAnApproximationDoesNot)
{
    // Noise of a quarter of a voxel: the default averages over it.
    ScanSettings scan;
    scan.points = 6000;
    scan.noise = 0.003; // of the diagonal
    scan.pattern = ScanSettings::Pattern::Random;
    const PointCloud cloud = test::scanOf("sphere(1)", scan);
    const double h = 0.04;
    Interrupter progress;
    const ReconstructResult exact = interpolated(cloud, h);
    EXPECT_LT(largestAtPoints(*exact.field, cloud), kRounding);
    EXPECT_LT(largestDistance(cloud, extractMesh(exact.levelSet(), {}, &progress), 2 * h), 0.5 * h);
    test::Uncleaned smooth;
    smooth.voxelSize = Length{h, Length::Unit::World};
    const ReconstructResult approximated = reconstruct(PointCloud(cloud), smooth, &progress);
    EXPECT_GT(largestAtPoints(*approximated.field, cloud), 1e-3);
}

TEST(Interpolation, OneThreadAndManyGiveTheSameBytes)
{
    PointCloud cloud = test::randomScan("torus(1, 0.4)", 6000);
    const std::size_t count = cloud.size();
    for (std::size_t i = 0; i < count; i += 7)
        addPoint(cloud, cloud.positions[i], -cloud.normals[i]);
    const auto bytesWith = [&](std::size_t threads, PointCloud points) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        return test::treeBytes(interpolated(std::move(points), 0.07).levelSet().grid());
    };
    const std::string one = bytesWith(1, cloud);
    EXPECT_TRUE(bytesWith(4, cloud) == one);
    EXPECT_TRUE(bytesWith(2, test::shuffled(cloud, 14)) == one) << "seed 14";
}

TEST(Interpolation, OfRealScans)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    for (const char* name : {"bunny/bun_zipper.ply", "clouds/kitten.xyz"}) {
        Interrupter progress;
        const PointCloud cloud =
            readPoints({std::filesystem::path(folder) / name}, BadPoints::Drop, {}, {}, &progress)
                .cloud;
        test::Uncleaned settings;
        settings.interpolate = true;
        const ReconstructResult made = reconstruct(PointCloud(cloud), settings, &progress);
        const double h = made.levelSet().voxelSize();
        EXPECT_LT(largestAtPoints(*made.field, cloud), kRounding) << name;
        EXPECT_LT(largestDistance(cloud, extractMesh(made.levelSet(), {}, &progress), 2 * h),
                  0.5 * h)
            << name;
        const CheckReport report =
            check(made.levelSet().grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
        EXPECT_TRUE(report.sound()) << name << '\n' << test::texts(report);
    }
}

// --- Settings

TEST(Interpolation, ChoosesItsDefaultsAndKeepsWhatIsGiven)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 2000);
    Interrupter progress;
    test::Uncleaned given;
    EXPECT_DOUBLE_EQ(preparePoints(PointCloud(cloud), given, &progress).report.settings.fit.alpha,
                     0.75);
    given.interpolate = true;
    const ResolvedSettings open =
        preparePoints(PointCloud(cloud), given, &progress).report.settings;
    EXPECT_TRUE(open.fit.interpolate);
    EXPECT_FALSE(open.fit.sharp);
    EXPECT_DOUBLE_EQ(open.fit.alpha, 1.25);
    given.alpha = 1.5;
    given.minPoints = 20;
    given.tolerance = Length::parse("0.5vx");
    const MpuSettings fit = preparePoints(PointCloud(cloud), given, &progress).report.settings.fit;
    EXPECT_DOUBLE_EQ(fit.alpha, 1.5);
    EXPECT_EQ(fit.minPoints, 20);
    EXPECT_DOUBLE_EQ(fit.tolerance, 0.5 * fit.voxelSize);
    for (const double bad : {0.75, 1.04, 2.01, std::nan("")}) {
        given.alpha = bad;
        EXPECT_THROW(reconstruct(PointCloud(cloud), given, &progress), UsageError) << bad;
    }
}

TEST(Interpolation, IsZeroAtThePointsWithAllItsSettings)
{
    const PointCloud cloud = test::randomScan("torus(1, 0.4)", 800);
    Interrupter progress;
    for (const double alpha : {1.05, 2.0})
        for (const int minPoints : {6, 100})
            for (const double tolerance : {1e-4, 1.0}) {
                MpuSettings settings;
                settings.voxelSize = 0.1;
                settings.interpolate = true;
                settings.alpha = alpha;
                settings.minPoints = minPoints;
                settings.tolerance = tolerance;
                const MpuField field(PointCloud(cloud), settings, &progress);
                EXPECT_LT(largestAtPoints(field, cloud), kRounding)
                    << alpha << ' ' << minPoints << ' ' << tolerance;
            }
}

TEST(Interpolation, ALooseToleranceMeansFewerCellsWherePointsAreFew)
{
    PointCloud cloud = test::randomScan("torus(1, 0.4)", 400);
    Interrupter progress;
    std::uint64_t cells = 0;
    for (const double tolerance : {1.0, 1e-4}) {
        MpuSettings settings;
        settings.voxelSize = 0.01;
        settings.interpolate = true;
        settings.alpha = kInterpolationAlpha;
        settings.tolerance = tolerance;
        const MpuField field(PointCloud(cloud), settings, &progress);
        EXPECT_GT(field.statistics().cells, cells);
        cells = field.statistics().cells;
    }
}

} // namespace
} // namespace mpuvdb
