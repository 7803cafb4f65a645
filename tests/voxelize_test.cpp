// Meshes as level sets, level sets as fields, and on other lattices.
#include "io_fixture.h"
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace mpuvdb
{
namespace
{

using test::sampled;
using test::solidField;
using Exact = std::function<double(const Vec3d&)>;

Exact exactly(const std::string& description)
{
    return [solid = parseSolid(description)](const Vec3d& p) { return solid->distance(p); };
}

Mesh boxMesh(const Vec3d& half, const Vec3d& frame = Vec3d::Zero())
{
    Mesh mesh;
    mesh.frame = frame;
    for (int i = 0; i < 8; ++i)
        mesh.positions.push_back(Vec3d(i & 1 ? half[0] : -half[0], i & 2 ? half[1] : -half[1],
                                       i & 4 ? half[2] : -half[2])
                                     .cast<float>());
    const std::array<std::array<std::uint32_t, 4>, 6> faces = {
        {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}};
    for (const auto& f : faces) {
        mesh.triangles.push_back({f[0], f[1], f[2]});
        mesh.triangles.push_back({f[0], f[2], f[3]});
    }
    return mesh;
}

Mesh torusMesh(double major, double minor, std::uint32_t around, std::uint32_t tube)
{
    Mesh mesh;
    for (std::uint32_t i = 0; i < around; ++i)
        for (std::uint32_t j = 0; j < tube; ++j) {
            const double a = 2 * M_PI * i / around, b = 2 * M_PI * j / tube;
            const double rho = major + minor * std::cos(b);
            mesh.positions.push_back(
                Vec3d(rho * std::cos(a), rho * std::sin(a), minor * std::sin(b)).cast<float>());
            const auto at = [&](std::uint32_t m, std::uint32_t n) {
                return m % around * tube + n % tube;
            };
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    return mesh;
}

LevelSet voxelized(const Mesh& mesh, double voxelSize, double halfWidth = 3,
                   const Vec3d& origin = Vec3d(1e-3, 2e-3, 3e-3))
{
    SampleSettings settings;
    settings.lattice = {origin, voxelSize};
    settings.halfWidth = halfWidth;
    Interrupter progress;
    return voxelize(mesh, settings, &progress);
}

// --- Meshes

/// Of values to floats, voxels.
constexpr double kRounding = 1e-4;

TEST(Voxelize, GivesTheDistanceToTheMesh)
{
    for (const double halfWidth : {3.0, 6.0}) {
        const LevelSet box = voxelized(boxMesh({0.6, 0.5, 0.4}), 1.0 / 32, halfWidth);
        test::expectSound(box);
        const test::Deviation ofBox = test::deviation(box, exactly("box(1.2, 1, 0.8)"));
        EXPECT_LT(ofBox.largest, kRounding);
        EXPECT_EQ(ofBox.wrongSigns, 0u);
        const LevelSet torus = voxelized(torusMesh(1, 0.4, 300, 150), 1.0 / 24, halfWidth);
        test::expectSound(torus);
        const test::Deviation ofTorus = test::deviation(torus, exactly("torus(1, 0.4)"));
        // How far the mesh's facets lie inside, and what bends that adds where fronts meet.
        const double facets =
            24 * (1.4 * (1 - std::cos(M_PI / 300)) + 0.4 * (1 - std::cos(M_PI / 150)));
        EXPECT_LT(ofTorus.largest, 3 * facets + kRounding);
        EXPECT_EQ(ofTorus.wrongSigns, 0u);
        EXPECT_NEAR(torus.halfWidth(), halfWidth, 1e-6);
        EXPECT_EQ(torus.grid().getName(), "surface");
        // The inactive inside is inside.
        const auto at = torus.grid().getConstAccessor();
        EXPECT_EQ(at.getValue({24, 0, 0}), -torus.grid().background());
        EXPECT_EQ(at.getValue({0, 0, 0}), torus.grid().background());
    }
}

/// A tetrahedron with corners at random, not too flat, which face outwards.
Mesh tetrahedron(test::Random& random, double size)
{
    Mesh mesh;
    double volume = 0;
    while (std::abs(volume) < 0.02 * size * size * size) {
        mesh.positions.clear();
        for (int i = 0; i < 4; ++i)
            mesh.positions.push_back((size * random.inCube(0.5)).cast<float>());
        const Vec3d a = mesh.world(0);
        volume = (mesh.world(1) - a).cross(mesh.world(2) - a).dot(mesh.world(3) - a) / 6;
    }
    if (volume < 0) std::swap(mesh.positions[2], mesh.positions[3]);
    mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    return mesh;
}

bool holds(const Mesh& convex, const Vec3d& p)
{
    return std::all_of(convex.triangles.begin(), convex.triangles.end(), [&](const auto& t) {
        const Vec3d a = convex.world(t[0]);
        return (convex.world(t[1]) - a).cross(convex.world(t[2]) - a).dot(p - a) < 0;
    });
}

double distanceToEdge(const Vec3d& p, const Vec3d& a, const Vec3d& b)
{
    const double t = (p - a).dot(b - a) / (b - a).squaredNorm();
    return (p - a - std::clamp(t, 0.0, 1.0) * (b - a)).norm();
}

double distanceTo(const Mesh& mesh, const Vec3d& p)
{
    double least = HUGE_VAL;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        // No place of a triangle is farther from a corner than another corner is.
        if ((p - a).norm() - std::max((b - a).norm(), (c - a).norm()) > least) continue;
        const Vec3d normal = (b - a).cross(c - a).normalized();
        const auto isLeft = [&](const Vec3d& from, const Vec3d& to) {
            return normal.dot((to - from).cross(p - from)) >= 0;
        };
        least = std::min(
            {least, distanceToEdge(p, a, b), distanceToEdge(p, b, c), distanceToEdge(p, c, a)});
        if (isLeft(a, b) && isLeft(b, c) && isLeft(c, a))
            least = std::min(least, std::abs(normal.dot(p - a)));
    }
    return least;
}

TEST(Voxelize, GivesTheDistanceAndTheSideOfSharpCorners)
{
    test::Random random(31);
    for (int n = 0; n < 20; ++n) {
        SCOPED_TRACE("seed 31, solid " + std::to_string(n));
        const Mesh mesh = tetrahedron(random, 40);
        const LevelSet levelSet = voxelized(mesh, 1);
        test::expectSound(levelSet);
        const auto at = levelSet.grid().getConstAccessor();
        openvdb::CoordBBox box = levelSet.grid().evalActiveVoxelBoundingBox();
        box.expand(2);
        for (auto voxel = box.begin(); voxel; ++voxel) {
            const Vec3d p =
                levelSet.lattice().origin + Vec3d((*voxel).x(), (*voxel).y(), (*voxel).z());
            const double distance = distanceTo(mesh, p);
            const double expected = std::min(distance, 3.0) * (holds(mesh, p) ? -1 : 1);
            ASSERT_NEAR(at.getValue(*voxel), expected, kRounding) << *voxel;
            if (std::abs(distance - 3) > kRounding) {
                ASSERT_EQ(at.isValueOn(*voxel), distance < 3) << *voxel;
            }
        }
    }
}

/// Errors in voxels, sorted, of a level set's values in one voxel of @a stride.
std::vector<double> sortedErrors(const LevelSet& levelSet, int stride,
                                 const std::function<double(const Vec3d&)>& distance)
{
    const Lattice lattice = levelSet.lattice();
    std::vector<double> errors;
    int n = 0;
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on) {
        if (n++ % stride != 0) continue;
        const double exact = distance(test::worldOf(lattice, on.getCoord()));
        errors.push_back(std::abs(double(*on) - exact) / lattice.voxelSize);
    }
    std::sort(errors.begin(), errors.end());
    return errors;
}

// Far from a ridge as blunt as between these facets, down to two voxels wide, a plane that goes on
// beyond it is too near; the values a voxel or two off tell where it ends.
TEST(Voxelize, OffsetsOfBluntRidgesAreTheirDistance)
{
    Interrupter progress;
    for (const std::uint32_t tube : {16u, 24u, 60u})
        for (const double shift : {8.0, 20.0}) {
            SCOPED_TRACE(fmt::format("{} facets around the tube, offset {}", tube, shift));
            const Mesh mesh = torusMesh(60, 24, 2 * tube, tube);
            const LevelSet grown = offset(voxelized(mesh, 1), shift, &progress);
            const auto errors = sortedErrors(
                grown, 240, [&](const Vec3d& p) { return distanceTo(mesh, p) - shift; });
            const auto quantile = [&](double q) {
                return errors[std::size_t(q * double(errors.size() - 1))];
            };
            EXPECT_LE(quantile(0.5), 0.01);
            EXPECT_LE(quantile(0.99), 0.05);
            EXPECT_LE(errors.back(), 0.12);
        }
}

TEST(Voxelize, GivesSoundGridsOfCadParts)
{
    const char* data = std::getenv("MPUVDB_DATA_DIR");
    if (!data) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    Interrupter progress;
    for (const char* name : {"fandisk_large.off", "rocker-arm.obj", "908460.stl", "58011.stl"})
        for (const double voxels : {80.0, 130.0}) {
            SCOPED_TRACE(name + std::string(" at ") + std::to_string(voxels));
            const Mesh mesh = readMesh(std::string(data) + "/cad/" + name, &progress);
            const MeshReport truth = measure(mesh);
            Box3d box;
            for (std::size_t v = 0; v < mesh.positions.size(); ++v) box.extend(mesh.world(v));
            const double h = box.sizes().maxCoeff() / voxels;
            const LevelSet levelSet = voxelized(mesh, h);
            EXPECT_TRUE(
                check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress)
                    .sound());
            // Linear between voxels, edges are cut: at most half a voxel deep, and wide.
            EXPECT_NEAR(measure(extractMesh(levelSet, {}, &progress)).volume, truth.volume,
                        0.02 * truth.area * h);
        }
}

