// Meshes of tiles: the mesh of the whole, byte for byte.
#include "farm_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <tbb/global_control.h>

#include <cstring>

namespace mpuvdb::test
{
namespace
{

template <typename T>
bool sameBytes(const std::vector<T>& a, const std::vector<T>& b)
{
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

class TileMeshTest : public JobFixture
{
protected:
    /// As mpuvdb reconstruct --mesh makes it.
    static Mesh wholeMesh(const PointCloud& cloud, const ReconstructOptions& options)
    {
        const ReconstructResult made = sampleFit(fitPoints(prepared(cloud, options)));
        Mesh mesh = extractMesh(made.levelSet(), {made.field.get(), false});
        if (!options.attributes.empty())
            addAttributes(mesh, *made.field->attributes(options.attributes));
        return mesh;
    }

    void expectSame(const PointCloud& cloud, const ReconstructOptions& options) const
    {
        const Job job(done(cloud, options), kBuild);
        EXPECT_GE(job.tasks(), 8u);
        const Mesh mesh = job.mesh(), whole = wholeMesh(cloud, options);
        EXPECT_GT(whole.triangles.size(), 1000u);
        EXPECT_EQ(mesh.frame, whole.frame);
        EXPECT_TRUE(sameBytes(mesh.positions, whole.positions));
        EXPECT_TRUE(sameBytes(mesh.triangles, whole.triangles));
        EXPECT_TRUE(sameBytes(mesh.colors, whole.colors));
        const MeshReport report = measure(mesh);
        EXPECT_EQ(report.boundaryEdges, 0u);
        EXPECT_EQ(report.nonManifoldEdges, 0u);
        writeMesh(at("tiles.ply"), mesh);
        writeMesh(at("whole.ply"), whole);
        EXPECT_TRUE(bytesOf(at("tiles.ply")) == bytesOf(at("whole.ply")));
    }
};

/// Creases and corners, where triangles fold over and vertices are retracted in rounds.
TEST_F(TileMeshTest, OfExactPoints)
{
    expectSame(
        randomScan("rotate(difference(box(2, 1.5, 1), cylinder(0.4, 3)), 1, 2, 3, 25)", 40000),
        voxelSize(0.009));
}

TEST_F(TileMeshTest, OfNoisyPointsWithColors)
{
    ScanSettings scan = scanSettings(30000);
    scan.noise = 0.01;
    PointCloud cloud = scanOf("torus(1, 0.4)", scan);
    for (const Vec3f& p : cloud.positions)
        cloud.colors.push_back({std::uint8_t(100 + 50 * p[0]), std::uint8_t(100 + 50 * p[1]), 7});
    ReconstructOptions options = voxelSize(0.012);
    options.attributes = {kColorName};
    expectSame(cloud, options);
}

TEST_F(TileMeshTest, OfPointsOfOneSide)
{
    ScanSettings scan = scanSettings(30000);
    scan.pattern = ScanSettings::Pattern::Scan;
    scan.viewpoints = {Vec3d(3, 4, 2)};
    expectSame(scanOf("difference(box(2, 1.5, 1), cylinder(0.4, 3))", scan), voxelSize(0.011));
}

TEST_F(TileMeshTest, OfPointsWithHoles)
{
    ScanSettings scan = scanSettings(30000);
    scan.holes = 6;
    scan.holeRadius = 0.15;
    scan.noise = 0.004;
    expectSame(scanOf("blob(1, 20, 0.05)", scan), voxelSize(0.011));
}

/// Bands of 1.5 voxels: cells have voxels beside all leaves.
TEST_F(TileMeshTest, OfNarrowBands)
{
    ReconstructOptions options = voxelSize(0.012);
    options.halfWidth = 1.5;
    expectSame(randomScan("rotate(box(1.4, 1.2, 1), 1, 2, 3, 40)", 20000), options);
}

/// Until no triangles cross, in the rounds of the whole, too.
TEST_F(TileMeshTest, Strict)
{
    const PointCloud cloud = randomScan(
        "difference(difference(union(difference(box(1.19, 1.31, 1.06), translate(rotate("
        "cylinder(0.58, 0.29), 1, -0.08, -0.42, 100.7), -0.39, -0.02, -0.4)), translate(rotate("
        "box(0.23, 0.73, 0.72), 1, -0.22, -0.64, 112.8), -0.23, 0.18, -0.44)), translate(rotate("
        "cylinder(0.21, 1.21), 1, -0.64, -0.95, 18.8), -0.46, -0.25, -0.14)), translate(rotate("
        "box(0.94, 0.64, 0.94), 1, -0.51, -0.29, 171.2), -0.02, 0.24, -0.22))",
        40000);
    const ReconstructOptions options = voxelSize(0.05);
    const Job job(done(cloud, options), kBuild);
    EXPECT_GE(job.tasks(), 8u);
    EXPECT_FALSE(findSelfIntersections(job.mesh()).empty());
    const Mesh mesh = job.mesh(0, true);
    const ReconstructResult made = sampleFit(fitPoints(prepared(cloud, options)));
    const Mesh whole = extractMesh(made.levelSet(), {made.field.get(), true});
    EXPECT_TRUE(sameBytes(mesh.positions, whole.positions));
    EXPECT_TRUE(sameBytes(mesh.triangles, whole.triangles));
    EXPECT_TRUE(findSelfIntersections(mesh).empty());
    EXPECT_EQ(job.voxelSize(), made.levelSet().voxelSize());
    EXPECT_EQ(job.diagonal(), job.voxelSize() * made.grid->evalActiveVoxelDim().asVec3d().length());
}

TEST_F(TileMeshTest, DoesNotDependOnTheThreads)
{
    const PointCloud cloud = randomScan("difference(box(2, 1.5, 1), cylinder(0.4, 3))", 20000);
    const Job job(done(cloud, voxelSize(0.012)), kBuild);
    const Mesh many = job.mesh();
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const Mesh alone = job.mesh();
    EXPECT_TRUE(sameBytes(many.positions, alone.positions));
    EXPECT_TRUE(sameBytes(many.triangles, alone.triangles));
    EXPECT_THROW(job.mesh(1000), LimitError);
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(job.mesh(0, false, &stopped), Interrupted);
}

} // namespace
} // namespace mpuvdb::test
