// Meshes of many closed parts as one solid: overlapping, touching, nested, facing inward, doubled.
#include "case_files.h"
#include "closed_parts.h"

#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <numeric>

namespace mpuvdb
{
namespace
{

using test::Random;

/// Voxels: two faces that touch are no farther apart, and what is thinner is nothing.
constexpr double kTouch = 1e-3;

Eigen::Matrix3d rotation(Random& random)
{
    const Vec3d axis = random.inCube(1).normalized();
    return Eigen::AngleAxisd(random.uniform() * 2 * M_PI, axis).toRotationMatrix();
}

/// A part of some 5 to 12 voxels, about the origin.
Mesh randomPart(Random& random)
{
    const double size = 5 + 7 * random.uniform();
    switch (int(5 * random.uniform())) {
    case 0:
        return test::boxPart(-size * Vec3d(.5, .4, .3), size * Vec3d(.5, .4, .3));
    case 1:
        return test::ballPart(.5 * size, 5);
    case 2:
        return test::torusPart(.4 * size, .2 * size, 17, 9);
    case 3:
        return test::pipePart(.45 * size, .25 * size, size, 13);
    default:
        return test::knotPart(.6 * size, .12 * size, 48, 7);
    }
}

/// 2 to 30 parts: anywhere, on planes of the lattice, beside each other, within each other; some
/// face inward, some are there twice.
Mesh randomParts(Random& random)
{
    const int count = 2 + int(28 * random.uniform() * random.uniform());
    const double room = 6 * std::cbrt(count);
    std::vector<Mesh> parts;
    for (int n = 0; n < count; ++n) {
        Mesh part = randomPart(random);
        const double kind = random.uniform();
        if (kind < 0.25 && !parts.empty()) { // within another, as its cavity or for nothing
            part = parts[std::size_t(random.uniform() * double(parts.size()))];
            Vec3d middle = Vec3d::Zero();
            for (const Vec3f& p : part.positions)
                middle += p.cast<double>() / double(part.positions.size());
            test::move(part, 0.6 * Eigen::Matrix3d::Identity(), 0.4 * middle);
            if (random.uniform() < 0.5) test::turnInward(part);
        } else if (kind < 0.55) { // a box on planes of the lattice; many share some
            const auto corner = [&] { return Vec3d((room * random.inCube(1)).array().round()); };
            const Vec3d a = corner(), b = a + Vec3d(2, 2, 2) +
                                          Vec3d((8 * (random.inCube(0.5).array() + 0.5)).round());
            part = test::boxPart(a, b);
            if (kind < 0.35) { // another on top of it
                parts.push_back(part);
                part = test::boxPart({a[0] + 1, a[1], b[2]}, {b[0] - 1, b[1] + 1, b[2] + 3});
            }
        } else {
            test::move(part, rotation(random), room * random.inCube(1));
            if (n > 0 && random.uniform() < 0.15) test::turnInward(part);
        }
        parts.push_back(part);
        if (random.uniform() < 0.1) parts.push_back(part);
    }
    return test::soupOf(parts);
}

LevelSet voxelizedAt(const Mesh& mesh, double voxelSize = 1)
{
    SampleSettings settings;
    settings.lattice = {Vec3d::Zero(), voxelSize};
    Interrupter progress;
    return voxelize(mesh, settings, &progress);
}

/// What lies nearest to a place among all triangles.
struct Nearest {
    double distance;
    bool bounds; ///< the solid is on one side of it
};

Nearest nearestTo(const Mesh& mesh, const Vec3d& p)
{
    Nearest nearest{HUGE_VAL, false};
    Vec3d place = Vec3d::Zero(), normal = Vec3d::Zero();
    for (const Mesh::Triangle& t : mesh.triangles) {
        const std::array<Vec3d, 3> corners = {mesh.world(t[0]), mesh.world(t[1]), mesh.world(t[2])};
        const Vec3d at = test::nearestOn(corners, p);
        if (!((at - p).norm() < nearest.distance)) continue;
        nearest.distance = (at - p).norm();
        place = at;
        normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
    }
    const Vec3d step = 5 * kTouch * normal;
    nearest.bounds =
        (test::windingOf(mesh, place + step) > 0.5) != (test::windingOf(mesh, place - step) > 0.5);
    return nearest;
}

double valueAt(const LevelSet& levelSet, const openvdb::Coord& voxel)
{
    return double(levelSet.grid().tree().getValue(voxel));
}

openvdb::Coord randomVoxel(const openvdb::CoordBBox& box, Random& random)
{
    const auto along = [&](int axis) {
        return box.min()[axis] + int(random.uniform() * double(box.dim()[axis]));
    };
    return {along(0), along(1), along(2)};
}

TEST(VoxelizeParts, OfThisTestFaceOutward)
{
    for (const Mesh& part :
         {test::boxPart({1, 2, 3}, {4, 6, 8}), test::ballPart(3, 5), test::torusPart(4, 2, 17, 9),
          test::pipePart(5, 3, 6, 13), test::knotPart(6, 1, 48, 7)})
        EXPECT_GT(measure(part).volume, 0);
}

TEST(VoxelizeParts, AgreeWithTheirWindingNumbers)
{
    constexpr int kUnions = 200, kPlaces = 60;
    std::uint64_t compared = 0;
    for (int n = 0; n < kUnions; ++n) {
        SCOPED_TRACE(fmt::format("seed {}", n));
        Random random{std::uint64_t(n)};
        const Mesh mesh = randomParts(random);
        const LevelSet levelSet = voxelizedAt(mesh);
        openvdb::CoordBBox box = levelSet.grid().evalActiveVoxelBoundingBox();
        for (int k = 0; k < kPlaces; ++k) {
            const openvdb::Coord voxel = randomVoxel(box, random);
            const Vec3d p(voxel.x(), voxel.y(), voxel.z());
            const double value = valueAt(levelSet, voxel);
            const Nearest nearest = nearestTo(mesh, p);
            EXPECT_GE(std::abs(value), std::min(nearest.distance, 3.0) - 0.01) << voxel;
            if (nearest.distance > 0.01) {
                EXPECT_EQ(value<0, test::windingOf(mesh, p)> 0.5) << voxel << ' ' << value;
            }
            if (!nearest.bounds) continue;
            EXPECT_NEAR(std::abs(value), std::min(nearest.distance, 3.0), 0.01) << voxel;
            ++compared;
        }
        if (HasFailure()) return;
    }
    EXPECT_GT(compared, kUnions * kPlaces / 2);
}

/// Places spread evenly over those triangles that bound the solid.
std::vector<Vec3d> boundaryPlaces(const Mesh& mesh, Random& random, double perArea)
{
    std::vector<Vec3d> places;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), u = mesh.world(t[1]) - a, v = mesh.world(t[2]) - a;
        const Vec3d area = u.cross(v) / 2;
        const double expected = perArea * area.norm();
        for (int n = int(expected + random.uniform()); n > 0; --n) {
            double s = random.uniform(), r = random.uniform();
            if (s + r > 1) s = 1 - s, r = 1 - r;
            const Vec3d p = a + s * u + r * v, step = 5 * kTouch * area.normalized();
            if ((test::windingOf(mesh, p + step) > 0.5) != (test::windingOf(mesh, p - step) > 0.5))
                places.push_back(p);
        }
    }
    return places;
}

