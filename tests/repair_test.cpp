// Broken meshes as solids: open, doubled, flipped, nested, without an inside, damaged.
#include "closed_parts.h"
#include "modelling_fixture.h"

#include "sampling/winding_number.h"

#include <mpuvdb/block_under.h>
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace mpuvdb
{
namespace
{

using test::boxDistance;
using test::Random;

constexpr double kExact = 1e-3; ///< of values to floats, far from holes, voxels
const Vec3d kOrigin(1e-3, 2e-3, 3e-3);

SampleSettings settingsOf(double voxelSize)
{
    SampleSettings settings;
    settings.lattice = {kOrigin, voxelSize};
    return settings;
}

LevelSet repaired(const Mesh& mesh, double voxelSize, const RepairSettings& repair = {})
{
    Interrupter progress;
    return voxelize(mesh, settingsOf(voxelSize), repair, &progress);
}

const MeshRepair& repairOf(const LevelSet& levelSet)
{
    return *std::get<MeshExplained>(levelSet.explained()->by).repair;
}

/// All values and states, in order.
std::vector<float> valuesOf(const LevelSet& levelSet)
{
    std::vector<float> values;
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on)
        for (const float v :
             {float(on.getCoord().x()), float(on.getCoord().y()), float(on.getCoord().z()), *on})
            values.push_back(v);
    return values;
}

void expectSame(const LevelSet& a, const LevelSet& b)
{
    const std::vector<float> x = valuesOf(a), y = valuesOf(b);
    ASSERT_EQ(x.size(), y.size());
    EXPECT_EQ(std::memcmp(x.data(), y.data(), x.size() * sizeof(float)), 0);
}

/// @a mesh without the triangles for which gone(middle).
template <typename P>
Mesh without(Mesh mesh, const P& gone)
{
    const auto isGone = [&](const Mesh::Triangle& t) {
        return gone(Vec3d((mesh.world(t[0]) + mesh.world(t[1]) + mesh.world(t[2])) / 3));
    };
    mesh.triangles.erase(std::remove_if(mesh.triangles.begin(), mesh.triangles.end(), isGone),
                         mesh.triangles.end());
    return mesh;
}

/// A square in the plane z = 0 with sides of length @a size, of @a steps x @a steps squares.
Mesh squareMesh(double size, std::uint32_t steps)
{
    Mesh mesh;
    for (std::uint32_t i = 0; i <= steps; ++i)
        for (std::uint32_t j = 0; j <= steps; ++j)
            mesh.positions.push_back(
                Vec3d(size * (double(i) / steps - .5), size * (double(j) / steps - .5), 0)
                    .cast<float>());
    for (std::uint32_t i = 0; i < steps; ++i)
        for (std::uint32_t j = 0; j < steps; ++j) {
            const std::uint32_t a = i * (steps + 1) + j, b = a + steps + 1;
            mesh.triangles.push_back({a, b, b + 1});
            mesh.triangles.push_back({a, b + 1, a + 1});
        }
    return mesh;
}

TEST(Repair, ClosesTheMissingFaceOfABoxByAPlane)
{
    const Vec3d half(.6, .5, .4);
    for (const double voxels : {20.0, 40.0}) {
        const double h = 1 / voxels;
        const Mesh mesh = without(test::boxPart(-half, half),
                                  [&](const Vec3d& p) { return p[2] > half[2] - 1e-6; });
        const LevelSet solid = repaired(mesh, h);
        test::expectSound(solid);
        EXPECT_TRUE(solid.explained()->isSound());
        double nearLid = 0, elsewhere = 0;
        for (auto on = solid.grid().cbeginValueOn(); on; ++on) {
            const Vec3d p = test::worldOf(solid.lattice(), on.getCoord());
            const double error = std::abs(double(*on) - boxDistance(p, half)) / h;
            (p[2] > half[2] - 6 * h ? nearLid : elsewhere) =
                std::max(p[2] > half[2] - 6 * h ? nearLid : elsewhere, error);
        }
        EXPECT_LT(elsewhere, kExact);
        // The winding number of two terms errs by 1/1000; at a hole of w voxels it changes by
        // about 1 / (pi w) per voxel.
        EXPECT_LT(nearLid, 1e-3 * M_PI * 1.2 * voxels + 0.05);
        const MeshRepair& repair = repairOf(solid);
        EXPECT_EQ(repair.holes, 1u);
        EXPECT_NEAR(repair.widestHole, std::hypot(1.2, 1.0), 4 * h);
        EXPECT_NEAR(repair.holesArea, 1.2, 2 * h * 2.2);
        EXPECT_NEAR(repair.widestHoleAt[2], half[2], h);
    }
}

// All faces lie on planes of voxels, where winding numbers are those between two sides.
TEST(Repair, ClosesHolesOfABoxOnTheLattice)
{
    const Vec3d half(.5, .25, .375);
    SampleSettings settings;
    settings.lattice = {Vec3d::Zero(), 1.0 / 32};
    for (const double side : {-1, 1}) {
        const Mesh mesh = without(test::boxPart(-half, half),
                                  [&](const Vec3d& p) { return side * p[0] > half[0] - 1e-6; });
        Interrupter progress;
        const LevelSet solid = voxelize(mesh, settings, RepairSettings{}, &progress);
        test::expectSound(solid);
        EXPECT_EQ(repairOf(solid).holes, 1u);
        EXPECT_NEAR(repairOf(solid).widestHole, std::hypot(.5, .75), 4.0 / 32);
        EXPECT_EQ(
            test::deviation(solid, [&](const Vec3d& p) { return boxDistance(p, half); }).wrongSigns,
            0u);
    }
}

TEST(Repair, LeavesSoundMeshesAsTheyAre)
{
    Mesh cavity = test::ballPart(.4, 7);
    test::turnInward(cavity);
    Mesh other = test::ballPart(1, 12);
    test::move(other, Eigen::Matrix3d::Identity(), Vec3d(.7, .1, .2));
    const std::vector<Mesh> meshes = {test::boxPart({-1, -.5, -.25}, {1, .5, .25}),
                                      test::soupOf({test::ballPart(1, 12), other}),
                                      test::soupOf({test::ballPart(1, 12), cavity})};
    for (const Mesh& mesh : meshes) {
        Interrupter progress;
        const LevelSet solid = repaired(mesh, .04);
        expectSame(solid, voxelize(mesh, settingsOf(.04), &progress));
        EXPECT_EQ(repairOf(solid).holes, 0u);
        EXPECT_EQ(repairOf(solid).turned, 0u);
    }
}

TEST(Repair, CopiesCountOnce)
{
    const Mesh ball = test::ballPart(1, 10);
    Mesh doubled = ball, bothSides = ball;
    for (const Mesh::Triangle& t : ball.triangles) {
        doubled.triangles.push_back(t);
        bothSides.triangles.push_back({t[0], t[2], t[1]});
    }
    Interrupter progress;
    const LevelSet plain = voxelize(ball, settingsOf(.05), &progress);
    for (const Mesh& mesh : {doubled, bothSides}) {
        const LevelSet solid = repaired(mesh, .05);
        expectSame(solid, plain);
        EXPECT_EQ(repairOf(solid).copies, ball.triangles.size());
    }
    EXPECT_THROW(voxelize(bothSides, settingsOf(.05), &progress), InputError);
}

/// Faces that are there for both sides in a part of a surface count once, too; those that part a
/// solid's cells bound nothing.
TEST(Repair, FacesForBothSidesCountOnce)
{
    const Mesh ball = test::ballPart(1, 10);
    Interrupter progress;
    const LevelSet plain = voxelize(ball, settingsOf(.05), &progress);
    for (const double from : {.9, .3, -.5}) {
        Mesh partly = ball;
        for (const Mesh::Triangle& t : ball.triangles)
            if (partly.world(t[0])[2] > from) partly.triangles.push_back({t[0], t[2], t[1]});
        expectSame(repaired(partly, .05), plain);
        try {
            voxelize(partly, settingsOf(.05), &progress);
            FAIL() << "faces cancel";
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find("for both sides"), std::string::npos)
                << error.what();
        }
    }
    // Two boxes side by side, each with its own face between them.
    const Mesh left = test::boxPart(Vec3d(-.6, -.5, -.4), Vec3d(0, .5, .4)),
               right = test::boxPart(Vec3d(0, -.5, -.4), Vec3d(.6, .5, .4));
    const Mesh cells = test::soupOf({left, right});
    expectSame(repaired(cells, .05), voxelize(cells, settingsOf(.05), &progress));
    EXPECT_EQ(repairOf(repaired(cells, .05)).innerWalls, 0u);
}

