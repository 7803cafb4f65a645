// Solids that are inside out are turned, and nothing else.
#include "scanned_cloud.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/io.h>
#include <mpuvdb/normals.h>

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

void append(PointCloud& to, const PointCloud& from, const Vec3f& offset, float side)
{
    for (const Vec3f& p : from.positions) to.positions.push_back(p + offset);
    for (const Vec3f& n : from.normals) to.normals.push_back(side * n);
}

/// Share of normals that look out of @a solid.
double shareRight(const Solid& solid, const PointCloud& cloud)
{
    double right = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        right += solid.normal(cloud.world(i)).dot(cloud.normals[i].cast<double>()) > 0;
    return right / double(cloud.size());
}

TEST(InwardSolids, AreTurnedAsAWhole)
{
    for (const Pattern pattern : {Pattern::Even, Pattern::Random, Pattern::Scan})
        for (const char* solid :
             {"sphere(1)", "torus(1,0.3)", "box(1,1,1)", "slab(1,1,0.05)", "fandisk(1)",
              "gear(12,1,0.3)", "blob(1,8,0.05)", "difference(sphere(1),sphere(0.6))",
              "difference(box(2,2,2),translate(sphere(0.3),0.4,0,0))"}) {
            const PointCloud cloud = scanned(solid, 10000, pattern);
            EXPECT_EQ(foundIn(cloud), 0u) << solid << int(pattern);
            EXPECT_EQ(foundInFlipped(cloud), cloud.size()) << solid << int(pattern);
        }
}

TEST(InwardSolids, OneAmongOthersOfAnySpacing)
{
    for (const std::uint64_t points : {1500, 40000})
        for (int inward = 0; inward < 5; ++inward) {
            PointCloud cloud;
            std::size_t expected = 0;
            for (int ball = 0; ball < 5; ++ball) {
                const PointCloud one =
                    scanned("sphere(1)", ball == 2 ? points : 1500, Pattern::Even);
                append(cloud, one, Vec3f(3 * float(ball), float(ball % 2), 0),
                       ball == inward ? -1.f : 1.f);
                if (ball == inward) expected = one.size();
            }
            EXPECT_EQ(foundIn(cloud), expected) << points << ' ' << inward;
        }
}

TEST(InwardSolids, CavitiesStay)
{
    // A ball in a cavity of a ball, beside another; the one in between looks inward, rightly.
    PointCloud cloud;
    const PointCloud fine = scanned("sphere(1)", 20000, Pattern::Even);
    const auto add = [&](float radius, float side) {
        PointCloud ball = scanned("sphere(1)", 6000, Pattern::Even);
        for (Vec3f& p : ball.positions) p *= radius;
        append(cloud, ball, Vec3f::Zero(), side);
    };
    append(cloud, fine, Vec3f::Zero(), 1);
    add(0.7f, -1);
    add(0.3f, 1);
    append(cloud, fine, Vec3f(4, 0, 0), 1);
    EXPECT_EQ(foundIn(cloud), 0u);
    EXPECT_EQ(foundInFlipped(cloud), cloud.size());
}

/// Walls of a room of 5 x 4 x 2.7, and things in it, that look to who stands in it.
class Room
{
public:
    explicit Room(int perMeter) : mPerMeter(perMeter) {}

    using Seen = std::function<bool(const Vec3d&)>;
    /// Points of a parallelogram where it is @a seen.
    void face(const Vec3d& corner, const Vec3d& u, const Vec3d& v, const Vec3d& normal,
              const Seen& seen)
    {
        const int m = int(u.norm() * mPerMeter), n = int(v.norm() * mPerMeter);
        for (int i = 0; i < m; ++i)
            for (int j = 0; j < n; ++j) {
                const auto random = [&] { return double(mEngine()) / 4294967296.0; };
                const Vec3d p = corner + (i + random()) / m * u + (j + random()) / n * v;
                if (!seen(p)) continue;
                mCloud.positions.push_back(p.cast<float>());
                mCloud.normals.push_back(normal.cast<float>());
            }
    }