/// The solid's distance, to the accuracy of places on its boundary: from above.
double distanceTo(const Mesh& mesh, const std::vector<Vec3d>& boundary, const Vec3d& p)
{
    double least = HUGE_VAL;
    for (const Vec3d& q : boundary) least = std::min(least, (q - p).squaredNorm());
    return (test::windingOf(mesh, p) > 0.5 ? -1 : 1) * std::sqrt(least);
}

// What was buried must not come back as a surface.
TEST(VoxelizeParts, MayBeOffsetAndHollowed)
{
    constexpr int kUnions = 12, kPlaces = 150;
    constexpr double kPerArea = 4, kSure = 1.2; // places; voxels: a few distances between places
    for (int n = 0; n < kUnions; ++n) {
        SCOPED_TRACE(fmt::format("seed {}", 1000 + n));
        Random random{std::uint64_t(1000 + n)};
        std::vector<Mesh> parts;
        for (int k = 0; k < 4; ++k) {
            parts.push_back(randomPart(random));
            test::move(parts.back(), rotation(random), 5 * random.inCube(1));
        }
        const Mesh mesh = test::soupOf(parts);
        const std::vector<Vec3d> boundary = boundaryPlaces(mesh, random, kPerArea);
        const LevelSet solid = voxelizedAt(mesh);
        Interrupter progress;
        const LevelSet grown = offset(solid, 2, &progress), shrunk = offset(solid, -1.2, &progress),
                       hollow = shell(solid, 2.2, Wall::Inward, &progress);
        const openvdb::CoordBBox box = grown.grid().evalActiveVoxelBoundingBox();
        for (int k = 0; k < kPlaces; ++k) {
            const openvdb::Coord voxel = randomVoxel(box, random);
            const double d = distanceTo(mesh, boundary, Vec3d(voxel.x(), voxel.y(), voxel.z()));
            const auto expectSide = [&](const LevelSet& made, double expected, const char* what) {
                if (std::abs(expected) > kSure) {
                    EXPECT_EQ(valueAt(made, voxel) < 0, expected < 0)
                        << what << ' ' << voxel << ' ' << valueAt(made, voxel) << ' ' << d;
                }
            };
            expectSide(solid, d, "solid");
            expectSide(grown, d - 2, "grown");
            expectSide(shrunk, d + 1.2, "shrunk");
            expectSide(hollow, std::max(d, -2.2 - d), "hollow");
        }
        if (HasFailure()) return;
    }
}