TEST(Repair, TurnsHalvesAndWholeShells)
{
    const Mesh ball = test::ballPart(1, 10);
    Interrupter progress;
    const LevelSet plain = voxelize(ball, settingsOf(.05), &progress);
    Mesh half = ball;
    for (Mesh::Triangle& t : half.triangles)
        if (half.world(t[0])[0] < 0) std::swap(t[1], t[2]);
    expectSame(repaired(half, .05), plain);

    Mesh away = test::ballPart(1, 10);
    test::move(away, Eigen::Matrix3d::Identity(), Vec3d(3, 0, 0));
    const LevelSet both = voxelize(test::soupOf({ball, away}), settingsOf(.05), &progress);
    test::turnInward(away);
    const LevelSet solid = repaired(test::soupOf({ball, away}), .05);
    expectSame(solid, both);
    EXPECT_EQ(repairOf(solid).turned, 1u);
}

// The six sides of a box, which do not quite meet, one of them inside out.
TEST(Repair, TurnsSidesThatDoNotMeet)
{
    const Vec3d half(.6, .5, .4);
    const double h = .04, gap = .1 * h;
    Mesh mesh = test::soupOf({test::boxPart(-half, half)});
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        const Vec3f a = mesh.positions[mesh.triangles[t][0]],
                    b = mesh.positions[mesh.triangles[t][1]],
                    c = mesh.positions[mesh.triangles[t][2]];
        const Vec3f normal = (b - a).cross(c - a).normalized();
        for (const std::uint32_t v : mesh.triangles[t])
            mesh.positions[v] += float(gap / 2) * normal;
        if (normal[0] > .5f) std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
    }
    const LevelSet solid = repaired(mesh, h);
    test::expectSound(solid);
    EXPECT_EQ(repairOf(solid).turned, 1u);
    const Vec3d wide = half + Vec3d::Constant(gap / 2);
    const test::Deviation found =
        test::deviation(solid, [&](const Vec3d& p) { return boxDistance(p, wide); });
    EXPECT_EQ(found.wrongSigns, 0u);
    EXPECT_LT(found.largest, gap / h);
}

