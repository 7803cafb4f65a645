// Colors and scalars of points, on grids and on meshes.
#include "case_files.h"
#include "io_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/reconstruct.h>

#include <openvdb/tools/LevelSetSphere.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <random>
#include <utility>
#include <vector>

namespace mpuvdb::test
{
namespace
{

/// What the attributes of the test clouds are at a unit direction: linear in each, and coarse
/// beside no spacing.
Vec3f colorAt(const Vec3d& n)
{
    return Vec3f(float(0.5 + 0.4 * n[0]), float(0.5 - 0.4 * n[1]), float(0.3 + 0.2 * n[2]));
}
double heatAt(const Vec3d& n)
{
    return 100 * n[2] - 20 * n[0];
}

/// Points of a unit sphere about @a middle, in a spiral.
PointCloud sphere(std::size_t count, const Vec3d& middle)
{
    PointCloud cloud;
    cloud.frame = middle;
    NamedScalars heat{"heat", {}};
    for (std::size_t i = 0; i < count; ++i) {
        const double z = 1 - (2 * double(i) + 1) / double(count), r = std::sqrt(1 - z * z);
        const double turn = M_PI * (3 - std::sqrt(5.0)) * double(i);
        const Vec3d n(r * std::cos(turn), r * std::sin(turn), z);
        cloud.positions.push_back(n.cast<float>());
        cloud.normals.push_back(n.cast<float>());
        cloud.colors.push_back(srgbColor(colorAt(n)));
        heat.values.push_back(float(heatAt(n)));
    }
    cloud.scalars = {heat};
    return cloud;
}

test::Uncleaned settings()
{
    test::Uncleaned result;
    result.voxelSize = Length{0.04, Length::Unit::World};
    result.attributes = {"heat", kColorName};
    return result;
}

constexpr double kColorTolerance = 0.015; ///< bytes, and a mean over some spacings
constexpr double kHeatTolerance = 1.5;    ///< of +-102

TEST(AttributesTest, GridsHaveWhatTheNearestSurfaceHas)
{
    Interrupter progress;
    const Vec3d middle(1e5, -2e5, 3e4);
    const ReconstructResult made = reconstruct(sphere(20000, middle), settings(), &progress);
    const auto attributes = made.field->attributes({"heat", kColorName, "confidence"});
    ASSERT_EQ(attributes->scalarNames(), (std::vector<std::string>{"heat", "confidence"}));
    const auto grids = sampleAttributes(made.levelSet(), *attributes, &progress);
    ASSERT_EQ(grids.size(), 3u);
    const auto colors = openvdb::gridPtrCast<openvdb::Vec3SGrid>(grids[0]);
    const auto heat = openvdb::gridPtrCast<openvdb::FloatGrid>(grids[1]);
    const auto confidence = openvdb::gridPtrCast<openvdb::FloatGrid>(grids[2]);
    EXPECT_EQ(colors->getName(), "Cd");
    EXPECT_EQ(heat->getName(), "heat");
    const openvdb::Coord anywhere(7, -3, 11);
    const openvdb::Vec3d off =
        colors->indexToWorld(anywhere) - made.levelSet().grid().indexToWorld(anywhere);
    EXPECT_LT(off.length(), 1e-9);
    EXPECT_TRUE(colors->tree().hasSameTopology(made.levelSet().grid().tree()));
    double worstColor = 0, worstHeat = 0;
    for (auto voxel = colors->cbeginValueOn(); voxel; ++voxel) {
        const openvdb::Vec3d w = colors->indexToWorld(voxel.getCoord());
        const Vec3d n = (Vec3d(w[0], w[1], w[2]) - middle).normalized();
        const Vec3f found(voxel->x(), voxel->y(), voxel->z());
        worstColor = std::max(worstColor, double((found - colorAt(n)).cwiseAbs().maxCoeff()));
        const double value = double(heat->tree().getValue(voxel.getCoord()));
        worstHeat = std::max(worstHeat, std::abs(value - heatAt(n)));
        ASSERT_EQ(confidence->tree().getValue(voxel.getCoord()), 1.0f);
    }
    EXPECT_LT(worstColor, kColorTolerance);
    EXPECT_LT(worstHeat, kHeatTolerance);
}

TEST(AttributesTest, VerticesHaveWhatThePointsAboutThemHave)
{
    Interrupter progress;
    const ReconstructResult made = reconstruct(sphere(20000, Vec3d::Zero()), settings(), &progress);
    Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
    addAttributes(mesh, *made.field->attributes({kColorName, "heat"}), &progress);
    ASSERT_EQ(mesh.colors.size(), mesh.positions.size());
    ASSERT_EQ(mesh.scalars.size(), 1u);
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const Vec3d n = mesh.world(v).normalized();
        ASSERT_LT((mesh.colors[v] - colorAt(n)).cwiseAbs().maxCoeff(), kColorTolerance);
        ASSERT_NEAR(double(mesh.scalars[0].values[v]), heatAt(n), kHeatTolerance);
    }
}

TEST(AttributesTest, NeitherThreadsNorTheOrderOfPointsMatter)
{
    const auto values = [](std::size_t threads, bool turnedRound) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Interrupter progress;
        PointCloud cloud = sphere(5000, Vec3d::Zero());
        // Two points that only their attributes tell apart.
        for (std::size_t i = 0; i < 50; ++i) {
            cloud.positions[2 * i + 1] = cloud.positions[2 * i];
            cloud.normals[2 * i + 1] = cloud.normals[2 * i];
        }
        if (turnedRound) {
            std::reverse(cloud.positions.begin(), cloud.positions.end());
            std::reverse(cloud.normals.begin(), cloud.normals.end());
            std::reverse(cloud.colors.begin(), cloud.colors.end());
            std::reverse(cloud.scalars[0].values.begin(), cloud.scalars[0].values.end());
        }
        const ReconstructResult made = reconstruct(std::move(cloud), settings(), &progress);
        Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
        addAttributes(mesh, *made.field->attributes({kColorName, "heat"}), &progress);
        return mesh;
    };
    const Mesh one = values(1, false), two = values(2, true);
    ASSERT_EQ(one.colors.size(), two.colors.size());
    EXPECT_TRUE(one.colors == two.colors);
    EXPECT_EQ(one.scalars[0].values, two.scalars[0].values);
}