struct Expected {
    double volume;
    std::size_t parts = 1;
};

void expectParts(const LevelSet& levelSet, const Expected& expected, double tolerance)
{
    Interrupter progress;
    const SolidComponents found(levelSet, &progress);
    double volume = 0;
    std::size_t parts = 0; // a voxel in a corner that no axis enters may be alone
    for (const ComponentMeasures& part : found.measures()) {
        volume += part.volume;
        parts += part.volume > std::pow(levelSet.voxelSize(), 3);
    }
    EXPECT_EQ(parts, expected.parts);
    EXPECT_NEAR(volume, expected.volume, tolerance);
    test::expectSound(levelSet);
}

// Trilinear values cut off an edge of 90 degrees by up to a fifth of a voxel squared.
constexpr double kOfEdges = 0.2;

TEST(VoxelizeParts, OverlappingBoxesAreOneSolid)
{
    Interrupter progress;
    for (const Vec3d& shift : {Vec3d(0, 0, 0), Vec3d(0.013, 0.007, 0.031)})
        for (const double h : {0.1, 0.11, 0.125}) {
            SCOPED_TRACE(h);
            std::vector<Mesh> parts = {test::boxPart({0, 0, 0}, {4, 4, 4}),
                                       test::boxPart({2, 1, 1}, {6, 3, 3})};
            for (Mesh& part : parts) test::move(part, Eigen::Matrix3d::Identity(), shift);
            const LevelSet solid = voxelizedAt(test::soupOf(parts), h);
            const double edges = 12 * 4 + 8 * 2 + 4 * 2;
            expectParts(solid, {72}, kOfEdges * edges * h * h);
            expectParts(offset(solid, -0.4, &progress), {3.2 * 3.2 * 3.2 + 2 * 1.2 * 1.2 + 0.128},
                        kOfEdges * edges * h * h);
        }
}