TEST(Repair, InnerWallsAreNoSurface)
{
    const Vec3d half(.6, .5, .4);
    Mesh mesh = test::boxPart(-half, half);
    const auto first = std::uint32_t(mesh.positions.size());
    for (const int n : {0, 1, 2, 3})
        mesh.positions.push_back(
            Vec3d(.13, n & 1 ? half[1] : -half[1], n & 2 ? half[2] : -half[2]).cast<float>());
    mesh.triangles.push_back({first, first + 1, first + 3});
    mesh.triangles.push_back({first, first + 3, first + 2});
    const double h = .04;
    const LevelSet solid = repaired(mesh, h);
    test::expectSound(solid);
    const test::Deviation found =
        test::deviation(solid, [&](const Vec3d& p) { return boxDistance(p, half); });
    EXPECT_EQ(found.wrongSigns, 0u);
    EXPECT_LT(found.largest, kExact);
}

TEST(Repair, OpenSurfacesBecomeWallsOnRequest)
{
    const Mesh square = squareMesh(1, 8);
    const double h = .03, thickness = .17;
    try {
        repaired(square, h);
        FAIL() << "a square encloses nothing";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("--thicken"), std::string::npos) << error.what();
    }
    RepairSettings settings;
    settings.thickness = thickness;
    const LevelSet wall = repaired(square, h, settings);
    test::expectSound(wall);
    const test::Deviation found = test::deviation(wall, [&](const Vec3d& p) {
        const Vec3d q(std::max(std::abs(p[0]) - .5, 0.0), std::max(std::abs(p[1]) - .5, 0.0), p[2]);
        return q.norm() - thickness / 2;
    });
    EXPECT_EQ(found.wrongSigns, 0u);
    EXPECT_LT(found.largest, kExact);
    EXPECT_EQ(repairOf(wall).sheets, 1u);
    EXPECT_NEAR(repairOf(wall).sheetsArea, 1, 1e-6);
    // A solid beside it stays as it is.
    const Mesh ball = test::ballPart(.4, 10);
    for (const double height : {1.0, .6, .45}) { // apart, almost touching, merged
        Mesh beside = ball;
        test::move(beside, Eigen::Matrix3d::Identity(), Vec3d(0, 0, height));
        const LevelSet both = repaired(test::soupOf({square, beside}), h, settings);
        test::expectSound(both);
        EXPECT_EQ(repairOf(both).sheets, 1u);
    }
    settings.thickness = 1.9 * h;
    EXPECT_THROW(repaired(square, h, settings), UsageError);
}

