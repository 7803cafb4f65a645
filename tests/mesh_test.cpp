#include "field_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <random>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

constexpr double kPi = 3.14159265358979323846;

LevelSet sphere(double radius, double voxelSize, const openvdb::Vec3d& at = openvdb::Vec3d(0))
{
    const auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(
        float(radius), openvdb::Vec3f(0), float(voxelSize));
    grid->transform().postTranslate(at);
    return LevelSet(grid);
}

/// The band of a distance function, in voxels, over a box of +-reach voxels.
LevelSet sampled(const std::function<double(const Vec3d&)>& distance, int reach)
{
    auto grid = FloatGrid::create(3);
    auto accessor = grid->getAccessor();
    for (int x = -reach; x <= reach; ++x)
        for (int y = -reach; y <= reach; ++y)
            for (int z = -reach; z <= reach; ++z) {
                const double d = distance(Vec3d(x, y, z));
                if (std::abs(d) < 3) accessor.setValue(Coord(x, y, z), float(d));
            }
    openvdb::tools::signedFloodFill(grid->tree());
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    return LevelSet(grid);
}

Mesh extracted(const LevelSet& levelSet)
{
    Interrupter progress;
    return extractMesh(levelSet, {}, &progress);
}

void expectClosed(const MeshReport& report)
{
    EXPECT_EQ(report.boundaryEdges, 0u);
    EXPECT_EQ(report.nonManifoldEdges, 0u);
    EXPECT_GT(report.volume, 0);
}

TEST(ExtractMesh, ConvergesInAreaAndVolume)
{
    const double radius = 1;
    std::vector<double> logH, logArea, logVolume;
    for (const double voxelsAcross : {16, 32, 64, 128}) {
        const double h = 2 * radius / voxelsAcross;
        const MeshReport report = measure(extracted(sphere(radius, h)));
        expectClosed(report);
        EXPECT_EQ(report.components, 1u);
        EXPECT_EQ(report.eulerCharacteristic, 2);
        logH.push_back(std::log(h));
        logArea.push_back(std::log(std::abs(report.area / (4 * kPi) - 1)));
        logVolume.push_back(std::log(std::abs(report.volume / (4 * kPi / 3) - 1)));
    }
    const auto slope = [&](const std::vector<double>& y) {
        return (y.back() - y.front()) / (logH.back() - logH.front());
    };
    EXPECT_GT(slope(logArea), 1.8);
    EXPECT_GT(slope(logVolume), 1.8);
    EXPECT_LT(logArea.back(), std::log(1e-3));
    EXPECT_LT(logVolume.back(), std::log(1e-3));
}

/// Triangles are on the surface in the mean, so that the volume's error is of higher than second
/// order, down to balls of four voxels across, whose normals differ as those at creases do.
TEST(ExtractMesh, KeepsTheVolumeOfSmallBalls)
{
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> within(0, 1);
    for (const double r : {2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0})
        for (int n = 0; n < 4; ++n) {
            const Vec3d center(within(random), within(random), within(random));
            const auto ball = [&](const Vec3d& p) { return (p - center).norm() - r; };
            const MeshReport report = measure(extracted(sampled(ball, int(r) + 6)));
            expectClosed(report);
            EXPECT_EQ(report.eulerCharacteristic, 2);
            const double error = report.volume / (4 * kPi / 3 * r * r * r) - 1;
            EXPECT_LT(std::abs(error), 0.4 / (r * r * r) + 0.05 / (r * r))
                << r << " voxels about " << center;
        }
}

TEST(ExtractMesh, KeepsATorussGenus)
{
    const auto torus = [](const Vec3d& p) {
        return std::hypot(std::hypot(p.x(), p.y()) - 18.3, p.z()) - 7.1;
    };
    const MeshReport report = measure(extracted(sampled(torus, 30)));
    expectClosed(report);
    EXPECT_EQ(report.eulerCharacteristic, 0);
    EXPECT_EQ(report.components, 1u);
    EXPECT_NEAR(report.area / (4 * kPi * kPi * 18.3 * 7.1), 1, 0.01);
    EXPECT_NEAR(report.volume / (2 * kPi * kPi * 18.3 * 7.1 * 7.1), 1, 0.01);
}

TEST(ExtractMesh, IsManifoldWhereverSignsFall)
{
    // Every ambiguous configuration of a cell, many times.
    test::Random random(1);
    const MeshReport report = measure(extracted(test::randomLevelSet(24, random)));
    EXPECT_GT(report.triangles, 30000u);
    EXPECT_EQ(report.boundaryEdges, 0u);
    EXPECT_EQ(report.nonManifoldEdges, 0u);
}