TEST(VoxelizeParts, CasesOfPeople)
{
    Interrupter progress;
    struct Case {
        const char* name;
        double voxelSize, shift;
        Expected whole, moved;
        double tolerance; ///< of volumes, relative
    };
    for (const Case& c : {Case{"T01-overlapping-boxes.obj", 0.11, -0.4, {72}, {36.1}, 0.015},
                          Case{"T01-overlapping-boxes.obj", 0.1, -0.4, {72}, {36.1}, 0.015},
                          Case{"T01-two-spheres.obj", 0.25, -2, {40250}, {29568}, 0.005},
                          Case{"T02-cube-with-cavity.obj", 20 / 77.0, 0.5, {6272}, {7927}, 0.005},
                          Case{"T03-touching-boxes.obj", 0.1, -0.4, {72}, {35.65}, 0.01},
                          Case{"T03-touching-boxes.obj", 0.09, -0.4, {72}, {35.65}, 0.01}}) {
        SCOPED_TRACE(fmt::format("{} at {}", c.name, c.voxelSize));
        MPUVDB_CASE(file, c.name);
        const LevelSet solid = voxelizedAt(readMesh(file, &progress), c.voxelSize);
        expectParts(solid, c.whole, c.tolerance * c.whole.volume);
        expectParts(offset(solid, c.shift, &progress), c.moved, c.tolerance * c.moved.volume);
    }
}

// A face that two parts share at an angle is not the same to the bit in both.
TEST(VoxelizeParts, PartsThatTouchAtAnAngleAreOneSolid)
{
    Random random(7);
    for (int n = 0; n < 20; ++n) {
        SCOPED_TRACE(fmt::format("seed 7, {}", n));
        const Eigen::Matrix3d turn = rotation(random);
        const Vec3d by = 100 * random.inCube(1);
        std::vector<Mesh> parts = {test::boxPart({-9, -8, -7}, {0, 8, 7}),
                                   test::boxPart({0, -3, -4}, {11, 5, 2}),
                                   test::boxPart({0, 5, -4}, {11, 7, 2})};
        for (Mesh& part : parts) test::move(part, turn, by);
        const double volume = 9 * 16 * 14 + 11 * 8 * 6 + 11 * 2 * 6;
        const double edges = 4 * (9 + 16 + 14) + 4 * 11 + 4 * (10 + 6);
        expectParts(voxelizedAt(test::soupOf(parts)), {volume}, kOfEdges * edges);
    }
}

// A ball in a ball, in a ball: what faces inward is taken away, what faces outward in it stays.
TEST(VoxelizeParts, NestedPartsAreCavitiesAndWhatLiesInThem)
{
    std::vector<Mesh> parts = {test::ballPart(20, 12), test::ballPart(14, 12),
                               test::ballPart(8, 9)};
    const double outer = measure(parts[0]).volume, middle = measure(parts[1]).volume,
                 inner = measure(parts[2]).volume;
    expectParts(voxelizedAt(test::soupOf(parts)), {outer}, 0.01 * outer);
    test::turnInward(parts[1]);
    expectParts(voxelizedAt(test::soupOf(parts)), {outer - middle + inner, 2}, 0.01 * outer);
    test::turnInward(parts[2]);
    expectParts(voxelizedAt(test::soupOf(parts)), {outer - middle}, 0.01 * outer);
}

TEST(VoxelizeParts, CopiesCountOnce)
{
    const Mesh ring = test::torusPart(12, 5, 40, 20);
    Mesh back = ring;
    test::turnInward(back);
    const double volume = measure(ring).volume;
    const LevelSet once = voxelizedAt(ring);
    EXPECT_EQ(test::treeBytes(voxelizedAt(test::soupOf({ring, ring, ring})).grid()),
              test::treeBytes(once.grid()));
    EXPECT_EQ(test::treeBytes(voxelizedAt(back).grid()), test::treeBytes(once.grid()));
    expectParts(once, {volume}, 0.01 * volume);
    EXPECT_THROW(voxelizedAt(test::soupOf({ring, back})), InputError);
}