/// A fin of two triangles that a box holds in part: what is outside is a wall, wherever the middles
/// of the triangles are.
TEST(Repair, FinsBecomeWallsWhereTheyStickOut)
{
    const Vec3d half(.5, .5, .5);
    const double h = .05, thickness = .15, depth = .8;
    RepairSettings settings;
    settings.thickness = thickness;
    for (const auto& [low, high] : std::vector<std::pair<double, double>>{
             {0, .4}, {0, .75}, {-.3, .8}, {0, 1.2}, {-.8, .8}, {-.7, 1.3}, {0, 3}}) {
        Mesh fin;
        for (const int n : {0, 1, 2, 3})
            fin.positions.push_back(
                Vec3d(.013, n & 1 ? high : low, n & 2 ? depth / 2 : -depth / 2).cast<float>());
        fin.triangles = {{0, 1, 3}, {0, 3, 2}};
        const LevelSet solid =
            repaired(test::soupOf({test::boxPart(-half, half), fin}), h, settings);
        test::expectSound(solid);
        const bool sticksOut = high > half[1];
        EXPECT_EQ(repairOf(solid).sheets, sticksOut ? 1u : 0u) << low << " " << high;
        EXPECT_EQ(repairOf(solid).innerWalls, sticksOut ? 0u : 1u) << low << " " << high;
        const test::Deviation found = test::deviation(solid, [&](const Vec3d& p) {
            const double y = p[1] - std::clamp(p[1], low, high),
                         z = std::max(std::abs(p[2]) - depth / 2, 0.0);
            const double wall = Vec3d(p[0] - float(.013), y, z).norm() - thickness / 2;
            return std::min(boxDistance(p, half), wall);
        });
        EXPECT_EQ(found.wrongSigns, 0u) << low << " " << high;
        const double outside =
            (std::max(high - half[1], 0.0) + std::max(-half[1] - low, 0.0)) * depth;
        // Pieces of a voxel go with their middles, at most two voxels along each root.
        EXPECT_NEAR(repairOf(solid).sheetsArea, outside, 2 * h * depth) << low << " " << high;
    }
}

TEST(Repair, WavesLowerThanAVoxelBecomeWalls)
{
    const double h = .03, thickness = .17, height = .3 * h, middle = kOrigin[2] + h / 2;
    Mesh waves = squareMesh(1, 24);
    for (Vec3f& p : waves.positions)
        p[2] = float(middle + height * std::sin(9 * double(p[0])) * std::cos(7 * double(p[1])));
    try {
        repaired(waves, h);
        FAIL() << "no voxel is between the waves and the surface that closes them";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("--thicken"), std::string::npos) << error.what();
    }
    RepairSettings settings;
    settings.thickness = thickness;
    const LevelSet wall = repaired(waves, h, settings);
    test::expectSound(wall);
    const test::Deviation found = test::deviation(wall, [&](const Vec3d& p) {
        const Vec3d q(std::max(std::abs(p[0]) - .5, 0.0), std::max(std::abs(p[1]) - .5, 0.0),
                      p[2] - middle);
        return q.norm() - thickness / 2;
    });
    EXPECT_LT(found.largest, height / h + kExact); // a distance differs by no more than the waves
    EXPECT_EQ(repairOf(wall).sheets, 1u);
    EXPECT_EQ(repairOf(wall).holes, 0u);
    double area = 0;
    for (const Mesh::Triangle& t : waves.triangles)
        area += (waves.world(t[1]) - waves.world(t[0]))
                    .cross(waves.world(t[2]) - waves.world(t[0]))
                    .norm() /
                2;
    EXPECT_NEAR(repairOf(wall).sheetsArea, area, 1e-9 * area);
}

