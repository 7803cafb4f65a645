// What came out, held against the points that came in.
#include "case_files.h"
#include "closed_parts.h"
#include "field_fixture.h"
#include "thin_to.h"
#include "uncleaned.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>

#include "sampling/count_parts.h"
#include "sampling/solid_blocks.h"
#include "surface/diagonal_links.h"

#include <gtest/gtest.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <functional>
#include <map>

namespace mpuvdb
{
namespace
{

using test::Random;

PointCloud cleaned(PointCloud cloud, PointStatistics& statistics)
{
    Interrupter progress;
    statistics = clean(cloud, {}, &progress).statistics;
    return cloud;
}

/// As the command does it, by default options.
PointsExplained explained(PointCloud cloud, double voxelSize = 0)
{
    ReconstructOptions options;
    if (voxelSize > 0) options.voxelSize = Length{voxelSize, Length::Unit::World};
    return reconstruct(std::move(cloud), options).report.explained;
}

PointCloud sample(const std::string& solid, std::uint64_t points, double noise = 0)
{
    ScanSettings s;
    s.points = points;
    s.noise = noise;
    Interrupter progress;
    return scan(*parseSolid(solid), s, &progress);
}

// --- What is sound is not told of

TEST(PointsExplained, NothingIsToldOfSoundSamples)
{
    const char* const solids[] = {"sphere(1)",
                                  "torus(1,0.3)",
                                  "box(2,1.5,1)",
                                  "blob(1,8,0.1)",
                                  "difference(box(2,2,1), cylinder(0.4,3))",
                                  "box(2,2,0.05)"};
    for (const char* solid : solids)
        for (const double noise : {0.0, 0.003}) {
            SCOPED_TRACE(testing::Message() << solid << ", noise " << noise);
            const PointsExplained e = explained(sample(solid, 10000, noise));
            // Normal noise: 0.3 % are beyond three deviations.
            EXPECT_GT(e.within, 0.99);
            EXPECT_LE(e.largest, 1.5 * e.limit);
            EXPECT_TRUE(e.findings.empty()) << e.findings.front();
            EXPECT_EQ(e.parts, 1u);
            EXPECT_EQ(e.cavities, 0u);
        }
}

// However thick noise is beside the spacing, a surface in it is no solid.
TEST(PointsExplained, ThickNoiseIsNoSolid)
{
    const std::pair<const char*, double> samples[] = {
        {"sphere(1)", 0.06}, {"torus(1,0.4)", 0.06}, {"box(2,2,2)", 0.06}, {"torus(1,0.4)", 0.02}};
    for (const auto& [solid, noise] : samples) {
        Interrupter progress;
        const PointStatistics statistics = measure(sample(solid, 60000, noise), &progress);
        EXPECT_FALSE(statistics.fillSolid) << solid << ", noise " << noise;
        EXPECT_NEAR(statistics.noise, noise, 0.3 * noise);
    }
}

TEST(PointsExplained, NumbersAreThoseOfTheSolid)
{
    const PointsExplained e = explained(sample("sphere(1)", 20000), 0.03);
    EXPECT_EQ(e.points, 20000u);
    // Places on facets of edge h sag by h^2 / 8, twice over the two axes.
    EXPECT_NEAR(e.volume, 4 * M_PI / 3, 4 * M_PI * 0.03 * 0.03 / 4);
    EXPECT_NEAR(e.area, 4 * M_PI, 0.02 * 4 * M_PI);
    EXPECT_EQ(e.unsupported, 0);
    EXPECT_EQ(e.against, 0);
}

TEST(PointsExplained, SamplesOfAHalfAreSupportedByHalf)
{
    PointCloud cloud = sample("sphere(1)", 40000);
    std::vector<std::uint8_t> keep;
    for (std::size_t i = 0; i < cloud.size(); ++i) keep.push_back(cloud.world(i)[2] > 0);
    cloud.compact(keep);
    const PointsExplained e = explained(std::move(cloud));
    EXPECT_GT(e.unsupported, 0.2); // the disc that closes it: a third, without its rim
    EXPECT_LT(e.unsupported, 0.5);
    EXPECT_TRUE(e.findings.empty());
}

/// Normals that are none of the points: one for all, directions of view, no signs.
TEST(PointsExplained, NormalsThatAreNoneAreToldOf)
{
    using Turn = Vec3f (*)(const Vec3f& position, const Vec3f& normal);
    const Turn turns[] = {
        [](const Vec3f&, const Vec3f&) -> Vec3f { return Vec3f::UnitZ(); },
        [](const Vec3f&, const Vec3f&) -> Vec3f { return Vec3f(0.3f, -0.5f, 0.8f).normalized(); },
        [](const Vec3f& p, const Vec3f&) -> Vec3f { return (Vec3f(4, 0, 0) - p).normalized(); },
        [](const Vec3f&, const Vec3f& n) -> Vec3f { return n.cwiseAbs(); }};
    for (const char* const solid : {"sphere(1)", "torus(1,0.4)", "union(sphere(1),box(2.2,1,1))"})
        for (const Turn turn : turns) {
            PointCloud cloud = sample(solid, 20000);
            for (std::size_t n = 0; n < cloud.size(); ++n)
                cloud.normals[n] = turn(cloud.positions[n], cloud.normals[n]);
            const PointsExplained e = explained(std::move(cloud));
            EXPECT_GT(e.against, 0.1875) << solid; // a quarter of random directions'
            ASSERT_FALSE(e.findings.empty()) << solid;
            EXPECT_NE(e.findings.back().find("--normals estimate"), std::string::npos);
        }
}

TEST(PointsExplained, OneThreadAndManySayTheSame)
{
    const auto numbers = [] {
        const PointsExplained e = explained(sample("torus(1,0.3)", 30000, 0.002));
        return std::vector<double>{e.within, e.largest, e.against, e.unsupported, e.volume, e.area};
    };
    const std::vector<double> many = numbers();
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(numbers(), many);
}

TEST(PointsExplained, NothingIsToldOfRealScans)
{
    const char* const data = std::getenv("MPUVDB_DATA_DIR");
    if (!data) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    const std::vector<std::string> sound = {"clouds/1.2-with-color.ptx",
                                            "clouds/armadillo_inward_normals.xyz",
                                            "clouds/autzen-thin.las",
                                            "clouds/bimba_no_normals.ply",
                                            "clouds/building.ply",
                                            "clouds/bun0.pcd",
                                            "clouds/hippo2.ply",
                                            "clouds/igea.ply",
                                            "clouds/kitten.xyz",
                                            "clouds/milk_color.pcd",
                                            "clouds/mvk-thin.las",
                                            "clouds/samp52-utm.pcd",
                                            "berger/anchor.off",
                                            "berger/anchor_scan.ply",
                                            "berger/dc.off",
                                            "berger/dc_scan.ply",
                                            "cad/fandisk2.sampled.pts",
                                            "cad/fandisk_large.off",
                                            "cad/rocker-arm.obj",
                                            "bunny/bun.conf",
                                            "bunny/bun_zipper.ply",
                                            "bunny/bun000.ply",
                                            "dragon_stand/dragonStandRight.conf"};
    Interrupter progress;
    for (const std::string& name : sound) {
        SCOPED_TRACE(name);
        const std::filesystem::path file = std::string(data) + "/" + name;
        PointCloud cloud = readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud;
        if (!cloud.mesh) test::thinTo(cloud, 50000);
        const PointsExplained e = explained(std::move(cloud));
        EXPECT_TRUE(e.findings.empty()) << e.findings.front();
    }
}

// --- What is bad is

/// A cloud about the origin, without normals.
PointCloud cloudOf(std::vector<Vec3f> positions)
{
    PointCloud cloud;
    cloud.positions = std::move(positions);
    return cloud;
}

// A handful of points says nothing of a solid; scans from one side say enough.
TEST(PointsExplained, SurfacesThatLeaveThePointsAreTold)
{
    for (const std::size_t count : {4u, 5u, 8u}) {
        PointCloud cloud;
        for (std::size_t n = 0; n < count; ++n) {
            const double z = 1 - (2 * double(n) + 1) / double(count), r = std::sqrt(1 - z * z),
                         turn = M_PI * (3 - std::sqrt(5.0)) * double(n);
            cloud.positions.push_back(
                Vec3d(r * std::cos(turn), r * std::sin(turn), z).cast<float>());
        }
        const PointsExplained e = explained(cloud);
        ASSERT_FALSE(e.findings.empty()) << count;
        EXPECT_NE(e.findings.back().find("beyond the points"), std::string::npos);
    }
    for (const char* solid : {"sphere(1)", "torus(1,0.4)", "box(2,2,0.05)", "gear(12,1,0.5)"}) {
        ScanSettings s;
        s.points = 10000;
        s.pattern = ScanSettings::Pattern::Scan;
        s.viewpoints = {Vec3d(1, 0, 5)};
        Interrupter progress;
        const PointsExplained e = explained(scan(*parseSolid(solid), s, &progress));
        EXPECT_TRUE(e.findings.empty()) << solid << ": " << e.findings.front();
    }
}

TEST(PointsExplained, ThePointsOfASolidAreTold)
{
    const auto ball = [](const Vec3d& p) { return p.norm() < 1; };
    const auto ring = [](const Vec3d& p) {
        return std::hypot(std::hypot(p[0], p[1]) - 1, p[2]) < 0.4;
    };
    const auto block = [](const Vec3d& p) {
        return (p.array().abs() < Eigen::Array3d(1.2, 0.7, 0.4)).all();
    };
    Random random(34);
    std::vector<Vec3f> filled;
    std::size_t kind = 0;
    for (const std::function<bool(const Vec3d&)>& solid :
         {std::function<bool(const Vec3d&)>(ball), {ring}, {block}}) {
        // Centers of voxels, some jittered, and particles at random.
        std::vector<Vec3f> centers, jittered, particles;
        const double h = 0.09;
        for (int x = -20; x <= 20; ++x)
            for (int y = -20; y <= 20; ++y)
                for (int z = -20; z <= 20; ++z) {
                    const Vec3d p = h * Vec3d(x, y, z);
                    if (!solid(p)) continue;
                    centers.push_back(p.cast<float>());
                    const Vec3d by(random.uniform(-1, 1), random.uniform(-1, 1),
                                   random.uniform(-1, 1));
                    jittered.push_back((p + 0.3 * h * by).cast<float>());
                }
        while (particles.size() < 12000) {
            const Vec3d p(random.uniform(-1.5, 1.5), random.uniform(-1.5, 1.5),
                          random.uniform(-1.5, 1.5));
            if (solid(p)) particles.push_back(p.cast<float>());
        }
        const std::array all{cloudOf(centers), cloudOf(jittered), cloudOf(particles)};
        Interrupter progress;
        for (const PointCloud& cloud : all)
            EXPECT_TRUE(measure(cloud, &progress).fillSolid) << cloud.size();
        // Nor do the normals that are estimated say otherwise: of each kind of points once.
        PointStatistics statistics;
        cleaned(all[kind++], statistics);
        EXPECT_TRUE(statistics.fillSolid) << kind;
        filled = centers;
    }
    // What was found is told whatever the solid.
    const PointsExplained e = explained(cloudOf(filled));
    ASSERT_EQ(e.findings.size(), 1u);
    EXPECT_NE(e.findings[0].find("fill a solid"), std::string::npos);
}

TEST(PointsExplained, TheCaseOfFilledVoxelsIsTold)
{
    MPUVDB_CASE(file, "T06-filled-ball-voxel-centres.xyz");
    Interrupter progress;
    const PointsExplained e =
        explained(readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud);
    ASSERT_EQ(e.findings.size(), 1u);
    EXPECT_NE(e.findings[0].find("fill a solid"), std::string::npos);
}

/// So many points of a ball of radius 1, and of one that lies between voxels of 0.2.
PointCloud largeAndSmallBall(std::uint64_t ofLarge, std::uint64_t ofSmall)
{
    PointCloud both = sample("sphere(1)", ofLarge);
    const PointCloud small = sample("sphere(0.06)", ofSmall);
    for (std::size_t i = 0; i < small.size(); ++i) {
        const Vec3d p = small.world(i) + Vec3d(0.1, 0.1, 3.1) - both.frame;
        both.positions.push_back(p.cast<float>());
        both.normals.push_back(small.normals[i]);
    }
    return both;
}

// A ball between the voxels leaves no surface near its points.
TEST(PointsExplained, PartsThinnerThanAVoxelAreTold)
{
    const PointCloud both = largeAndSmallBall(5000, 5000);
    const PointsExplained coarse = explained(both, 0.2);
    ASSERT_EQ(coarse.findings.size(), 1u);
    EXPECT_NEAR(coarse.within, 0.5, 0.2);
    EXPECT_TRUE(explained(both, 0.02).findings.empty());
}

// One in thirty points, all of another part.
TEST(PointsExplained, APartThatIsLostIsToldThoughItsPointsAreFew)
{
    const PointCloud both = largeAndSmallBall(29000, 1000);
    const PointsExplained coarse = explained(both, 0.2);
    ASSERT_EQ(coarse.findings.size(), 1u);
    EXPECT_NE(coarse.findings[0].find("beyond its band"), std::string::npos);
    EXPECT_TRUE(explained(both, 0.02).findings.empty());
}

// --- Meshes whose vertices are the points

PointCloud verticesOf(const Mesh& mesh, const std::string& extension)
{
    const auto file = std::filesystem::temp_directory_path() /
                      ("mpuvdb-explained-" + std::to_string(::getpid()) + extension);
    Interrupter progress;
    writeMesh(file, mesh, {}, &progress);
    PointCloud cloud = readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud;
    std::filesystem::remove(file);
    return cloud;
}

TEST(VertexMesh, CountsWhatTheMeshIs)
{
    std::vector<Mesh> parts = {test::boxPart({0, 0, 0}, {4, 4, 4}),
                               test::boxPart({1, 1, 1}, {2, 3, 3}), test::ballPart(2, 8)};
    test::move(parts[2], Eigen::Matrix3d::Identity(), Vec3d(20, 0, 0));
    test::turnInward(parts[1]);
    for (const char* extension : {".stl", ".obj", ".ply", ".off"}) {
        // A soup: PLY, OBJ and OFF keep a vertex for each corner.
        const PointCloud cloud = verticesOf(test::soupOf(parts), extension);
        ASSERT_TRUE(cloud.mesh) << extension;
        EXPECT_TRUE(cloud.mesh->isClosed);
        EXPECT_NEAR(cloud.mesh->volume, 64 - 4 + 32 * M_PI / 3, 1.5);
        EXPECT_NEAR(cloud.mesh->area, 96 + 16 + 16 * M_PI, 2);
        EXPECT_EQ(cloud.mesh->parts, 2u) << extension;
        EXPECT_EQ(cloud.mesh->cavities, 1u) << extension;
    }
    Mesh open = test::boxPart({0, 0, 0}, {4, 4, 4});
    open.triangles.pop_back();
    EXPECT_FALSE(verticesOf(open, ".obj").mesh->isClosed);
}

TEST(VertexMesh, TrianglesLongerThanTheirVerticesSpacingAreRefusedByName)
{
    // A pipe of 60 sides, whose length no vertex is on: closed, and open at one side.
    Mesh pipe = test::pipePart(1, 0.8, 30, 60);
    for (const char* extension : {".stl", ".obj", ".ply"}) {
        try {
            explained(verticesOf(pipe, extension));
            ADD_FAILURE() << "taken";
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find("mpuvdb voxelize"), std::string::npos);
        }
        pipe.triangles.pop_back();
    }
    MPUVDB_CASE(file, "T05-cad-plate.stl");
    Interrupter progress;
    PointCloud cloud = readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud;
    EXPECT_THROW(reconstruct(std::move(cloud), test::Uncleaned(), &progress), InputError);
}

TEST(VertexMesh, ASurfaceThatIsNotTheMeshIsTold)
{
    // Evenly divided: its vertices show it.
    const PointsExplained sound = explained(verticesOf(test::ballPart(2, 24), ".ply"));
    EXPECT_TRUE(sound.findings.empty());
    EXPECT_EQ(sound.meshWithin, 1);
    ASSERT_TRUE(sound.mesh);
    EXPECT_NEAR(sound.volume, sound.mesh->volume, 0.02 * sound.volume);
    // A short pipe: the rims of its bore and of its outside are all that there is.
    const PointsExplained bad = explained(verticesOf(test::pipePart(1, 0.8, 1, 60), ".ply"));
    ASSERT_FALSE(bad.findings.empty());
    EXPECT_NE(bad.findings.back().find("mpuvdb voxelize"), std::string::npos);
}

// Parts that overlap or nearly touch: what is within both is no surface of the solid.
TEST(VertexMesh, PartsThatOverlapAreTold)
{
    for (const double distance : {1.0, 3.6, 6.0}) {
        Mesh other = test::ballPart(2, 40);
        test::move(other, Eigen::Matrix3d::Identity(), Vec3d(distance, 0.2, 0.1));
        const PointsExplained e =
            explained(verticesOf(test::soupOf({test::ballPart(2, 40), other}), ".ply"));
        EXPECT_EQ(e.findings.empty(), distance > 4) << distance;
        if (!e.findings.empty()) {
            EXPECT_NE(e.findings.back().find("mpuvdb voxelize"), std::string::npos);
        }
    }
}

// --- Parts and cavities

LevelSet levelSetOf(const Mesh& mesh, double voxelSize, const Vec3d& origin)
{
    SampleSettings settings;
    settings.lattice = {origin, voxelSize};
    Interrupter progress;
    return voxelize(mesh, settings, &progress);
}

PartCounts counted(const LevelSet& levelSet)
{
    Interrupter progress;
    return countParts(levelSet, SolidBlocks(levelSet, progress), progress);
}

TEST(CountParts, CavitiesSmallAndWide)
{
    // Cavities beyond the size of a leaf, of lower nodes (128 voxels) where there are tiles, and
    // about the origin, where eight upper nodes meet.
    for (const double radius : {20.0, 280.0})
        for (const Vec3d& center : {Vec3d(0, 0, 0), Vec3d(700, 300, 2000)}) {
            Mesh outer = test::ballPart(radius, 8), inner = test::ballPart(radius - 6, 8),
                 core = test::ballPart(radius / 4, 8), hole = test::ballPart(radius / 8, 8);
            test::turnInward(inner);
            test::turnInward(hole);
            std::vector<Mesh> parts = {outer, inner};
            for (Mesh& part : parts) test::move(part, Eigen::Matrix3d::Identity(), center);
            const PartCounts shell = counted(levelSetOf(test::soupOf(parts), 1, Vec3d::Zero()));
            EXPECT_EQ(shell.parts, 1u);
            EXPECT_EQ(shell.cavities, 1u);
            parts = {outer, inner, core, hole};
            for (Mesh& part : parts) test::move(part, Eigen::Matrix3d::Identity(), center);
            const PartCounts nested = counted(levelSetOf(test::soupOf(parts), 1, Vec3d::Zero()));
            EXPECT_EQ(nested.parts, 2u);
            EXPECT_EQ(nested.cavities, 2u);
        }
}

// The limit of eight voxels is for corners of larger parts: what is smaller as a whole is a part.
TEST(CountParts, SolidsOfFewVoxelsHaveParts)
{
    Mesh speck = test::ballPart(0.7, 8), other = speck;
    EXPECT_EQ(counted(levelSetOf(speck, 1, Vec3d::Zero())).parts, 1u);
    test::move(other, Eigen::Matrix3d::Identity(), Vec3d(9, 0, 0));
    EXPECT_EQ(counted(levelSetOf(test::soupOf({speck, other}), 1, Vec3d::Zero())).parts, 2u);
    const Mesh ball = test::ballPart(5, 8);
    test::move(other, Eigen::Matrix3d::Identity(), Vec3d(9, 0, 0));
    EXPECT_EQ(counted(levelSetOf(test::soupOf({ball, other}), 1, Vec3d::Zero())).parts, 1u);
}

/// Pairs of voxels.
using Links = std::multimap<int, int>;

/// Connected components of @a n^3 voxels, over faces and @a links, by flooding; that at the first
/// voxel does not count.
std::uint64_t floodedParts(const std::vector<bool>& is, int n, bool side, const Links& links)
{
    std::vector<bool> seen(is.size());
    const auto at = [&](int x, int y, int z) { return std::size_t((x * n + y) * n + z); };
    std::uint64_t parts = 0;
    for (int start = 0; start < n * n * n; ++start) {
        if (is[std::size_t(start)] != side || seen[std::size_t(start)]) continue;
        std::vector<int> open = {start};
        seen[std::size_t(start)] = true;
        std::uint64_t voxels = 0;
        while (!open.empty()) {
            const int v = open.back();
            open.pop_back();
            ++voxels;
            const auto reach = [&](std::size_t next) {
                if (is[next] != side || seen[next]) return;
                seen[next] = true;
                open.push_back(int(next));
            };
            const int c[3] = {v / n / n, v / n % n, v % n};
            for (int axis = 0; axis < 3; ++axis)
                for (const int step : {-1, 1}) {
                    int d[3] = {c[0], c[1], c[2]};
                    d[axis] += step;
                    if (d[axis] >= 0 && d[axis] < n) reach(at(d[0], d[1], d[2]));
                }
            const auto [first, last] = links.equal_range(v);
            for (auto link = first; link != last; ++link) reach(std::size_t(link->second));
        }
        parts += voxels >= 8 && start > 0;
    }
    return parts;
}

// Random balls of either side, in leaves here and there, against a flood of all voxels.
TEST(CountParts, AgreesWithAFlood)
{
    constexpr int kSide = 96;
    for (unsigned seed = 0; seed < 6; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        std::vector<bool> inside(kSide * kSide * kSide);
        for (int ball = 0; ball < 60; ++ball) {
            const double radius = random.uniform(2, 16);
            const Vec3d center(random.uniform(18, kSide - 18), random.uniform(18, kSide - 18),
                               random.uniform(18, kSide - 18));
            const Eigen::Array3i low = (center.array() - radius).floor().cast<int>(),
                                 high = (center.array() + radius).ceil().cast<int>();
            for (int x = low[0]; x <= high[0]; ++x)
                for (int y = low[1]; y <= high[1]; ++y)
                    for (int z = low[2]; z <= high[2]; ++z)
                        if ((Vec3d(x, y, z) - center).norm() < radius)
                            inside[std::size_t((x * kSide + y) * kSide + z)] = ball % 3 != 0;
        }
        const auto grid = openvdb::FloatGrid::create(3);
        grid->setGridClass(openvdb::GRID_LEVEL_SET);
        const openvdb::Coord shift(-50, -30, 100);
        for (int v = 0; v < kSide * kSide * kSide; ++v) {
            const openvdb::Coord c(v / kSide / kSide, v / kSide % kSide, v % kSide);
            bool isBorder = false;
            for (int axis = 0; axis < 3; ++axis)
                for (const int step : {-1, 1}) {
                    openvdb::Coord next = c;
                    next[axis] += step;
                    if (next[axis] < 0 || next[axis] >= kSide) continue;
                    const auto n = std::size_t((next.x() * kSide + next.y()) * kSide + next.z());
                    isBorder = isBorder || inside[n] != inside[std::size_t(v)];
                }
            if (isBorder) grid->tree().setValue(c + shift, inside[std::size_t(v)] ? -0.5f : 0.5f);
        }
        openvdb::tools::signedFloodFill(grid->tree());
        const PartCounts counts = counted(LevelSet(grid));
        Links links;
        for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf)
            DiagonalLinks(grid->tree(), 1)
                .forEach(leaf->origin(),
                         [&](const openvdb::Coord& a, const openvdb::Coord& b, bool) {
                             const auto number = [&](const openvdb::Coord& at) {
                                 const openvdb::Coord c = at - shift;
                                 return (c.x() * kSide + c.y()) * kSide + c.z();
                             };
                             links.emplace(number(a), number(b));
                             links.emplace(number(b), number(a));
                         });
        EXPECT_FALSE(links.empty());
        EXPECT_EQ(counts.parts, floodedParts(inside, kSide, true, links));
        EXPECT_EQ(counts.cavities, floodedParts(inside, kSide, false, links));
    }
}

// The inside voxels of turned plates of one voxel are many parts by faces, and their mesh is one.
TEST(CountParts, IsThatOfTheMesh)
{
    Random random(3);
    for (int n = 0; n < 6; ++n) {
        Mesh plate = test::boxPart(Vec3d(-12, -12, -0.5), Vec3d(12, 12, 0.5));
        const Eigen::AngleAxisd turn(random.uniform(0, M_PI), random.direction());
        test::move(plate, turn.toRotationMatrix(), random.inCube(1));
        const LevelSet levelSet = levelSetOf(plate, 1, Vec3d::Zero());
        EXPECT_EQ(counted(levelSet).parts, 1u) << n;
        Interrupter progress;
        EXPECT_EQ(measure(extractMesh(levelSet, {}, &progress)).components, 1u) << n;
    }
}

} // namespace
} // namespace mpuvdb