TEST(Voxelize, ClosesGapsAndRefusesHoles)
{
    const Mesh whole = torusMesh(1, 0.4, 60, 30);
    Mesh gap = whole, hole = whole;
    gap.triangles.erase(gap.triangles.begin() + 400); // sides of 0.1
    const LevelSet closed = voxelized(gap, 0.2);
    test::expectSound(closed);
    Interrupter progress;
    EXPECT_NEAR(measure(extractMesh(closed, {}, &progress)).volume,
                measure(extractMesh(voxelized(whole, 0.2), {}, &progress)).volume, 0.02);
    hole.triangles.resize(hole.triangles.size() - 240); // four rings of the tube
    EXPECT_THROW(voxelized(hole, 0.02), InputError);
}

TEST(Voxelize, KeepsItsPrecisionFarFromTheOrigin)
{
    const Vec3d far(4e6, -3e6, 5e6);
    const LevelSet near = voxelized(boxMesh({0.6, 0.5, 0.4}), 1.0 / 32, 3, Vec3d::Zero());
    const LevelSet there = voxelized(boxMesh({0.6, 0.5, 0.4}, far), 1.0 / 32, 3, far);
    EXPECT_EQ(test::treeBytes(near.grid()), test::treeBytes(there.grid()));
    EXPECT_EQ(there.lattice().origin, far);
}