/// A hill over the square of squareMesh(1, steps).
double hill(double x, double y)
{
    return .1 * std::cos(2 * x) * std::cos(3 * y);
}

TEST(Repair, SurfacesSeenFromAboveBecomeBlocks)
{
    const double h = .02, depth = .15;
    Mesh terrain = squareMesh(1, 40);
    double lowest = HUGE_VAL;
    for (Vec3f& p : terrain.positions) {
        p[2] = float(hill(double(p[0]), double(p[1])));
        lowest = std::min(lowest, double(p[2]));
    }
    // Chords of 1/40 are below the hill by their squared length times its curvatures, over 8.
    const double flat = (.4 + .9) / 8 / 1600;
    double volume = 0;
    constexpr int kSteps = 400;
    for (int n = 0; n < kSteps * kSteps; ++n)
        volume += hill((n % kSteps + .5) / kSteps - .5, (n / kSteps + .5) / kSteps - .5);
    volume = volume / (kSteps * kSteps) - lowest + depth;
    const auto expectBlock = [&](const LevelSet& block, double tolerance) {
        test::expectSound(block);
        const auto& explained = std::get<MeshExplained>(block.explained()->by);
        EXPECT_EQ(explained.partsOut, 1u);
        EXPECT_NEAR(explained.volumeOut, volume, tolerance);
        std::size_t wrong = 0, count = 0;
        for (auto on = block.grid().cbeginValueOn(); on; ++on) {
            const Vec3d p = test::worldOf(block.lattice(), on.getCoord());
            const double above = p[2] - hill(p[0], p[1]), base = lowest - depth - p[2],
                         beside = std::max(std::abs(p[0]), std::abs(p[1])) - .5;
            const double outside = std::max({above, base, beside});
            if (std::abs(outside) < flat + kExact * h) continue;
            wrong += (*on < 0) != (outside < 0);
            ++count;
        }
        EXPECT_EQ(wrong, 0u);
        EXPECT_GT(count, 10000u);
    };
    Interrupter progress;
    // Edges are rounded by a voxel: as explained.h has it.
    const double rounded = h * h / 4 * (8 * M_PI / 2);
    const Mesh block = blockUnder(terrain, Vec3d(0, 0, 2), depth, &progress);
    expectBlock(voxelize(block, settingsOf(h), &progress), rounded + flat);
    expectBlock(repaired(block, h), rounded + flat);
    // One that faces down is turned; another axis is up.
    Mesh turned = terrain;
    for (Mesh::Triangle& t : turned.triangles) std::swap(t[1], t[2]);
    expectBlock(
        voxelize(blockUnder(turned, Vec3d::UnitZ(), depth, &progress), settingsOf(h), &progress),
        rounded + flat);
    Mesh lying = terrain;
    for (Vec3f& p : lying.positions) p = Vec3f(p[1], p[2], p[0]);
    const LevelSet upright =
        voxelize(blockUnder(lying, Vec3d::UnitY(), depth, &progress), settingsOf(h), &progress);
    EXPECT_NEAR(std::get<MeshExplained>(upright.explained()->by).volumeOut, volume, rounded + flat);
    // A hole gets no walls: it is closed, by a surface between its rim's lowest and highest places.
    const Mesh holed =
        without(terrain, [](const Vec3d& p) { return (p - Vec3d(.1, -.05, p[2])).norm() < .2; });
    const LevelSet closed = repaired(blockUnder(holed, Vec3d::UnitZ(), depth, &progress), h);
    test::expectSound(closed);
    EXPECT_EQ(repairOf(closed).holes, 1u);
    const double lowestRim = .1 * std::cos(.6) * std::cos(.75) - .02;
    EXPECT_NEAR(std::get<MeshExplained>(closed.explained()->by).volumeOut, volume,
                M_PI * .04 * (.1 - lowestRim) + rounded);
    EXPECT_EQ(std::get<MeshExplained>(closed.explained()->by).partsOut, 1u);

    EXPECT_THROW(blockUnder(terrain, Vec3d::Zero(), depth, &progress), UsageError);
    EXPECT_THROW(blockUnder(terrain, Vec3d::UnitZ(), 0, &progress), UsageError);
    EXPECT_THROW(blockUnder(squareMesh(1, 4), Vec3d::UnitX(), depth, &progress), InputError);
    EXPECT_THROW(blockUnder(test::ballPart(1, 8), Vec3d::UnitZ(), depth, &progress), InputError);
    EXPECT_THROW(blockUnder(Mesh(), Vec3d::UnitZ(), depth, &progress), InputError);
}