// Some exporters turn single faces; all others tell the right side.
TEST(VoxelizeParts, FacesThatContradictTheirNeighborsAreTurned)
{
    Mesh ring = test::torusPart(12, 5, 40, 20);
    const LevelSet right = voxelizedAt(ring);
    Random random(3);
    for (Mesh::Triangle& t : ring.triangles)
        if (random.uniform() < 0.3) std::swap(t[1], t[2]);
    EXPECT_EQ(test::treeBytes(voxelizedAt(ring).grid()), test::treeBytes(right.grid()));
}

// --- What came out, held against what came in

MeshExplained explained(const Mesh& mesh, double voxelSize,
                        const Vec3d& origin = Vec3d(0.01, 0.02, 0.03))
{
    SampleSettings settings;
    settings.lattice = {origin, voxelSize};
    Interrupter progress;
    return std::get<MeshExplained>(voxelize(mesh, settings, &progress).explained()->by);
}

double longestSide(const Mesh& mesh)
{
    Box3d box;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) box.extend(mesh.world(v));
    return box.sizes().maxCoeff();
}

TEST(MeshExplained, KnowsTheSolidOfItsParts)
{
    std::vector<Mesh> parts = {
        test::boxPart({0, 0, 0}, {40, 40, 40}), test::boxPart({20, 10, 10}, {60, 30, 30}),
        test::boxPart({5, 5, 5}, {15, 35, 35}), test::boxPart({40, 10, 10}, {50, 30, 40})};
    test::turnInward(parts[2]);
    const MeshExplained e = explained(test::soupOf(parts), 1);
    EXPECT_NEAR(e.volumeIn, 72000 - 9000 + 10 * 20 * 10, 1);
    EXPECT_NEAR(e.volumeOut, e.volumeIn, e.volumeExplained);
    EXPECT_NEAR(e.areaIn, 9600 - 400 - 200 + 2000 - 200 + 600 + 2 * (300 + 300 + 900), 1);
    EXPECT_NEAR(e.areaOut, e.areaIn, 0.05 * e.areaIn);
    EXPECT_EQ(e.partsIn, 1u);
    EXPECT_EQ(e.partsOut, 1u);
    EXPECT_EQ(e.cavitiesIn, 1u);
    EXPECT_EQ(e.cavitiesOut, 1u);
    EXPECT_TRUE(e.findings.empty());
}

// A mesh that faces inward as a whole is turned, and all of it is the solid's boundary.
TEST(MeshExplained, NothingIsToldOfMeshesThatFaceInward)
{
    std::vector<Mesh> meshes = {test::boxPart({0, 0, 0}, {40, 30, 20}),
                                test::torusPart(20, 8, 40, 20),
                                test::soupOf({test::ballPart(15, 12), [] {
                                                  Mesh inner = test::ballPart(8, 12);
                                                  test::turnInward(inner);
                                                  return inner;
                                              }()})};
    for (Mesh& mesh : meshes) {
        const MeshExplained right = explained(mesh, 1);
        for (Mesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
        const MeshExplained e = explained(mesh, 1);
        EXPECT_TRUE(e.insideOut);
        EXPECT_TRUE(e.findings.empty()) << e.findings.front();
        EXPECT_NEAR(e.areaIn, right.areaIn, 1e-5 * right.areaIn);
        EXPECT_NEAR(e.volumeIn, right.volumeIn, 1e-5 * right.volumeIn);
        EXPECT_EQ(e.cavitiesIn, right.cavitiesIn);
    }
}

// Far from the origin, too: the volume is that of the mesh with its holes closed.
TEST(MeshExplained, NothingIsToldOfHolesSmallerThanAVoxel)
{
    for (const Vec3d& middle : {Vec3d(0, 0, 0), Vec3d(300, -200, 100)}) {
        Mesh mesh = test::torusPart(20, 8, 200, 80);
        test::move(mesh, Eigen::Matrix3d::Identity(), middle);
        const MeshExplained whole = explained(mesh, 1.5);
        Random random(4);
        for (int n = 0; n < 25; ++n)
            mesh.triangles.erase(mesh.triangles.begin() +
                                 std::ptrdiff_t(random.below(mesh.triangles.size())));
        const MeshExplained e = explained(mesh, 1.5);
        EXPECT_GT(e.openEdges, 0u);
        EXPECT_NEAR(e.volumeIn, whole.volumeIn, 1e-4 * whole.volumeIn);
        EXPECT_TRUE(e.findings.empty()) << e.findings.front();
    }
}

/// The triangles of a mesh apart from each other, each smaller by @a width on all sides.
/// @param kites  becomes the area between them that is beside no side, but at a corner.
Mesh shrunk(const Mesh& mesh, double width, double& kites)
{
    kites = 0;
    Mesh soup;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const auto first = std::uint32_t(soup.positions.size());
        const auto corner = [&](std::size_t k) { return mesh.world(t[k % 3]); };
        for (std::size_t k = 0; k < 3; ++k) {
            const Vec3d a = (corner(k + 1) - corner(k)).normalized();
            const Vec3d b = (corner(k + 2) - corner(k)).normalized();
            kites += width * width * (1 + a.dot(b)) / a.cross(b).norm(); // 1 / tan of half of it
            soup.positions.push_back(
                (corner(k) + width / a.cross(b).norm() * (a + b)).cast<float>());
        }
        soup.triangles.push_back({first, first + 1, first + 2});
    }
    return soup;
}