TEST(AttributesTest, NoValueDependsOnThePlacesBefore)
{
    Interrupter progress;
    const PointCloud cloud = sphere(3000, Vec3d::Zero());
    MpuSettings fit;
    fit.tolerance = 0.01;
    fit.voxelSize = 0.05;
    const MpuField field(PointCloud(cloud), fit, &progress);
    const auto attributes = field.attributes({"heat"}, &progress);
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(field.attributes({"heat"}, &stopped), Interrupted);
    std::vector<SurfacePlace> places;
    for (std::size_t i = 0; i < cloud.size(); i += 7) {
        const Vec3d n = cloud.normals[i].cast<double>();
        // Far off, on the surface, and the wrong way round.
        for (const double at : {3.0, 1.0, 0.98}) places.push_back({at * n, at < 1 ? Vec3d(-n) : n});
    }
    std::vector<float> together, alone;
    attributes->evaluate(places, together);
    for (std::size_t i = 0; i < places.size(); ++i) {
        attributes->evaluate({places[i]}, alone);
        ASSERT_EQ(alone[0], together[i]) << i;
    }
}

MpuField fieldOf(PointCloud cloud, double voxelSize)
{
    MpuSettings fit;
    fit.tolerance = 0.2 * voxelSize;
    fit.voxelSize = voxelSize;
    Interrupter progress;
    return MpuField(std::move(cloud), fit, &progress);
}

std::vector<float> heatOf(const MpuField& field, const std::vector<SurfacePlace>& places)
{
    std::vector<float> values;
    field.attributes({"heat"})->evaluate(places, values);
    return values;
}

/// Points of the square [-1, 1]^2 at height 0 and about @a spacing apart that face up, in no rows,
/// hot as @a heat says of their places.
template <typename F>
PointCloud sheet(double spacing, const F& heat)
{
    PointCloud cloud;
    NamedScalars hot{"heat", {}};
    std::mt19937 random(3);
    std::uniform_real_distribution<double> within(-1, 1);
    for (int n = 0; n < int(4 / (spacing * spacing)); ++n) {
        const Vec3d p(within(random), within(random), 0);
        cloud.positions.push_back(p.cast<float>());
        cloud.normals.push_back(Vec3f::UnitZ());
        hot.values.push_back(float(heat(p)));
    }
    cloud.scalars = {hot};
    return cloud;
}

