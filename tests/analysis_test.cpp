// Normals, curvature and thickness as grids, and deviations between surfaces.
#include "solid_level_set.h"

#include <mpuvdb/analysis.h>
#include <mpuvdb/mesh.h>

#include <cmath>

namespace mpuvdb::test
{
namespace
{

template <class GridType>
typename GridType::ConstPtr named(const openvdb::GridCPtrVec& grids, const std::string& name)
{
    for (const auto& grid : grids)
        if (grid->getName() == name) return openvdb::gridConstPtrCast<GridType>(grid);
    return nullptr;
}

TEST(AnalysisTest, OfABallAllIsItsRadius)
{
    constexpr double kVoxel = 0.05; // the radius is 20 voxels
    const LevelSet ball = solidLevelSet("sphere(1)", kVoxel);
    const auto grids = analyze(ball);
    const auto curvature = named<openvdb::FloatGrid>(grids, "curvature");
    const auto thickness = named<openvdb::FloatGrid>(grids, "thickness");
    const auto normals = named<openvdb::Vec3SGrid>(grids, "normals");
    ASSERT_TRUE(curvature && thickness && normals);
    for (auto voxel = ball.grid().cbeginValueOn(); voxel; ++voxel) {
        const openvdb::Coord at = voxel.getCoord();
        const openvdb::Vec3d p = ball.grid().indexToWorld(at);
        // Second differences leave (voxel size / radius)^2 of the curvature, times four or so.
        ASSERT_NEAR(curvature->tree().getValue(at), 1, 5 * kVoxel * kVoxel);
        // measure() promises two percent.
        ASSERT_NEAR(thickness->tree().getValue(at), 2, 0.04);
        const openvdb::Vec3d normal(normals->tree().getValue(at));
        ASSERT_NEAR(normal.dot(p / p.length()), 1, kVoxel * kVoxel);
    }
    EXPECT_EQ(curvature->activeVoxelCount(), ball.grid().activeVoxelCount());
}

TEST(AnalysisTest, ThicknessIsThatOfTheWall)
{
    const LevelSet wall = solidLevelSet("box(2,2,0.4)", 0.05);
    const auto grids = analyze(wall, {false, false, true});
    ASSERT_EQ(grids.size(), 1u);
    const auto thickness = named<openvdb::FloatGrid>(grids, "thickness");
    const auto at = [&](double x, double y, double z) {
        return double(
            thickness->tree().getValue(openvdb::Coord::round(wall.grid().worldToIndex({x, y, z}))));
    };
    EXPECT_NEAR(at(0, 0, 0.2), 0.4, 0.02 * 0.4);
    EXPECT_NEAR(at(0.3, -0.4, -0.2), 0.4, 0.02 * 0.4);
}

/// Where the surface goes through a voxel, the voxel's edges cross it in one place: a ball between
/// two of these has no radius.
TEST(AnalysisTest, ThicknessIsThatOfTheWallOnVoxels)
{
    const LevelSet ball = solidLevelSet("difference(sphere(1),sphere(0.8))", 0.05);
    const auto thickness =
        named<openvdb::FloatGrid>(analyze(ball, {false, false, true}), "thickness");
    for (auto voxel = thickness->cbeginValueOn(); voxel; ++voxel)
        ASSERT_NEAR(*voxel, 0.2, 0.05 * 0.2) << voxel.getCoord();
}

TEST(AnalysisTest, TheSameOnAnyThreads)
{
    const LevelSet part = solidLevelSet("difference(box(2,2,1),cylinder(0.4,3))", 0.05);
    for (const char* const name : {"curvature", "thickness"})
        expectSameOnAnyThreads([&] { return named<openvdb::FloatGrid>(analyze(part), name); });
}

TEST(AnalysisTest, AnEmptyLevelSetHasEmptyGrids)
{
    for (const auto& grid : analyze(emptyLevelSet(0.1))) EXPECT_TRUE(grid->empty());
}

TEST(AnalysisTest, DeviationsHaveASide)
{
    constexpr double kVoxel = 0.1;
    const Mesh small = extractMesh(solidLevelSet("sphere(1)", kVoxel));
    const Mesh large = extractMesh(solidLevelSet("sphere(1.3)", kVoxel));
    // Triangles of an edge of sqrt(2) voxels lie inside a sphere by at most their sagitta.
    const double sagitta = 2 * kVoxel * kVoxel / 8;
    for (const float d : deviation(small, large)) ASSERT_NEAR(double(d), -0.3, 2 * sagitta);
    for (const float d : deviation(large, small)) ASSERT_NEAR(double(d), 0.3, 2 * sagitta);
    for (const float d : deviation(small, small)) ASSERT_EQ(std::abs(d), 0.0f);
}

TEST(AnalysisTest, DeviationsFromPointsAreThoseToTheNearest)
{
    const Mesh mesh = extractMesh(solidLevelSet("sphere(1)", 0.1));
    PointCloud points;
    points.positions = {Vec3f(3, 0, 0), Vec3f(-3, 0, 0)};
    const auto deviations = deviation(mesh, points);
    for (std::size_t v = 0; v < deviations.size(); ++v) {
        const Vec3d p = mesh.world(v);
        const double exact = std::min((p - Vec3d(3, 0, 0)).norm(), (p + Vec3d(3, 0, 0)).norm());
        ASSERT_NEAR(double(deviations[v]), exact, 1e-5);
    }
}

TEST(AnalysisTest, RefusesNothingToCompareWith)
{
    const Mesh mesh = extractMesh(solidLevelSet("sphere(1)", 0.2));
    EXPECT_THROW(deviation(mesh, Mesh()), UsageError);
    EXPECT_THROW(deviation(mesh, PointCloud()), UsageError);
}

} // namespace
} // namespace mpuvdb::test
