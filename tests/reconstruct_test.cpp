// Points to level set: how near the surface comes, how fast it converges, what shape it has.
#include "modelling_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using test::expectSound;

/// A solid with its longest side and its area: for points a voxel apart.
struct Model {
    std::string name;
    double extent, area, volume;
};

const Model kSphere{"sphere(1)", 2, 4 * M_PI, 4 * M_PI / 3};
const Model kTorus{"torus(1, 0.4)", 2.8, 4 * M_PI* M_PI * 0.4, 2 * M_PI* M_PI * 0.16};
const Model kRoundedBox{"roundedbox(2, 1.6, 1.2, 0.3)", 2, 12.46, 0};

/// Random points @a spacing voxels apart, and a grid of @a voxels along the longest side.
ReconstructResult reconstructed(const Model& model, double voxels, double spacing = 1)
{
    const double h = model.extent / voxels;
    test::Uncleaned settings;
    settings.voxelSize = Length{h, Length::Unit::World};
    Interrupter progress;
    return reconstruct(test::randomScan(model.name, model.area / std::pow(spacing * h, 2)),
                       settings, &progress);
}

ReconstructResult reconstructed(PointCloud cloud, double voxelSize)
{
    test::Uncleaned settings;
    settings.voxelSize = Length{voxelSize, Length::Unit::World};
    Interrupter progress;
    return reconstruct(std::move(cloud), settings, &progress);
}

MeshReport meshOf(const LevelSet& levelSet)
{
    Interrupter progress;
    return measure(extractMesh(levelSet, {}, &progress));
}

/// A closed surface in one piece (or @a components), Euler characteristic as given.
void expectTopology(const LevelSet& levelSet, std::uint64_t components, std::int64_t euler)
{
    const MeshReport mesh = meshOf(levelSet);
    EXPECT_EQ(mesh.components, components);
    EXPECT_EQ(mesh.eulerCharacteristic, euler);
    EXPECT_EQ(mesh.boundaryEdges, 0u);
    EXPECT_EQ(mesh.nonManifoldEdges, 0u);
}

/// Root mean square over the band of value minus distance, world units.
double bandError(const LevelSet& levelSet, const Solid& solid)
{
    double sum = 0;
    for (auto v = levelSet.grid().cbeginValueOn(); v; ++v) {
        const double d = solid.distance(test::worldOf(levelSet.lattice(), v.getCoord()));
        sum += std::pow(double(*v) - d, 2);
    }
    return std::sqrt(sum / double(levelSet.grid().activeVoxelCount()));
}

// --- Accuracy

TEST(Reconstruct, IsNearTheExactDistanceAtTheDefaultTolerance)
{
    struct Limit {
        const Model& model;
        double rms; ///< voxels
    };
    for (const Limit& limit :
         {Limit{kSphere, 0.002}, Limit{kTorus, 0.006}, Limit{kRoundedBox, 0.01}}) {
        const ReconstructResult r = reconstructed(limit.model, 128);
        const double h = r.levelSet().voxelSize();
        EXPECT_LE(bandError(r.levelSet(), *parseSolid(limit.model.name)), limit.rms * h)
            << limit.model.name;
        expectSound(r.levelSet());
    }
}

/// Distance of @a p to the nearest edge of a box of @a size about the origin.
double edgeDistance(const Vec3d& p, const Vec3d& size)
{
    double nearest = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        Vec3d to = p.cwiseAbs() - size / 2;
        to[axis] = std::max(to[axis], 0.0);
        nearest = std::min(nearest, to.norm());
    }
    return nearest;
}