// Free triangles, as where faces of a CAD part do not quite meet: their volume is that of the
// solid, and they are one part. The strips that fill the gaps lack kites at corners.
TEST(MeshExplained, NothingIsToldOfGapsBetweenTriangles)
{
    const Mesh meshes[] = {test::ballPart(20, 16), test::torusPart(20, 8, 40, 20),
                           test::boxPart({100, 200, -50}, {140, 220, -30})};
    for (const Mesh& mesh : meshes) {
        const MeshExplained whole = explained(mesh, 1.5);
        for (const double width : {0.003, 0.02, 0.05}) {
            double kites = 0;
            const MeshExplained e = explained(shrunk(mesh, width, kites), 1.5);
            EXPECT_TRUE(e.findings.empty()) << width << ": " << e.findings.front();
            EXPECT_NEAR(e.volumeIn, whole.volumeIn,
                        1e-5 * whole.volumeIn + kites * longestSide(mesh) / 3);
            EXPECT_EQ(e.partsIn, 1u);
        }
    }
}

// The voxel size that is named shows a gap as it shows a wall.
TEST(MeshExplained, GapsThinnerThanAVoxelAreTold)
{
    const Mesh mesh = test::soupOf(
        {test::boxPart({0, 0, 0}, {20.3, 20, 20}), test::boxPart({20.5, 0, 0}, {40, 20, 20})});
    ASSERT_EQ(explained(mesh, 1).findings.size(), 1u);
    EXPECT_TRUE(explained(mesh, 0.05).findings.empty());
    const std::string told = explained(mesh, 1).findings[0];
    const auto at = told.find("Voxels of ") + std::string("Voxels of ").size();
    EXPECT_NEAR(std::stod(told.substr(at)), 0.1, 0.051) << told; // to a factor of two
}