TEST(AttributesTest, BlendSomePointsAboutEachPlace)
{
    constexpr unsigned kSeed = 5;
    SCOPED_TRACE(testing::Message() << "seed " << kSeed);
    std::mt19937 random(kSeed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    PointCloud cloud = sphere(3000, Vec3d::Zero());
    for (float& value : cloud.scalars[0].values) value = float(uniform(random));
    const MpuField field = fieldOf(std::move(cloud), 0.05);
    std::vector<SurfacePlace> places;
    for (int n = 0; n < 1000; ++n) {
        const Vec3d at = Vec3d(normal(random), normal(random), normal(random)).normalized();
        places.push_back({at, at});
    }
    double squares = 0;
    for (const float value : heatOf(field, places)) {
        ASSERT_GE(value, 0);
        ASSERT_LE(value, 1);
        squares += (double(value) - 0.5) * (double(value) - 0.5);
    }
    // Of n points with equal weights it would be 1 / sqrt(n).
    const double left = std::sqrt(squares / double(places.size())) * std::sqrt(12.0);
    EXPECT_GT(left, 1 / std::sqrt(16.0));
    EXPECT_LT(left, 1 / std::sqrt(6.0));
}

/// The width over which the heat of a sheet that is 1 beyond x = 0, else 0, rises from 0.1 to 0.9.
double widthOfStep(const MpuField& field, double y)
{
    std::vector<SurfacePlace> places;
    for (int n = -400; n <= 400; ++n) places.push_back({Vec3d(0.001 * n, y, 0), Vec3d::UnitZ()});
    const std::vector<float> values = heatOf(field, places);
    const auto below = [&](float limit) {
        return double(std::count_if(values.begin(), values.end(),
                                    [&](float value) { return value < limit; }));
    };
    EXPECT_FLOAT_EQ(values.front(), 0);
    EXPECT_FLOAT_EQ(values.back(), 1);
    return 0.001 * (below(0.9f) - below(0.1f));
}

TEST(AttributesTest, AreAsFineAsThePointsAreDense)
{
    for (const double spacing : {0.01, 0.04}) {
        const MpuField field =
            fieldOf(sheet(spacing, [](const Vec3d& p) { return double(p[0] > 0); }), spacing);
        EXPECT_LT(widthOfStep(field, 0.1), 4 * spacing);
    }
    // One eighth as dense beyond y = 0.
    PointCloud dense = sheet(0.01, [](const Vec3d&p) { return double(p[0] > 0); }), uneven;
    uneven.scalars = {{"heat", {}}};
    for (std::size_t n = 0; n < dense.size(); ++n) {
        if (dense.positions[n][1] > 0 && n % 64) continue;
        uneven.positions.push_back(dense.positions[n]);
        uneven.normals.push_back(dense.normals[n]);
        uneven.scalars[0].values.push_back(dense.scalars[0].values[n]);
    }
    const MpuField field = fieldOf(std::move(uneven), 0.02);
    EXPECT_LT(widthOfStep(field, -0.5), 0.04);
    EXPECT_LT(widthOfStep(field, 0.5), 0.32);
}

TEST(AttributesTest, BehindASheetThatIsOpenAreThoseOfItsPoints)
{
    constexpr double kSpacing = 0.02;
    const MpuField field =
        fieldOf(sheet(kSpacing, [](const Vec3d& p) { return p[0] - 0.5 * p[1]; }), kSpacing);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> within(-0.5, 0.5);
    for (const double below : {0.03, 0.1, 0.3}) {
        std::vector<SurfacePlace> places;
        for (int n = 0; n < 200; ++n)
            places.push_back({Vec3d(within(random), within(random), -below), -Vec3d::UnitZ()});
        const std::vector<float> values = heatOf(field, places);
        for (std::size_t n = 0; n < places.size(); ++n) {
            const Vec3d& p = places[n].position;
            ASSERT_NEAR(values[n], p[0] - 0.5 * p[1], 0.03 + 0.5 * below) << below;
        }
    }
}

/// Farther and farther from a half of a sphere, and round it: never a jump.
TEST(AttributesTest, ChangeSlowlyFarFromPoints)
{
    PointCloud whole = sphere(20000, Vec3d::Zero()), half;
    half.scalars = {{"heat", {}}};
    for (std::size_t n = 0; n < whole.size(); ++n) {
        if (whole.positions[n][2] > 0) continue;
        half.positions.push_back(whole.positions[n]);
        half.normals.push_back(whole.normals[n]);
        half.scalars[0].values.push_back(whole.scalars[0].values[n]);
    }
    const MpuField field = fieldOf(std::move(half), 0.03);
    std::vector<SurfacePlace> ray, circle;
    for (int n = 0; n <= 3000; ++n) {
        const Vec3d away = Vec3d(0.5, 0.3, -1).normalized();
        ray.push_back({(1 + 0.001 * n) * away, away});
        const double turn = 2 * M_PI * n / 3000;
        const Vec3d about(std::cos(turn), 0, std::sin(turn));
        circle.push_back({1.3 * about, about});
    }
    for (const auto& places : {ray, circle}) {
        const std::vector<float> values = heatOf(field, places);
        for (std::size_t n = 0; n + 1 < values.size(); ++n) {
            ASSERT_LT(std::abs(values[n]), 102);
            ASSERT_NEAR(values[n + 1], values[n], 1.5) << n; // of +-102
        }
    }
}

TEST(AttributesTest, ColorsOfCasesReachTheBackOfASheet)
{
    MPUVDB_CASE(path, "T07-coloured-open-sheet.ply");
    Interrupter progress;
    PointCloud cloud = readPoints({path}, BadPoints::Fail, {}, {}, &progress).cloud;
    const PointCloud kept = cloud;
    clean(cloud, {}, &progress);
    test::Uncleaned colored;
    colored.attributes = {kColorName};
    const ReconstructResult made = reconstruct(std::move(cloud), colored, &progress);
    Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
    addAttributes(mesh, *made.field->attributes({kColorName}), &progress);
    const Vec3f shift = (mesh.frame - kept.frame).cast<float>();
    for (std::size_t v = 0; v < mesh.positions.size(); v += 97) {
        const Vec3f at = mesh.positions[v] + shift;
        const auto nearest = std::min_element(
            kept.positions.begin(), kept.positions.end(), [&](const Vec3f& a, const Vec3f& b) {
                return (a - at).squaredNorm() < (b - at).squaredNorm();
            });
        const Vec3f there = linearColor(kept.colors[std::size_t(nearest - kept.positions.begin())]);
        const double off = double((mesh.colors[v] - there).cwiseAbs().maxCoeff());
        // The colors change by 1 over some 10 units.
        ASSERT_LT(off, 0.05 + 0.3 * double((*nearest - at).norm())) << at;
    }
}

TEST(AttributesTest, ManyPointsInOnePlaceSpeakForIt)
{
    Interrupter progress;
    PointCloud cloud = sphere(500, Vec3d::Zero());
    for (int n = 0; n < 100; ++n) {
        cloud.positions.emplace_back(1.f, 0.f, 0.f);
        cloud.normals.emplace_back(1.f, 0.f, 0.f);
        cloud.colors.push_back({});
        cloud.scalars[0].values.push_back(n % 2 ? 7.f : 5.f);
    }
    MpuSettings fit;
    fit.tolerance = 0.01;
    fit.voxelSize = 0.05;
    const MpuField field(std::move(cloud), fit, &progress);
    const SurfacePlace there{Vec3d::UnitX(), Vec3d::UnitX()};
    std::vector<float> values;
    field.attributes({"heat"})->evaluate({there, there}, values);
    for (const float value : values) EXPECT_NEAR(value, 6, 0.5); // others are about it
}

TEST(AttributesTest, SheetsDoNotShineThrough)
{
    // Two sides of a thin wall: red above, blue below; a point on each side above the other.
    Interrupter progress;
    PointCloud cloud;
    for (int i = 0; i < 100; ++i)
        for (int j = 0; j < 100; ++j)
            for (const float side : {1.0f, -1.0f}) {
                cloud.positions.emplace_back(0.01f * float(i), 0.01f * float(j), side * 0.01f);
                cloud.normals.emplace_back(0, 0, side);
                cloud.colors.push_back(side > 0 ? Rgb{255, 0, 0} : Rgb{0, 0, 255});
            }
    MpuSettings fit;
    fit.tolerance = 0.002;
    fit.voxelSize = 0.01;
    const MpuField field(std::move(cloud), fit, &progress);
    std::vector<float> rgb;
    field.attributes({kColorName})
        ->evaluate({{Vec3d(0.5, 0.5, 0.01), Vec3d::UnitZ()},
                    {Vec3d(0.503, 0.496, -0.01), -Vec3d::UnitZ()}},
                   rgb);
    EXPECT_GT(rgb[0], 0.97f);
    EXPECT_LT(rgb[2], 0.03f);
    EXPECT_LT(rgb[3], 0.03f);
    EXPECT_GT(rgb[5], 0.97f);
}

TEST(AttributesTest, FewPointsAndMissingNames)
{
    Interrupter progress;
    PointCloud cloud = sphere(8, Vec3d::Zero());
    cloud.scalars[0].values.assign(8, 4.5f);
    MpuSettings fit;
    fit.tolerance = 0.1;
    fit.voxelSize = 0.2;
    const MpuField field(std::move(cloud), fit, &progress);
    std::vector<float> values;
    field.attributes({"heat"})->evaluate({{Vec3d(50, 0, 0), Vec3d::UnitX()}}, values);
    EXPECT_EQ(values[0], 4.5f);
    try {
        field.attributes({"cold"});
        ADD_FAILURE() << "it is there";
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("Cd, confidence, heat"), std::string::npos)
            << e.what();
    }
}