/// Inside voxels of a wall of one voxel that is turned touch at edges only, and the outside's do in
/// a gap: the values tell which is whole.
TEST(ExtractMesh, KeepsTurnedWallsAndGapsOfOneVoxelAndMoreWhole)
{
    test::Random random(7);
    for (const double thick : {1.0, 1.2, 1.5, 2.0, 3.0})
        for (int n = 0; n < 4; ++n) {
            const Eigen::AngleAxisd turn(random.uniform(0, kPi), random.direction());
            const Vec3d half(12, 12, thick / 2);
            const auto wall = [&](const Vec3d& p) { return test::boxDistance(turn * p, half); };
            const MeshReport report = measure(extracted(sampled(wall, 22)));
            EXPECT_EQ(report.eulerCharacteristic, 2) << thick << " turn " << n;
            // A vertex is a twentieth of a voxel off at most in the mean, on either side.
            EXPECT_NEAR(report.volume / (8 * half.prod()), 1, 0.1 / thick) << " turn " << n;
            const auto gap = [&](const Vec3d& p) {
                return std::max(p.norm() - 12, -test::boxDistance(turn * p, {40, 40, thick / 2}));
            };
            const MeshReport halves = measure(extracted(sampled(gap, 18)));
            EXPECT_EQ(halves.components, 2u) << thick << " turn " << n;
            EXPECT_EQ(halves.eulerCharacteristic, 4) << thick << " turn " << n;
        }
}

/// Beside a flat face of a thin wall along the lattice the values between two voxels are no
/// distances, but those beyond them are.
TEST(ExtractMesh, PutsFacesOfThinWallsInPlace)
{
    test::Random random(8);
    for (const double thick : {1.0, 1.1, 1.25, 1.4, 1.75, 2.5})
        for (int n = 0; n < 6; ++n) {
            const Vec3d half(10, 10, thick / 2), center = random.inCube(1);
            const Mesh mesh = extracted(
                sampled([&](const Vec3d& p) { return test::boxDistance(p - center, half); }, 16));
            for (std::uint32_t v = 0; v < mesh.positions.size(); ++v) {
                const Vec3d p = mesh.world(v) - center;
                if (p.head<2>().cwiseAbs().maxCoeff() < 8) {
                    EXPECT_NEAR(std::abs(p.z()), thick / 2, 1e-4) << thick << " at " << center;
                }
            }
        }
}

/// No triangle is flat: twice its area is a thousandth of its longest side squared or more, and so
/// is the sine of its smallest angle.
void expectArea(const MeshReport& report)
{
    EXPECT_GT(report.triangles, 100u);
    EXPECT_GE(std::sin(report.smallestAngle * M_PI / 180), 0.999e-3);
}

TEST(ExtractMesh, HasNoFlatTrianglesWhereTheSurfacePassesThroughVoxels)
{
    // Eight cells find their vertex where the value is next to nothing.
    std::mt19937_64 random(1);
    auto grid = FloatGrid::create(3);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    auto accessor = grid->getAccessor();
    constexpr std::array<float, 5> kValues = {-1, -1e-7f, 0, 1e-7f, 1};
    constexpr int kEdge = 20;
    for (int x = 0; x <= kEdge; ++x)
        for (int y = 0; y <= kEdge; ++y)
            for (int z = 0; z <= kEdge; ++z) {
                const auto ends = [](int i) { return i == 0 || i == kEdge; };
                const bool border = ends(x) || ends(y) || ends(z);
                accessor.setValue({x, y, z}, border ? 1 : kValues[random() % kValues.size()]);
            }
    const MeshReport report = measure(extracted(LevelSet(grid)));
    EXPECT_EQ(report.boundaryEdges + report.nonManifoldEdges, 0u);
    expectArea(report);
}

TEST(ExtractMesh, HasNoFlatTrianglesWhereVerticesLieInLine)
{
    // An octahedron with its edges along the diagonals of voxels' faces.
    const auto values = [](const Vec3d& p) { return (p.cwiseAbs().sum() - 5) / std::sqrt(3.0); };
    expectArea(measure(extracted(sampled(values, 9))));
}

TEST(ExtractMesh, FacesOutwards)
{
    const Mesh mesh = extracted(sphere(1, 0.1));
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        EXPECT_GT((b - a).cross(c - a).dot(a + b + c), 0);
    }
}

TEST(ExtractMesh, LiesOnTheSurfaceWhereValuesAreNoDistances)
{
    // Other programs write such bands: a ball whose values rise by 1 to 1.8 per voxel.
    const auto values = [](const Vec3d& p) {
        return (p.norm() - 30) * (1.4 + 0.4 * std::sin(0.1 * p[0] + 0.03 * p[1]));
    };
    const Mesh mesh = extracted(sampled(values, 34));
    expectClosed(measure(mesh));
    double farthest = 0;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v)
        farthest = std::max(farthest, std::abs(mesh.world(std::uint32_t(v)).norm() - 30));
    // Planes through the values about a voxel are off where the slope changes within it: by 0.04.
    EXPECT_LT(farthest, 0.1);
}