/// Voxels on the rim of a block are inside or outside by rounding: none of them is a part.
TEST(Repair, BlocksOnTheLatticeHaveNoSpecksAtTheirRims)
{
    for (const int voxels : {50, 100, 150}) {
        Mesh terrain = squareMesh(2, 30);
        for (Vec3f& p : terrain.positions) p[2] = 0.3f * (p[0] + 1) * std::sin(3 * p[1]);
        SampleSettings settings;
        settings.lattice.voxelSize = 2.0 / voxels;
        settings.lattice.origin = Vec3d(-1, -1, 0);
        const Mesh block = blockUnder(terrain, Vec3d::UnitZ(), 0.5);
        const LevelSet made = voxelize(block, settings, RepairSettings{});
        EXPECT_EQ(SolidComponents(made).measures().size(), 1u) << voxels;
        EXPECT_EQ(measure(extractMesh(made)).components, 1u) << voxels;
    }
}

TEST(Repair, LeavesOutDamagedTriangles)
{
    Mesh mesh = test::ballPart(1, 10);
    const std::size_t whole = mesh.triangles.size();
    mesh.positions[5].setConstant(std::numeric_limits<float>::quiet_NaN());
    mesh.triangles.push_back({0, 1, std::uint32_t(mesh.positions.size())});
    const auto damaged =
        std::count_if(mesh.triangles.begin(), mesh.triangles.end(), [](const Mesh::Triangle& t) {
            return std::find(t.begin(), t.end(), 5u) != t.end();
        });
    const LevelSet solid = repaired(mesh, .05);
    test::expectSound(solid);
    EXPECT_EQ(repairOf(solid).dropped, std::uint64_t(damaged) + 1);
    EXPECT_GE(repairOf(solid).holes, 1u);
    EXPECT_GT(whole, std::size_t(damaged));
    for (Vec3f& p : mesh.positions) p.setConstant(std::numeric_limits<float>::infinity());
    EXPECT_THROW(repaired(mesh, .05), InputError);
    EXPECT_THROW(repaired(Mesh(), .05), InputError);
}

TEST(Repair, RefusesHolesThatAreTooWide)
{
    const Mesh mesh = without(test::ballPart(1, 12), [](const Vec3d& p) { return p[2] > .8; });
    const double width = repairOf(repaired(mesh, .05)).widestHole;
    RepairSettings settings;
    settings.holes = 1.01 * width;
    EXPECT_EQ(repairOf(repaired(mesh, .05, settings)).holes, 1u);
    settings.holes = .99 * width;
    try {
        repaired(mesh, .05, settings);
        FAIL() << "a hole is too wide";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("--repair-holes"), std::string::npos);
    }
}