/// A file's grids carry over to a mesh, and trimming keeps what its vertices have.
TEST_F(IoTest, GridsGiveVerticesTheirAttributesAndTrimmingKeepsThem)
{
    Interrupter progress;
    const LevelSet ball(
        openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(1, openvdb::Vec3f(0), 0.05f));
    const auto onBand = [&](auto grid, const char* name, auto value) {
        grid->setTransform(ball.grid().transform().copy());
        grid->setName(name);
        grid->topologyUnion(ball.grid());
        for (auto voxel = grid->beginValueOn(); voxel; ++voxel)
            voxel.setValue(value(ball.grid().indexToWorld(voxel.getCoord())));
        return grid;
    };
    const auto colors = onBand(openvdb::Vec3SGrid::create(), kColorName, [](openvdb::Vec3d p) {
        return openvdb::Vec3s(p * 0.25 + openvdb::Vec3d(0.5));
    });
    colors->setSaveFloatAsHalf(true);
    const auto height = onBand(openvdb::FloatGrid::create(), "height",
                               [](openvdb::Vec3d p) { return float(p.z()); });
    writeLevelSet(path("b.vdb"), ball, {}, {colors, height}, &progress);
    const auto grids = readAttributeGrids(path("b.vdb"), {"height", "width", kColorName});
    ASSERT_EQ(grids.size(), 3u);
    ASSERT_TRUE(grids[0] && !grids[1] && grids[2]);

    Mesh mesh = extractMesh(ball, {}, &progress);
    addAttribute(mesh, *grids[0], &progress);
    addAttribute(mesh, *grids[2], &progress);
    auto covered = openvdb::FloatGrid::create();
    covered = onBand(covered, kCoverageName,
                     [](openvdb::Vec3d p) { return float(p.x()) > 0.213f ? 0.0f : 1.0f; });
    TrimReport trimmed;
    const Mesh cut = trimMesh(mesh, *covered, {}, trimmed, &progress);
    ASSERT_LT(cut.triangles.size(), mesh.triangles.size());
    for (const Mesh* each : std::array<const Mesh*, 2>{&mesh, &cut}) {
        ASSERT_EQ(each->colors.size(), each->positions.size());
        ASSERT_EQ(each->scalars.at(0).values.size(), each->positions.size());
        for (std::size_t v = 0; v < each->positions.size(); ++v) {
            const Vec3d p = each->world(v);
            ASSERT_NEAR(double(each->scalars[0].values[v]), p.z(), 1e-4);
            ASSERT_NEAR(double(each->colors[v][1]), 0.5 + 0.25 * p.y(), 1e-3);
        }
    }
}