    void walls(const Seen& seen, bool ceiling = true)
    {
        const Vec3d x(5, 0, 0), y(0, 4, 0), z(0, 0, 2.7), o = Vec3d::Zero();
        face(o, x, y, Vec3d::UnitZ(), seen);
        if (ceiling) face(z, x, y, -Vec3d::UnitZ(), seen);
        face(o, x, z, Vec3d::UnitY(), seen);
        face(y, x, z, -Vec3d::UnitY(), seen);
        face(o, y, z, Vec3d::UnitX(), seen);
        face(x, y, z, -Vec3d::UnitX(), seen);
    }

    /// A box seen from above and from four sides.
    void thing(const Vec3d& low, const Vec3d& size, const Seen& seen)
    {
        const Vec3d x(size.x(), 0, 0), y(0, size.y(), 0), z(0, 0, size.z());
        face(low + z, x, y, Vec3d::UnitZ(), seen);
        face(low, x, z, -Vec3d::UnitY(), seen);
        face(low + y, x, z, Vec3d::UnitY(), seen);
        face(low, y, z, -Vec3d::UnitX(), seen);
        face(low + x, y, z, Vec3d::UnitX(), seen);
    }

    const PointCloud& cloud() const { return mCloud; }

private:
    int mPerMeter;
    std::mt19937 mEngine{kSeed};
    PointCloud mCloud;
};

bool all(const Vec3d&)
{
    return true;
}

bool isInDoor(const Vec3d& p)
{
    return p.x() < 0.01 && p.y() > 1.5 && p.y() < 2.4 && p.z() < 2;
}

TEST(InwardSolids, RoomsSeenFromWithinStay)
{
    for (const int perMeter : {12, 20, 35}) {
        Room door(perMeter), open(perMeter);
        door.walls([](const Vec3d& p) { return !isInDoor(p); });
        EXPECT_EQ(foundIn(door.cloud()), 0u) << perMeter;
        open.walls(all, false);
        EXPECT_EQ(foundIn(open.cloud()), 0u) << perMeter;
    }
}

TEST(InwardSolids, RoomsWithShadowsStay)
{
    // Seen from one place, over a table and a cupboard; nothing below the scanner.
    const Vec3d scanner(1.5, 2.8, 1.5);
    const std::vector<Box3d> things{{Vec3d(2, 1.5, 0), Vec3d(3.4, 2.3, 0.75)},
                                    {Vec3d(0, 0, 0), Vec3d(0.6, 1.8, 2)}};
    const auto isSeen = [&](const Vec3d& p) {
        if (p.z() < 0.01 && (p - scanner).head<2>().norm() < 0.8) return false;
        for (const Box3d& thing : things)
            for (int step = 1; step < 200; ++step)
                if (thing.contains(scanner + step / 201.0 * (p - scanner))) return false;
        return true;
    };
    Room room(20);
    room.walls(isSeen);
    for (const Box3d& thing : things) room.thing(thing.min(), thing.sizes(), isSeen);
    EXPECT_EQ(foundIn(room.cloud()), 0u);
}

TEST(InwardSolids, ThingsInAClosedRoomKeepItAsItIs)
{
    // The walls are closed, but what hangs before them is not: no cavity.
    Room room(20);
    room.walls(all);
    room.thing(Vec3d(2, 1.5, 1), Vec3d(1, 1, 0.6), [](const Vec3d& p) { return p.x() < 2.9; });
    EXPECT_EQ(foundIn(room.cloud()), 0u);
}