/// Parts with holes: each without the triangles in a ball about one of its vertices.
Mesh openParts(Random& random)
{
    std::vector<Mesh> parts;
    for (int n = 0; n < 3; ++n) {
        Mesh part = n == 0   ? test::ballPart(8, 8)
                    : n == 1 ? test::torusPart(7, 3, 24, 12)
                             : test::pipePart(6, 3, 12, 16);
        const Vec3d center =
            part.world(std::size_t(random.uniform() * double(part.positions.size())));
        const double radius = 2 + 3 * random.uniform();
        part =
            without(std::move(part), [&](const Vec3d& p) { return (p - center).norm() < radius; });
        test::move(part, Eigen::Matrix3d::Identity(), random.inCube(8));
        parts.push_back(std::move(part));
    }
    return test::soupOf(parts);
}

TEST(WindingNumber, IsTheSumOfSolidAngles)
{
    constexpr std::uint64_t kSeed = 73;
    Random random(kSeed);
    Interrupter progress;
    const auto largestError = [&](const Mesh& mesh) {
        const OrientedTriangles triangles = orientTriangles(mesh, Copies::Add, progress);
        const TriangleTree tree(triangles.mesh, progress);
        const WindingNumber winding(tree, triangles);
        double largest = 0;
        for (int n = 0; n < 400; ++n) {
            // About the mesh, at its triangles, and above its vertices, where rays meet edges.
            const Mesh::Triangle& t = triangles.mesh.triangles[std::size_t(
                random.uniform() * double(triangles.mesh.triangles.size()))];
            const Vec3d vertex = triangles.mesh.positions[t[0]].cast<double>(),
                        middle = (vertex + triangles.mesh.positions[t[1]].cast<double>() +
                                  triangles.mesh.positions[t[2]].cast<double>()) /
                                 3;
            const Vec3d p = n % 3 == 0   ? Vec3d(random.inCube(12))
                            : n % 3 == 1 ? Vec3d(middle + random.inCube(1e-3))
                                         : Vec3d(vertex[0], vertex[1], 12 * random.uniform() - 6);
            std::size_t slot = 0;
            if (tree.squaredDistance(p, slot) < 1e-12) continue; // on the mesh it jumps
            const double expected = test::windingOf(triangles.mesh, p);
            largest = std::max(largest, std::abs(winding.at(p) - expected));
        }
        return largest;
    };
    for (int n = 0; n < 6; ++n) {
        SCOPED_TRACE(fmt::format("seed {}, mesh {}", kSeed, n));
        const std::vector<Mesh> closed = {test::ballPart(3 + random.uniform(), 12),
                                          test::pipePart(4, 1.5, 30, 20),
                                          test::boxPart(random.inCube(1), Vec3d(4, 5, 6))};
        // Exact to the roundings of a thousand angles.
        EXPECT_LT(largestError(test::soupOf(closed)), 1e-9);
        const Vec3d center = random.inCube(4);
        const Mesh open =
            without(test::soupOf(closed), [&](const Vec3d& p) { return (p - center).norm() < 2; });
        EXPECT_LT(largestError(open), 1e-9);
        // Long triangles from end to end, of which many meet at two places.
        Mesh fans;
        const std::uint32_t count = 300;
        fans.positions = {Vec3f(0, 0, -5), Vec3f(0, 0, 5)};
        for (std::uint32_t k = 0; k < count; ++k) {
            const double turn = 2 * M_PI * k / count;
            fans.positions.push_back(Vec3d(std::cos(turn), std::sin(turn), 0).cast<float>());
            const std::uint32_t a = 2 + k, b = 2 + (k + 1) % count;
            fans.triangles.push_back({0, b, a});
            if (n % 2 == 0 || k > 3) fans.triangles.push_back({1, a, b});
        }
        EXPECT_LT(largestError(fans), 1e-9);
        // All triangles apart: a sum, to the error of two terms of the expansion, at least two
        // radii from a node: a quarter of that of one of its sides, a sixteenth of all directions,
        // and of some such nodes.
        Mesh apart;
        const Mesh soup = test::soupOf(closed);
        for (const Mesh::Triangle& t : soup.triangles) {
            const auto first = std::uint32_t(apart.positions.size());
            const Vec3d middle = (soup.world(t[0]) + soup.world(t[1]) + soup.world(t[2])) / 3;
            for (const std::uint32_t corner : t)
                apart.positions.push_back(
                    (middle + .9 * (soup.world(corner) - middle)).cast<float>());
            apart.triangles.push_back({first, first + 1, first + 2});
        }
        EXPECT_LT(largestError(apart), 4.0 / 64);
    }
}