// The command writes them so; other grids with voxels stand beside them.
TEST_F(IoTest, CompressedAttributesGiveTheBytesOfThoseWithVoxels)
{
    Interrupter progress;
    auto options = settings();
    options.coverage = true;
    const ReconstructResult made =
        reconstruct(sphere(20000, Vec3d(3, -40, 1e3)), options, &progress);
    const auto attributes = made.field->attributes({"heat", kColorName, "confidence"});
    const auto bytesOf = [&](const char* name, const openvdb::GridCPtrVec& grids) {
        openvdb::GridCPtrVec beside{made.coverage};
        beside.insert(beside.end(), grids.begin(), grids.end());
        writeLevelSet(path(name), made.levelSet(), {{"mpuvdb:a", "b"}}, beside, &progress);
        std::ifstream in(path(name), std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    const auto grids = sampleAttributes(made.levelSet(), *attributes, &progress);
    const std::string whole = bytesOf("whole.vdb", {grids.begin(), grids.end()});
    for (const int threads : {1, 8}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                        std::size_t(threads));
        EXPECT_TRUE(bytesOf("compressed.vdb",
                            compressAttributes(made.levelSet(), *attributes, &progress)) == whole)
            << threads << " threads";
    }
    for (const auto& grid : readGrids(path("compressed.vdb")))
        EXPECT_GT(grid->activeVoxelCount(), 0u);
    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(compressAttributes(made.levelSet(), *attributes, &stopped), Interrupted);
}

TEST_F(IoTest, ScalarsAreReadByName)
{
    const std::string ascii = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                              "property float y\nproperty float z\nproperty ushort heat\n"
                              "property float cold\nend_header\n";
    const std::string rows = "0 0 0 7 1.5\n1 0 0 8 nan\n0 1 0 9 -2\n";
    std::string binary = ascii;
    binary.replace(binary.find("ascii"), 5, "binary_big_endian");
    for (int i = 0; i < 3; ++i)
        binary += concat(bytesOf(float(i), true), bytesOf(1.f, true), bytesOf(float(i * i), true),
                         bytesOf(std::uint16_t(7 + i), true), bytesOf(-0.5f, true));
    const std::string pcd = "VERSION .7\nFIELDS x y z heat\nSIZE 4 4 4 4\nTYPE F F F F\n"
                            "WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA ascii\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";
    const std::string columns = "x y z heat\n0 0 0 7\n1 0 0 8\n0 1 0 9\n";
    Interrupter progress;
    for (const auto& [name, bytes] : {std::pair("a.ply", ascii + rows), std::pair("b.ply", binary),
                                      std::pair("p.pcd", pcd), std::pair("t.txt", columns)}) {
        const PointInput input =
            readPoints({put(name, bytes)}, BadPoints::Fail, {}, {"heat"}, &progress);
        ASSERT_EQ(input.cloud.scalars.size(), 1u) << name;
        EXPECT_EQ(input.cloud.scalars[0].name, "heat");
        EXPECT_EQ(input.cloud.scalars[0].values, (std::vector<float>{7, 8, 9})) << name;
        EXPECT_TRUE(
            readPoints({path(name)}, BadPoints::Fail, {}, {}, &progress).cloud.scalars.empty());
    }
    const PointInput cold =
        readPoints({path("a.ply")}, BadPoints::Fail, {}, {"heat", "cold"}, &progress);
    EXPECT_EQ(cold.cloud.scalars.at(1).values, (std::vector<float>{1.5f, 0, -2}));
    ASSERT_EQ(cold.notes.size(), 1u);
    EXPECT_THROW(
        readPoints({path("a.ply"), path("p.pcd")}, BadPoints::Fail, {}, {"cold"}, &progress),
        InputError);
    writePoints(path("again.ply"), cold.cloud, &progress);
    const PointInput again =
        readPoints({path("again.ply")}, BadPoints::Fail, {}, {"cold", "heat"}, &progress);
    EXPECT_EQ(again.cloud.scalars.at(0).values, cold.cloud.scalars.at(1).values);
}

} // namespace
} // namespace mpuvdb::test