TEST(ExtractMesh, LosesNothingFarAway)
{
    const double h = 0.01;
    // Far by the transform, as latticeFor() puts it, and far by the indices of a foreign grid.
    const Vec3d far(5e6, -5e6, 5e6);
    const Mesh near = extracted(sphere(1, h));
    const Mesh moved = extracted(sphere(1, h, openvdb::Vec3d(far.x(), far.y(), far.z())));
    ASSERT_EQ(moved.positions.size(), near.positions.size());
    EXPECT_EQ(moved.triangles, near.triangles);
    EXPECT_EQ(std::memcmp(moved.positions.data(), near.positions.data(),
                          near.positions.size() * sizeof(Vec3f)),
              0);
    EXPECT_LT((moved.frame - near.frame - far).norm(), 1e-8);

    const Vec3d center(1 << 20, 0, 0);
    const auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(
        20, openvdb::Vec3f(float(center.x()), 0, 0), 1);
    const Mesh indexed = extracted(LevelSet(grid));
    double worst = 0;
    for (std::size_t i = 0; i < indexed.positions.size(); ++i)
        worst = std::max(worst, std::abs((indexed.world(i) - center).norm() - 20));
    EXPECT_LT(worst, 0.02);
}

TEST(ExtractMesh, IsTheSameForAnyNumberOfThreads)
{
    const LevelSet levelSet = sphere(1, 0.02);
    const Mesh first = extracted(levelSet);
    for (const std::size_t threads : {1, 2, 8}) {
        tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        const Mesh mesh = extracted(levelSet);
        ASSERT_EQ(mesh.positions.size(), first.positions.size());
        EXPECT_EQ(std::memcmp(mesh.positions.data(), first.positions.data(),
                              first.positions.size() * sizeof(Vec3f)),
                  0);
        EXPECT_EQ(mesh.triangles, first.triangles);
        EXPECT_EQ(measure(mesh).area, measure(first).area);
        EXPECT_EQ(measure(mesh).volume, measure(first).volume);
    }
}

TEST(ExtractMesh, OfNothingIsNothing)
{
    const auto grid = FloatGrid::create(3);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    const Mesh mesh = extracted(LevelSet(grid));
    EXPECT_TRUE(mesh.positions.empty());
    EXPECT_TRUE(mesh.triangles.empty());
    const MeshReport report = measure(mesh);
    EXPECT_EQ(report.components, 0u);
    EXPECT_EQ(report.eulerCharacteristic, 0);
    EXPECT_EQ(report.area, 0);
}

TEST(ExtractMesh, LeavesItsInputAloneAndStops)
{
    const LevelSet levelSet = sphere(1, 0.1, openvdb::Vec3d(1, 2, 3));
    const auto before = levelSet.grid().deepCopy();
    extracted(levelSet);
    EXPECT_EQ(levelSet.grid().transform(), before->transform());
    EXPECT_TRUE(levelSet.grid().tree().hasSameTopology(before->tree()));
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(extractMesh(levelSet, {}, &progress), Interrupted);
}

/// A tetrahedron about the origin, outward.
Mesh tetrahedron()
{
    Mesh mesh;
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    return mesh;
}

TEST(MeasureMesh, KnowsATetrahedron)
{
    const MeshReport report = measure(tetrahedron());
    expectClosed(report);
    EXPECT_EQ(report.vertices, 4u);
    EXPECT_EQ(report.triangles, 4u);
    EXPECT_EQ(report.components, 1u);
    EXPECT_EQ(report.eulerCharacteristic, 2);
    EXPECT_DOUBLE_EQ(report.volume, 1.0 / 6);
    EXPECT_DOUBLE_EQ(report.area, 1.5 + std::sqrt(3.0) / 2);
}

TEST(MeasureMesh, CountsWhatIsWrong)
{
    Mesh open = tetrahedron();
    open.triangles.pop_back();
    EXPECT_EQ(measure(open).boundaryEdges, 3u);
    EXPECT_EQ(measure(open).nonManifoldEdges, 0u);
    EXPECT_EQ(measure(open).eulerCharacteristic, 1);

    Mesh turned = tetrahedron();
    std::swap(turned.triangles[3][0], turned.triangles[3][1]);
    EXPECT_EQ(measure(turned).boundaryEdges, 0u);
    EXPECT_EQ(measure(turned).nonManifoldEdges, 3u);

    Mesh fin = tetrahedron();
    fin.positions.push_back({2, 2, 2});
    fin.triangles.push_back({0, 1, 4});
    EXPECT_EQ(measure(fin).boundaryEdges, 2u);
    EXPECT_EQ(measure(fin).nonManifoldEdges, 1u);
}

TEST(MeasureMesh, CountsComponentsOfUsedVertices)
{
    Mesh two = tetrahedron();
    two.positions.push_back({9, 9, 9}); // unused
    const auto base = std::uint32_t(two.positions.size());
    const Mesh other = tetrahedron();
    for (const Vec3f& p : other.positions) two.positions.push_back(p + Vec3f(5, 0, 0));
    for (const Mesh::Triangle& t : other.triangles)
        two.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
    const MeshReport report = measure(two);
    EXPECT_EQ(report.components, 2u);
    EXPECT_EQ(report.eulerCharacteristic, 4);
    EXPECT_EQ(report.vertices, 9u);
    EXPECT_NEAR(report.volume, 2.0 / 6, 1e-12);
}

} // namespace
} // namespace mpuvdb