TEST(InwardSolids, CleanTurnsThemUnlessTheUserDecides)
{
    const auto solid = parseSolid("torus(1,0.4)");
    PointCloud inward = scanned("torus(1,0.4)", 8000, Pattern::Even);
    flipNormals(inward);
    for (std::size_t i = 0; i < inward.size(); i += 50) inward.normals[i] *= -1;
    const auto cleaned = [&](CleanSettings settings, PointCloud cloud) {
        Interrupter progress;
        const CleanReport report = clean(cloud, settings, &progress);
        return std::make_pair(report, shareRight(*solid, cloud));
    };
    const auto [turned, right] = cleaned({}, inward);
    EXPECT_EQ(turned.turned, inward.size());
    EXPECT_GT(turned.flipped, 0u);
    EXPECT_FALSE(turned.inward);
    EXPECT_EQ(right, 1);

    CleanSettings settings;
    settings.flipNormals = true;
    EXPECT_EQ(cleaned(settings, inward).first.turned, 0u);
    EXPECT_EQ(cleaned(settings, inward).second, 1);
    EXPECT_TRUE(cleaned(settings, scanned("torus(1,0.4)", 8000, Pattern::Even)).first.inward);
    settings = {};
    settings.normals = NormalsFrom::Keep;
    EXPECT_EQ(cleaned(settings, inward).first.turned, 0u);
    EXPECT_TRUE(cleaned(settings, inward).first.inward);

    // Who knows where the scanner stood has said which way normals look.
    inward.viewpoints = {{Vec3d(1, 0, 0), false}};
    inward.seenFrom.assign(inward.size(), 0);
    EXPECT_EQ(cleaned({}, inward).first.turned, 0u);
}

TEST(InwardSolids, OfRealPoints)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    const auto read = [&](const char* file) {
        Interrupter progress;
        PointCloud cloud =
            readPoints({std::filesystem::path(folder) / file}, BadPoints::Drop, {}, {}, &progress)
                .cloud;
        cloud.mesh.reset();
        if (!cloud.hasNormals()) estimateNormals(cloud, {}, &progress);
        return cloud;
    };
    for (const char* closed :
         {"clouds/armadillo_inward_normals.xyz", "clouds/kitten.xyz", "clouds/bimba_no_normals.ply",
          "clouds/igea.ply", "berger/anchor_scan.ply", "berger/dc_scan.ply", "berger/dc.off",
          "bunny/bun_zipper.ply", "cad/fandisk_large.off", "cad/rocker-arm.obj"}) {
        const PointCloud cloud = read(closed);
        EXPECT_EQ(foundIn(cloud), 0u) << closed;
        EXPECT_EQ(foundInFlipped(cloud), cloud.size()) << closed;
    }
    for (const char* open : {"clouds/building.ply", "clouds/hippo2.ply", "clouds/bun0.pcd",
                             "clouds/milk_color.pcd", "clouds/rs1.pcd", "clouds/samp52-utm.pcd",
                             "clouds/autzen-thin.las", "bunny/bun000.ply"}) {
        const PointCloud cloud = read(open);
        EXPECT_EQ(foundIn(cloud), 0u) << open;
        EXPECT_EQ(foundInFlipped(cloud), 0u) << open;
    }
}

/// Of a mesh its triangles tell, where its vertices are too few.
TEST(InwardSolids, OfMeshes)
{
    const auto folder = std::filesystem::path(testing::TempDir());
    for (const bool flipped : {false, true}) {
        const auto file = folder / "cube.off";
        std::ofstream out(file);
        out << "OFF\n8 6 0\n";
        for (int i = 0; i < 8; ++i)
            out << (i & 1) << ' ' << (i >> 1 & 1) << ' ' << (i >> 2) << '\n';
        const int quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                 {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
        for (const auto& q : quads)
            out << "4 " << q[0] << ' ' << q[flipped ? 3 : 1] << ' ' << q[2] << ' '
                << q[flipped ? 1 : 3] << '\n';
        out.close();
        Interrupter progress;
        const PointCloud cube = readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud;
        EXPECT_EQ(foundIn(cube), flipped ? 8u : 0u);
        EXPECT_EQ(foundInFlipped(cube), 0u); // normals that are not its triangles'
        std::filesystem::remove(file);
    }
}

} // namespace
} // namespace mpuvdb