TEST(Voxelize, DoesNotDependOnThreads)
{
    const Mesh mesh = torusMesh(1, 0.4, 60, 30);
    std::vector<std::string> bytes;
    for (const std::size_t threads : {1u, 2u, 8u}) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Interrupter progress;
        const LevelSet made = voxelized(mesh, 1.0 / 32);
        bytes.push_back(test::treeBytes(made.grid()) +
                        test::treeBytes(offset(made, 0.3, &progress).grid()) +
                        test::treeBytes(offset(made, -0.2, &progress).grid()));
    }
    EXPECT_TRUE(bytes[0] == bytes[1]);
    EXPECT_TRUE(bytes[0] == bytes[2]);
}

TEST(Voxelize, RefusesWhatIsNoSolid)
{
    EXPECT_THROW(voxelized(Mesh(), 0.1), InputError);
    Mesh bad = boxMesh({1, 1, 1});
    bad.triangles[3][1] = 8;
    EXPECT_THROW(voxelized(bad, 0.1), InputError);
    bad = boxMesh({1, 1, 1});
    bad.positions[5][2] = std::nanf("");
    EXPECT_THROW(voxelized(bad, 0.1), InputError);
    Mesh sheet = boxMesh({1, 1, 1});
    sheet.triangles.resize(2);
    EXPECT_THROW(voxelized(sheet, 0.1), InputError);
    EXPECT_THROW(voxelized(boxMesh({1, 1, 1}), 0), UsageError);
    EXPECT_THROW(voxelized(boxMesh({1, 1, 1}), 0.1, 1), UsageError);
    EXPECT_THROW(voxelized(boxMesh({1, 1, 1}), 2e-5, 3, Vec3d::Constant(1e7)), LimitError);
    SampleSettings settings;
    settings.lattice.voxelSize = 0.01;
    settings.maxBytes = 1000000;
    Interrupter progress;
    EXPECT_THROW(voxelize(boxMesh({1, 1, 1}), settings, &progress), LimitError);
    settings.maxBytes = 100000000;
    EXPECT_NO_THROW(voxelize(boxMesh({1, 1, 1}), settings, &progress));
    progress.stop();
    EXPECT_THROW(voxelize(boxMesh({1, 1, 1}), settings, &progress), Interrupted);
}