// However little of the mesh they are.
TEST(MeshExplained, PartsAndCavitiesSmallerThanAVoxelAreTold)
{
    const auto told = [](const std::vector<Mesh>& parts) {
        const MeshExplained e = explained(test::soupOf(parts), 1);
        return e.findings.empty() ? std::string() : e.findings[0];
    };
    const Mesh box = test::boxPart({0, 0, 0}, {40, 40, 40});
    const auto ball = [](double radius, const Vec3d& middle) {
        Mesh mesh = test::ballPart(radius, 6);
        test::move(mesh, Eigen::Matrix3d::Identity(), middle);
        return mesh;
    };
    for (const double radius : {0.4, 3.0}) {
        std::vector<Mesh> rivets = {box};
        for (int n = 0; n < 6; ++n) rivets.push_back(ball(radius, Vec3d(7.5 * n, 5, 50.5)));
        EXPECT_EQ(told(rivets).find("in 7 parts with 0 cavities became") != std::string::npos,
                  radius < 1);
        rivets.push_back(test::boxPart({35, 35, 35}, {60, 60, 60})); // crosses the box
        EXPECT_EQ(told(rivets).find("in 7 parts") != std::string::npos, radius < 1);
        Mesh bubble = ball(radius, Vec3d(20.5, 20.5, 20.5));
        test::turnInward(bubble);
        const std::string text = told({box, bubble});
        EXPECT_EQ(text.find("with 1 cavities became") != std::string::npos, radius < 1) << text;
    }
    // A wire of one voxel, on voxels: on its sides is the surface, and nothing inside.
    const Mesh wire = test::boxPart({50, 3, 3}, {51, 40, 4});
    EXPECT_EQ(explained(test::soupOf({box, wire}), 1, Vec3d::Zero()).findings.size(), 1u);
}

// Where floats are coarse, as voxels show; not where they are fine, whole, or were doubles.
TEST(MeshExplained, PositionsRoundedFarFromTheOriginAreTold)
{
    const auto told = [](const Mesh& mesh, double voxelSize) {
        SampleSettings settings;
        settings.lattice = {mesh.frame, voxelSize};
        Interrupter progress;
        voxelize(mesh, settings, &progress);
        return progress.notes().empty() ? std::string() : progress.notes()[0];
    };
    const auto farBall = [](const Vec3d& middle, bool isOfFloats) {
        Mesh mesh = test::ballPart(1, 12);
        for (Vec3f& p : mesh.positions) {
            const Vec3d world = middle + p.cast<double>();
            if (isOfFloats) p = (world.cast<float>().cast<double>() - middle).cast<float>();
        }
        mesh.frame = middle;
        return mesh;
    };
    const Vec3d utm(4e5, 5.4e6, 300), city(4e3, 8e3, 300);
    EXPECT_NE(told(farBall(utm, true), 0.05).find("lie 0.5 apart"), std::string::npos);
    EXPECT_EQ(told(farBall(city, true), 0.05), "");
    EXPECT_EQ(told(farBall(utm, false), 0.05), "");
    Mesh whole = test::boxPart({0, 0, 0}, {3, 4, 5});
    whole.frame = Vec3d(432101, 5412301, 7);
    EXPECT_EQ(told(whole, 0.1), "");
    whole.frame = Vec3d(1e7 + 1, 1e7 + 3, 1e7);
    EXPECT_EQ(told(whole, 0.1), "");
}

// As where a file was written twice in part.
TEST(MeshExplained, TrianglesThatAreThereTwiceCountOnce)
{
    Mesh mesh = test::torusPart(20, 8, 60, 30);
    const MeshExplained whole = explained(mesh, 1);
    for (const std::size_t copies : {std::size_t(1), std::size_t(1000), mesh.triangles.size()}) {
        Mesh twice = mesh;
        twice.triangles.insert(twice.triangles.end(), mesh.triangles.begin(),
                               mesh.triangles.begin() + std::ptrdiff_t(copies));
        const MeshExplained e = explained(twice, 1);
        EXPECT_NEAR(e.volumeIn, whole.volumeIn, 1e-6 * whole.volumeIn);
        EXPECT_EQ(e.partsIn, 1u);
        EXPECT_TRUE(e.findings.empty());
    }
}

TEST(MeshExplained, WallsThinnerThanAVoxelAreTold)
{
    MPUVDB_CASE(file, "T08-thin-tube.stl");
    Interrupter progress;
    const Mesh tube = readMesh(file, &progress);
    for (const double voxels : {20.0, 60.0, 100.0})
        EXPECT_EQ(explained(tube, longestSide(tube) / voxels).findings.size(), 1u) << voxels;
    EXPECT_TRUE(explained(tube, 0.1).findings.empty());
}