TEST(Reconstruct, KeepsTheEdgesOfABox)
{
    const Vec3d size(2, 1.5, 1);
    const Eigen::AngleAxisd turn(25 * M_PI / 180, Vec3d(1, 2, 3).normalized());
    const Model box{"rotate(box(2, 1.5, 1), 1, 2, 3, 25)", 2.4, 13, 3};
    const ReconstructResult r = reconstructed(box, 128);
    const auto solid = parseSolid(box.name);
    const Lattice lattice = r.levelSet().lattice();
    const auto at = r.levelSet().grid().getConstAccessor();
    double sum = 0, worst = 0;
    std::size_t crossings = 0;
    for (auto v = r.levelSet().grid().cbeginValueOn(); v; ++v) {
        const Coord c = v.getCoord();
        for (const Coord& step : {Coord(1, 0, 0), Coord(0, 1, 0), Coord(0, 0, 1)}) {
            const double a = double(*v), b = double(at.getValue(c + step));
            if ((a < 0) == (b < 0)) continue;
            const Vec3d from = test::worldOf(lattice, c), to = test::worldOf(lattice, c + step);
            const Vec3d zero = from + a / (a - b) * (to - from);
            if (edgeDistance(turn.inverse() * zero, size) > 2 * lattice.voxelSize) continue;
            const double d = std::abs(solid->distance(zero)) / lattice.voxelSize;
            sum += d * d;
            worst = std::max(worst, d);
            ++crossings;
        }
    }
    ASSERT_GT(crossings, 2000u);
    EXPECT_LE(std::sqrt(sum / double(crossings)), 0.05) << "largest " << worst;
    EXPECT_GT(r.field->statistics().sharpFits, 100u);
    expectTopology(r.levelSet(), 1, 2);
    expectSound(r.levelSet());
}

TEST(Reconstruct, WallsAndSlotsThinnerThanTwoVoxelsAreWhereTheirPointsAre)
{
    // Many points for each voxel, but cells as large as voxels hold both sides.
    const double h = 0.05;
    for (const char* const name :
         {"box(2, 2, 0.08)", "difference(box(2, 2, 1), box(1.5, 0.08, 3))"}) {
        const auto solid = parseSolid(name);
        const ReconstructResult r = reconstructed(test::randomScan(name, 60000), h);
        Interrupter progress;
        const Mesh mesh = extractMesh(r.levelSet(), {r.field.get()}, &progress);
        double sum = 0;
        for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
            sum += std::abs(solid->distance(mesh.world(v)));
        const double tolerance = 0.1 * h;
        EXPECT_LT(sum / double(mesh.positions.size()), 0.01 * tolerance) << name;
    }
}

TEST(Reconstruct, WallsOfThreeSpacingsHaveNoPits)
{
    // Where random points leave a gap, those of the other side are as near.
    const char* const name = "difference(cylinder(0.34, 2.6), cylinder(0.26, 4))";
    for (const int points : {10000, 13000}) {
        const ReconstructResult r = reconstructed(test::randomScan(name, points), 0.027);
        Interrupter progress;
        const Mesh mesh = extractMesh(r.levelSet(), {r.field.get()}, &progress);
        const auto solid = parseSolid(name);
        std::size_t walls = 0, pits = 0;
        for (std::uint32_t v = 0; v < mesh.positions.size(); ++v) {
            const Vec3d p = mesh.world(v);
            if (std::abs(p[2]) > 1.2) continue; // its rims
            ++walls;
            pits += std::abs(solid->distance(p)) > 0.5 * r.levelSet().voxelSize();
        }
        ASSERT_GT(walls, 5000u);
        EXPECT_EQ(pits, 0u) << points << " points";
    }
}

// --- Convergence

double order(double coarse, double fine, double refinement)
{
    return std::log(coarse / fine) / std::log(refinement);
}

/// Points of a disc of radius 100 about a scanner in its middle, as many for each doubling of the
/// distance from 1 on.
PointCloud yard(int points)
{
    std::mt19937 random(18);
    std::uniform_real_distribution<double> uniform;
    PointCloud cloud;
    for (int n = 0; n < points; ++n) {
        const double distance = std::pow(100, uniform(random)), turn = 2 * M_PI * uniform(random);
        cloud.positions.emplace_back(float(distance * std::cos(turn)),
                                     float(distance * std::sin(turn)), 0.f);
        cloud.normals.push_back(Vec3f::UnitZ());
    }
    return cloud;
}