class ReadMesh : public test::IoTest
{
};

TEST_F(ReadMesh, ReadsWhatIsWritten)
{
    Interrupter progress;
    const Mesh mesh = boxMesh({1, 2, 3}, {10, 20, 30});
    for (const char* name : {"box.ply", "box.obj", "box.stl"}) {
        SCOPED_TRACE(name);
        writeMesh(path(name), mesh, {}, &progress);
        const Mesh back = readMesh(path(name), &progress);
        const MeshReport report = measure(back);
        EXPECT_EQ(report.vertices, 8u);
        EXPECT_EQ(report.triangles, 12u);
        EXPECT_EQ(report.boundaryEdges, 0u);
        EXPECT_NEAR(report.volume, 48, 1e-4);
        EXPECT_LT((back.frame - mesh.frame).norm(), 1e-5);
    }
}

TEST_F(ReadMesh, LeavesOutVerticesWithoutTriangles)
{
    Interrupter progress;
    const auto read = [&](const char* name, const std::string& text) {
        return readMesh(put(name, text), &progress);
    };
    const Mesh mesh = read("a.off", "OFF\n5 2 0\n9 9 9\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
                                    "4 1 2 3 4\n3 1 2 3\n");
    EXPECT_EQ(mesh.positions.size(), 4u);
    ASSERT_EQ(mesh.triangles.size(), 3u);
    EXPECT_EQ(mesh.world(mesh.triangles[2][1]), Vec3d(1, 0, 0));
    EXPECT_EQ(mesh.frame, Vec3d(0.5, 0.5, 0));
    EXPECT_THROW(read("points.xyz", "0 0 0\n1 0 0\n0 1 0\n"), InputError);
    EXPECT_THROW(read("bare.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"), InputError);
    EXPECT_THROW(read("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), InputError);
    EXPECT_THROW(read("damaged.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"), InputError);
}

// --- Grids as fields

TEST(GridField, ConvergesToTheSurface)
{
    for (const char* description : {"sphere(1)", "torus(1, 0.4)"}) {
        SCOPED_TRACE(description);
        const auto solid = parseSolid(description);
        std::vector<double> errors;
        for (const double n : {10.0, 20.0, 40.0}) {
            const FieldPtr field =
                makeGridField(sampled(*makeSolidField(solid), 1 / n, 3, Vec3d(1e-3, 2e-3, 3e-3)));
            double sum = 0, slopes = 0;
            int count = 0;
            test::forRandomPlaces(solid->bounds(), 51, 3000, [&](const Vec3d& p, test::Random&) {
                const double d = solid->distance(p);
                if (std::abs(d) > 0.5 / n) return;
                const FieldSample sample = field->evaluate(p);
                sum += std::abs(sample.value - d);
                slopes += (sample.gradient - solid->normal(p)).norm();
                ++count;
            });
            errors.push_back(sum / count);
            EXPECT_LT(slopes / count, 0.02);
        }
        RecordProperty(description, std::to_string(errors[2]));
        // Third order at least.
        EXPECT_LT(errors[1], errors[0] / 7);
        EXPECT_LT(errors[2], errors[1] / 7);
    }
}

TEST(GridField, FindsAllItsSurfaces)
{
    const std::string solid =
        "union(translate(sphere(0.5), -2, 0, 0), "
        "difference(sphere(1), sphere(0.6)), translate(sphere(0.1), 0, 0, 3))";
    const LevelSet levelSet = sampled(*solidField(solid), 1.0 / 24);
    const FieldPtr field = makeGridField(levelSet);
    EXPECT_TRUE(field->bounds().contains(Vec3d(0, 0, 3.09)));
    EXPECT_FALSE(field->bounds().contains(Vec3d(0, 0, 3.3)));
    EXPECT_LT(field->evaluate({0.8, 0, 0}).value, 0);
    EXPECT_GT(field->evaluate({0, 0, 0}).value, 0);
    EXPECT_GT(field->evaluate({1e300, 0, 0}).value, 0);
    const LevelSet again = sampled(*field, 1.0 / 20, 1.5, Vec3d(0.01, 0.02, 0.03));
    EXPECT_EQ(test::meshed(again).components, 4u);
}

// --- Other lattices

TEST(Resample, GoesToSmallerAndLargerVoxels)
{
    for (const char* description : {"torus(1, 0.4)", "rotate(box(1.2, 1, 1.4), 1, 2, 3, 40)"}) {
        SCOPED_TRACE(description);
        const bool smooth = description[0] == 't';
        const LevelSet levelSet = sampled(*solidField(description), 1.0 / 24);
        for (const double size : {1.0 / 60, 1.0 / 31, 1.0 / 24, 1.0 / 17, 1.0 / 8}) {
            SCOPED_TRACE(size);
            for (const double halfWidth : {1.5, 3.0, 5.0}) {
                Interrupter progress;
                const Lattice lattice{Vec3d(0.011, -0.007, 0.003), size};
                const LevelSet result = resample(levelSet, lattice, halfWidth, &progress);
                test::expectSound(result);
                EXPECT_NEAR(result.halfWidth(), halfWidth, 1e-5);
                EXPECT_EQ(result.lattice().origin, lattice.origin);
                const test::Deviation d = test::deviation(result, exactly(description));
                const double coarser = std::max(size * 24, 1 / (size * 24));
                EXPECT_LT(d.mean, (smooth ? 0.02 : 0.08) * coarser);
                if (smooth) {
                    EXPECT_EQ(d.wrongSigns, 0u);
                }
            }
        }
    }
}

/// Voxels 20 and 50 times as large: each one's distance is searched, for which no band of the
/// source is wide enough.
TEST(Resample, SearchesTheDistancesOfMuchLargerVoxels)
{
    for (const char* description : {"torus(1, 0.4)", "rotate(box(1.2, 1, 1.4), 1, 2, 3, 40)"}) {
        SCOPED_TRACE(description);
        const LevelSet levelSet = sampled(*solidField(description), 1.0 / 80);
        for (const double ratio : {10.3, 20.7}) {
            SCOPED_TRACE(ratio);
            Interrupter progress;
            const LevelSet result =
                resample(levelSet, {Vec3d(0.011, -0.007, 0.003), ratio / 80}, 3, &progress);
            test::expectSound(result);
            const test::Deviation d = test::deviation(result, exactly(description));
            EXPECT_LT(d.mean, 0.0002);
            EXPECT_LT(d.largest, 0.05);
            EXPECT_EQ(progress.notes().size(), 0u);
        }
    }
}

TEST(Resample, GoesThereAndBack)
{
    const LevelSet levelSet = sampled(*solidField("torus(1, 0.4)"), 1.0 / 24);
    Interrupter progress;
    const LevelSet there =
        resample(levelSet, {Vec3d(0.011, -0.007, 0.003), 1.0 / 29}, 3, &progress);
    const LevelSet back = resample(there, levelSet.lattice(), 3, &progress);
    const test::Deviation d = test::deviation(back, exactly("torus(1, 0.4)"));
    RecordProperty("mean", std::to_string(d.mean));
    EXPECT_LT(d.mean, 0.005);
    EXPECT_LT(d.largest, 0.05);
}

TEST(Resample, KeepsValuesWhereVoxelsCoincide)
{
    const LevelSet levelSet = sampled(*solidField("torus(1, 0.4)"), 0.05);
    Interrupter progress;
    const Lattice shifted{Vec3d(3 * 0.05, -7 * 0.05, 16 * 0.05), 0.05};
    const LevelSet result = resample(levelSet, shifted, 3, &progress);
    EXPECT_EQ(result.grid().activeVoxelCount(), levelSet.grid().activeVoxelCount());
    const auto at = result.grid().getConstAccessor();
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on)
        ASSERT_EQ(*on, at.getValue(on.getCoord() - openvdb::Coord(3, -7, 16)));
    EXPECT_EQ(test::treeBytes(resample(levelSet, levelSet.lattice(), 3, &progress).grid()),
              test::treeBytes(levelSet.grid()));
    EXPECT_THROW(resample(levelSet, {Vec3d::Zero(), 0}, 3, &progress), UsageError);
    EXPECT_THROW(resample(levelSet, shifted, 1, &progress), UsageError);
}

TEST(Resample, TellsWhereVoxelsAreTooLarge)
{
    const double radius = 1;
    const LevelSet levelSet = sampled(*solidField("sphere(1)"), radius / 12);
    const auto notes = [&](double voxelSize) {
        Interrupter progress;
        resample(levelSet, {Vec3d::Zero(), voxelSize}, 3, &progress);
        return progress.notes();
    };
    for (const double diameter : {40.0, 12.0, 6.0}) // voxels
        EXPECT_TRUE(notes(2 * radius / diameter).empty()) << diameter;
    for (const double diameter : {2.5, 1.5}) {
        const auto said = notes(2 * radius / diameter);
        ASSERT_EQ(said.size(), 1u) << diameter;
        EXPECT_NE(said[0].find("too large for the solid: its volume was 4.189 and is"),
                  std::string::npos)
            << said[0];
    }
}

TEST(Resample, KeepsWhatIsEmpty)
{
    auto grid = openvdb::FloatGrid::create(0.3f);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(0.1));
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    Interrupter progress;
    const LevelSet result = resample(LevelSet(grid), {Vec3d::Zero(), 0.2}, 4, &progress);
    EXPECT_EQ(result.grid().activeVoxelCount(), 0u);
    EXPECT_NEAR(result.halfWidth(), 4, 1e-6);
}

} // namespace
} // namespace mpuvdb