// Rods and plates, alone and beside what is thick enough, at any angle; the voxel size that is
// named would do.
// Its faces lie on voxels, and no voxel is inside: all of it is missed, though voxels touch it.
TEST(MeshExplained, WallsBetweenVoxelsAreToldWithWhatShowsThem)
{
    const Mesh plate = test::boxPart({0, 0, 0}, {64, 64, 0.96});
    const MeshExplained e = explained(plate, 1, Vec3d::Zero());
    EXPECT_EQ(e.partsOut, 0u);
    EXPECT_EQ(e.missed, 1);
    ASSERT_EQ(e.findings.size(), 1u);
    const std::string& text = e.findings.front();
    const std::string before = "Voxels of ";
    const double named = std::stod(text.substr(text.rfind(before) + before.size()));
    EXPECT_GT(named, 0.96 / 8) << text; // no smaller than they have to be, to a factor of eight
    EXPECT_TRUE(explained(plate, named, Vec3d::Zero()).findings.empty()) << text;
}

TEST(MeshExplained, ThinRodsAndPlatesAreTold)
{
    Random random(11);
    const std::vector<std::pair<const char*, Mesh>> thin = {
        {"rod", test::pipePart(0.4, 0.1, 40, 12)},
        {"plate", test::boxPart({-20, -15, -0.2}, {20, 15, 0.2})},
        {"hollow", test::soupOf({test::ballPart(15, 12), [] {
                                     Mesh inner = test::ballPart(14.6, 12);
                                     test::turnInward(inner);
                                     return inner;
                                 }()})}};
    for (const auto& [name, part] : thin) {
        SCOPED_TRACE(name);
        std::vector<Mesh> parts = {part, test::boxPart({-12, -12, 30}, {12, 12, 50})};
        const Eigen::Matrix3d turn = rotation(random);
        for (Mesh& p : parts) test::move(p, turn, Vec3d(0.1, 0.2, 0.3));
        EXPECT_EQ(explained(parts[0], 1).findings.size(), 1u);
        EXPECT_EQ(explained(test::soupOf(parts), 1).findings.size(), 1u);
        EXPECT_TRUE(explained(test::soupOf(parts), 0.1).findings.empty());
    }
}

TEST(MeshExplained, PartsThatFaceInwardInNoOtherAreTold)
{
    std::vector<Mesh> parts = {test::ballPart(10, 8), test::ballPart(6, 8)};
    test::move(parts[1], Eigen::Matrix3d::Identity(), Vec3d(30, 0, 0));
    EXPECT_TRUE(explained(test::soupOf(parts), 1).findings.empty());
    test::turnInward(parts[1]);
    EXPECT_EQ(explained(test::soupOf(parts), 1).findings.size(), 1u);
}

TEST(MeshExplained, NothingIsToldOfSoundMeshes)
{
    for (const double h : {0.5, 1.0})
        for (const Mesh& mesh :
             {test::ballPart(10, 9), test::torusPart(16, 6, 40, 20), test::pipePart(14, 9, 20, 40),
              test::knotPart(30, 4, 120, 16), test::boxPart({0, 0, 0}, {20, 20, 20}),
              test::boxPart({0.3, 0.2, 0.1}, {20, 15, 10})})
            EXPECT_TRUE(explained(mesh, h).findings.empty());
    const char* const data = std::getenv("MPUVDB_DATA_DIR");
    if (!data) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    Interrupter progress;
    for (const char* name :
         {"cad/472042.stl", "cad/58011.stl", "cad/908460.stl", "cad/fandisk_large.off",
          "cad/joint.off", "cad/rocker-arm.obj", "berger/anchor.off", "berger/dc.off"})
        for (const double voxels : {60.0, 128.0}) {
            const Mesh mesh = readMesh(std::string(data) + "/" + name, &progress);
            EXPECT_TRUE(explained(mesh, longestSide(mesh) / voxels).findings.empty())
                << name << voxels;
        }
}

} // namespace
} // namespace mpuvdb