TEST(Reconstruct, UnevenPointsHaveLargerVoxels)
{
    Interrupter progress;
    constexpr int kPoints = 30000;
    const ResolvedSettings uneven =
        preparePoints(PointCloud(yard(kPoints)), test::Uncleaned(), &progress).report.settings;
    const double h = uneven.grid.lattice.voxelSize;
    EXPECT_LT(6 * M_PI * 100 * 100 / (h * h), 20 * kPoints); // voxels of the band
    EXPECT_GT(6 * M_PI * 100 * 100 / std::pow(uneven.points.spacing, 2), 50 * kPoints);
    EXPECT_LE(h, std::sqrt(15 / M_PI) * uneven.points.spacing);
    // The area that the points say is the disc's, to the deviation that some 1000 samples leave.
    EXPECT_NEAR(kPoints * uneven.points.areaPerPoint(), M_PI * 100 * 100, 0.15 * M_PI * 100 * 100);
    // Noise of spacings alone changes nothing.
    const ResolvedSettings even =
        preparePoints(test::randomScan("sphere(1)", 5000), test::Uncleaned(), &progress)
            .report.settings;
    EXPECT_EQ(even.grid.lattice.voxelSize, even.points.spacing);
    EXPECT_NEAR(5000 * even.points.areaPerPoint(), 4 * M_PI, 0.3 * 4 * M_PI);
}

TEST(Reconstruct, ConvergesWithTheSquareOfTheVoxelSize)
{
    // Points and tolerance go with the voxel size.
    for (const Model& model : {kSphere, kTorus}) {
        SCOPED_TRACE(model.name);
        const auto solid = parseSolid(model.name);
        std::vector<double> distance, area, volume;
        for (const double voxels : {32.0, 64.0, 128.0}) {
            const ReconstructResult r = reconstructed(model, voxels);
            EXPECT_NEAR(r.report.settings.fit.tolerance, 0.1 * model.extent / voxels,
                        0.05 * model.extent / voxels);
            const MeshReport mesh = meshOf(r.levelSet());
            distance.push_back(bandError(r.levelSet(), *solid));
            area.push_back(std::abs(mesh.area - model.area));
            volume.push_back(std::abs(mesh.volume - model.volume));
        }
        EXPECT_GE(order(distance[0], distance[2], 4), 1.8)
            << distance[0] << ' ' << distance[1] << ' ' << distance[2];
        EXPECT_GE(order(area[0], area[2], 4), 1.8) << area[0] << ' ' << area[1] << ' ' << area[2];
        EXPECT_GE(order(volume[0], volume[2], 4), 1.8)
            << volume[0] << ' ' << volume[1] << ' ' << volume[2];
    }
}

// --- Topology

struct KnownShape {
    const char* description;
    double points, voxelSize;
    std::uint64_t components;
    std::int64_t euler;
    double wall = 5; ///< thinnest, voxels
};

void PrintTo(const KnownShape& shape, std::ostream* out)
{
    *out << shape.description;
}

class ReconstructShape : public testing::TestWithParam<KnownShape>
{
};

TEST_P(ReconstructShape, HasItsTopology)
{
    const KnownShape& shape = GetParam();
    const ReconstructResult r =
        reconstructed(test::randomScan(shape.description, shape.points), shape.voxelSize);
    expectTopology(r.levelSet(), shape.components, shape.euler);
    if (shape.wall >= 2) expectSound(r.levelSet()); // a thinner wall has no room for slopes
}