TEST(Repair, SignsAreThoseOfTheWindingNumber)
{
    constexpr std::uint64_t kSeed = 71;
    Random random(kSeed);
    for (int n = 0; n < 6; ++n) {
        SCOPED_TRACE(fmt::format("seed {}, mesh {}", kSeed, n));
        const Mesh mesh = openParts(random);
        const LevelSet solid = repaired(mesh, 1);
        test::expectSound(solid);
        std::size_t wrong = 0, count = 0;
        for (auto on = solid.grid().cbeginValueOn(); on; ++on) {
            if (count++ % 7 != 0) continue;
            const Vec3d p = test::worldOf(solid.lattice(), on.getCoord());
            const double number = test::windingOf(mesh, p - mesh.frame);
            // Beyond a tenth of a voxel, and the error of two terms of the expansion.
            if (std::abs(*on) > .1 && std::abs(number - .5) > .02)
                wrong += (*on < 0) != (number > .5);
        }
        EXPECT_EQ(wrong, 0u);
        EXPECT_GT(count, 1000u);
    }
}

TEST(Repair, IsTheSameForAnyNumberOfThreads)
{
    Random random(72);
    const Mesh mesh = openParts(random);
    RepairSettings settings;
    settings.thickness = 2.5;
    std::vector<LevelSet> made;
    for (const std::size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        made.push_back(repaired(mesh, .8, settings));
    }
    expectSame(made[0], made[1]);
}

TEST(Repair, EstimatesItsMemory)
{
    const Mesh mesh = without(test::ballPart(1, 12), [](const Vec3d& p) { return p[2] > .8; });
    SampleSettings settings = settingsOf(.01);
    settings.maxBytes = 1000000;
    Interrupter progress;
    EXPECT_THROW(voxelize(mesh, settings, RepairSettings{}, &progress), LimitError);
}

// --- What is told of it

const MeshExplained& explainedOf(const LevelSet& levelSet)
{
    return std::get<MeshExplained>(levelSet.explained()->by);
}

// Holes that are closed are what repair is for.
TEST(RepairExplained, NothingIsToldOfHolesThatWereClosed)
{
    Mesh torus = test::torusPart(1, 0.3, 100, 50);
    for (std::size_t n = torus.triangles.size(); n > 0; n -= 2000)
        torus.triangles.erase(torus.triangles.begin() + std::ptrdiff_t(n - 2000));
    Mesh box = test::boxPart({0, 0, 0}, {1, 1, 1});
    box.triangles.erase(box.triangles.begin(), box.triangles.begin() + 2);
    for (const Mesh& mesh : {torus, box})
        for (const double voxelSize : {0.02, 0.0125, 0.01}) {
            const MeshExplained& e = explainedOf(repaired(mesh, voxelSize));
            EXPECT_TRUE(e.findings.empty()) << e.findings.front();
            EXPECT_NEAR(e.volumeIn, e.volumeOut, e.volumeExplained + 1e-3 * e.volumeOut);
        }
}

// A wall buries the faces that it stands on.
TEST(RepairExplained, NothingIsToldOfWallsThatTouchASolid)
{
    Mesh box = test::boxPart({0, 0, 0}, {1, 1, 1}), fin;
    fin.positions = {Vec3f(1, .5f, 0), Vec3f(2, .5f, 0), Vec3f(2, .5f, 1), Vec3f(1, .5f, 1)};
    fin.triangles = {{0, 1, 2}, {0, 2, 3}};
    for (const double thickness : {0.08, 0.2}) {
        RepairSettings repair;
        repair.thickness = thickness;
        const LevelSet made = repaired(test::soupOf({box, fin}), 0.01, repair);
        EXPECT_TRUE(explainedOf(made).findings.empty()) << explainedOf(made).findings.front();
    }
}

} // namespace
} // namespace mpuvdb