INSTANTIATE_TEST_SUITE_P(
    Complete, ReconstructShape,
    testing::Values(
        KnownShape{"sphere(1)", 12000, 2.0 / 64, 1, 2},
        KnownShape{"torus(1, 0.4)", 12000, 2.8 / 64, 1, 0},
        KnownShape{"blob(1, 8, 0.1)", 20000, 2.2 / 72, 1, 2},
        // Two spheres, four voxels apart.
        KnownShape{"union(translate(sphere(1), 1.0625, 0, 0),"
                   "translate(sphere(1), -1.0625, 0, 0))",
                   24000, 1.0 / 32, 2, 4},
        // Two slabs eight voxels thick, four apart.
        KnownShape{"union(translate(box(1, 1, 0.2), 0.01, 0, 0.15),"
                   "translate(box(1, 1, 0.2), 0.01, 0, -0.15))",
                   20000, 1.0 / 40, 2, 4},
        // A voxel and a half thick.
        KnownShape{"rotate(slab(1, 1, 0.0375), 1, 2, 3, 20)", 12000, 1.0 / 40, 1, 2, 1.5},
        // Thin, and curved: a ball's wall of five voxels.
        KnownShape{"difference(sphere(1), sphere(0.84375))", 30000, 1.0 / 32, 2, 4},
        // A box through which a hole goes.
        KnownShape{"difference(box(1, 1, 0.6), cylinder(0.25, 2))", 20000, 1.0 / 50, 1, 0}),
    [](const testing::TestParamInfo<KnownShape>& shape) {
        return "No" + std::to_string(shape.index);
    });

// --- Incomplete data

TEST(Reconstruct, ClosesHoles)
{
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
        SCOPED_TRACE(seed);
        ScanSettings scan;
        scan.points = 12000;
        scan.pattern = ScanSettings::Pattern::Random;
        scan.holes = 3;
        scan.holeRadius = 0.1; // of the diagonal: 0.35
        scan.seed = seed;
        const ReconstructResult r = reconstructed(test::scanOf("sphere(1)", scan), 2.0 / 64);
        expectTopology(r.levelSet(), 1, 2);
        EXPECT_NEAR(meshOf(r.levelSet()).volume, kSphere.volume, 0.1 * kSphere.volume);
        expectSound(r.levelSet());
    }
}

TEST(Reconstruct, ClosesHalfASphere)
{
    const PointCloud whole = test::randomScan("sphere(1)", 12000);
    PointCloud half;
    half.frame = whole.frame;
    for (std::size_t i = 0; i < whole.size(); ++i) {
        if (whole.world(i)[2] < 0) continue;
        half.positions.push_back(whole.positions[i]);
        half.normals.push_back(whole.normals[i]);
    }
    const ReconstructResult r = reconstructed(half, 2.0 / 64);
    expectTopology(r.levelSet(), 1, 2);
    EXPECT_GT(meshOf(r.levelSet()).volume, 0.4 * kSphere.volume);
    EXPECT_LT(meshOf(r.levelSet()).volume, 1.2 * kSphere.volume);
    expectSound(r.levelSet());
}

TEST(Reconstruct, ClosesRangeScans)
{
    struct View {
        const char* solid;
        int views;
        double voxelSize;
        std::int64_t euler;
    };
    for (const View& view :
         {View{"blob(1, 5, 0.1)", 5, 1.0 / 32, 2}, View{"torus(1, 0.4)", 8, 1.0 / 24, 0},
          View{"capsule(0.5, 1)", 4, 1.0 / 32, 2}}) {
        SCOPED_TRACE(view.solid);
        ScanSettings scan;
        scan.points = 30000;
        scan.pattern = ScanSettings::Pattern::Scan;
        scan.views = view.views;
        scan.confidence = true;
        const ReconstructResult r = reconstructed(test::scanOf(view.solid, scan), view.voxelSize);
        expectTopology(r.levelSet(), 1, view.euler);
        expectSound(r.levelSet());
    }
}

} // namespace
} // namespace mpuvdb
