// Meshes keep the edges and corners of what was sampled.
#include "modelling_fixture.h"
#include "uncleaned.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <openvdb/tools/VolumeToMesh.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace mpuvdb::test
{
namespace
{

constexpr double kPi = 3.14159265358979323846;

/// What openvdb::tools::volumeToMesh makes of it: the yardstick.
Mesh yardstick(const LevelSet& levelSet)
{
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(levelSet.grid(), points, quads);
    Mesh mesh;
    for (const openvdb::Vec3s& p : points) mesh.positions.emplace_back(p[0], p[1], p[2]);
    for (const openvdb::Vec4I& q : quads) {
        mesh.triangles.push_back({q[3], q[2], q[1]});
        mesh.triangles.push_back({q[3], q[1], q[0]});
    }
    return mesh;
}

/// How far a mesh is from a solid, near its creases (within two voxels) and away from them.
struct Fit {
    double nearCreases = 0; ///< root mean square, voxels
    double away = 0;        ///< largest, voxels
    double normalError = 0; ///< mean by area, degrees
};

bool isNearCrease(const Solid& solid, const Vec3d& p, double reach)
{
    const Vec3d normal = solid.normal(p);
    for (int n = 0; n < 27; ++n) {
        Vec3d step(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
        if (n == 13) continue;
        Vec3d near = p + reach * step.normalized();
        near -= solid.distance(near) * solid.normal(near);
        if (solid.normal(near).dot(normal) < 0.9) return true;
    }
    return false;
}

/// Whether a triangle faces against all of the surface within half a voxel of its middle.
bool isInverted(const Solid& solid, const Vec3d& middle, const Vec3d& normal, double voxelSize)
{
    for (int n = 0; n < 27; ++n) {
        const Vec3d p = middle + voxelSize / 2 * Vec3d(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
        const Vec3d foot = p - solid.distance(p) * solid.normal(p);
        if (solid.normal(foot).dot(normal) >= 0) return false;
    }
    return true;
}

std::size_t countInverted(const Mesh& mesh, const Solid& solid, double voxelSize)
{
    std::size_t count = 0;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const Vec3d cross = (b - a).cross(c - a);
        if (cross.norm() > 0)
            count += isInverted(solid, (a + b + c) / 3, cross.normalized(), voxelSize);
    }
    return count;
}

Fit fitOf(const Mesh& mesh, const Solid& solid, double voxelSize)
{
    Fit fit;
    double squares = 0, area = 0;
    std::size_t near = 0;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const Vec3d cross = (b - a).cross(c - a), middle = (a + b + c) / 3;
        if (cross.norm() > 0) {
            const double cosine = std::clamp(cross.normalized().dot(solid.normal(middle)), -1., 1.);
            fit.normalError += cross.norm() * std::acos(cosine) * 180 / kPi;
            area += cross.norm();
        }
        for (const Vec3d& p : {middle, Vec3d((a + b) / 2), Vec3d((b + c) / 2)}) {
            const double off = std::abs(solid.distance(p)) / voxelSize;
            if (isNearCrease(solid, p, 2 * voxelSize)) {
                squares += off * off;
                ++near;
            } else {
                fit.away = std::max(fit.away, off);
            }
        }
    }
    fit.nearCreases = std::sqrt(squares / double(std::max<std::size_t>(near, 1)));
    fit.normalError /= area;
    return fit;
}

struct Part {
    const char* solid;
    double timesBetter; ///< than the yardstick near creases
    double normalsBetter = 3;
};

class SharpParts : public testing::TestWithParam<Part>
{
};

TEST_P(SharpParts, KeepTheirEdges)
{
    const double h = 0.04;
    const auto solid = parseSolid(GetParam().solid);
    const FieldPtr field = makeSolidField(solid);
    const LevelSet levelSet = sampled(*field, h);
    const Fit before = fitOf(yardstick(levelSet), *solid, h);
    Interrupter progress;
    for (const bool hasField : {false, true}) {
        const Mesh mesh = extractMesh(levelSet, {hasField ? field.get() : nullptr}, &progress);
        const MeshReport report = measure(mesh);
        EXPECT_EQ(report.boundaryEdges, 0u);
        EXPECT_EQ(report.nonManifoldEdges, 0u);
        const Fit fit = fitOf(mesh, *solid, h);
        EXPECT_LT(fit.nearCreases, hasField ? 0.05 : 0.15) << "voxels";
        EXPECT_LT(fit.nearCreases * GetParam().timesBetter, before.nearCreases);
        EXPECT_LT(fit.normalError * GetParam().normalsBetter, before.normalError);
        EXPECT_LE(fit.away, 1.05 * before.away + 1e-4);
        EXPECT_EQ(countInverted(mesh, *solid, h), 0u);
    }
}

INSTANTIATE_TEST_SUITE_P(
    Solids, SharpParts,
    testing::Values(Part{"box(1.3,1.1,0.9)", 100}, Part{"rotate(box(1.3,1.1,0.9),1,2,3,33)", 20},
                    Part{"rotate(cylinder(0.6,1.2),1,2,3,33)", 8},
                    // About its tip triangles are as large as the surface's radius.
                    Part{"rotate(cone(0.6,1.2),1,2,3,33)", 3, 2},
                    Part{"difference(box(2,2,1),cylinder(0.6,3))", 8},
                    Part{"rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)", 8},
                    // Most of it is round.
                    Part{"union(sphere(1),translate(sphere(0.8),1,0.2,0.1))", 4, 1.5},
                    Part{"rotate(intersection(sphere(1),box(1.5,1.5,1.5)),1,2,3,33)", 5}));

TEST(SharpShapes, AreAsExactAsTheirFormulas)
{
    const double h = 0.04;
    const auto leaf = [](const char* text) {
        return Shape(makeSolidField(parseSolid(text)), text);
    };
    const Eigen::AngleAxisd turn(33 * kPi / 180, Vec3d(1, 2, 3).normalized());
    const Shape shape = (leaf("box(2,2,1)") - leaf("cylinder(0.6,3)")).moved(Eigen::Affine3d(turn));
    const auto solid = parseSolid("rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)");
    ASSERT_TRUE(shape.field());
    Interrupter progress;
    ShapeSettings settings;
    settings.voxelSize = h;
    const LevelSet levelSet = shape.evaluate(settings, &progress);
    const Mesh mesh = extractMesh(levelSet, {shape.field().get()}, &progress);
    const Fit fit = fitOf(mesh, *solid, h), before = fitOf(yardstick(levelSet), *solid, h);
    EXPECT_LT(fit.nearCreases, 0.01) << "voxels";
    EXPECT_LT(fit.nearCreases * 8, before.nearCreases);
    EXPECT_LT(fit.normalError * 3, before.normalError);
    // What only a grid knows has none.
    EXPECT_FALSE(shape.offset(0.1).field());
    EXPECT_FALSE((leaf("sphere(1)") | Shape(levelSet)).field());
    EXPECT_FALSE(Shape::combine(Boolean::Union, {shape, leaf("sphere(1)")}, 0.1).field());
}

class ScannedParts : public testing::TestWithParam<const char*>
{
};

/// Smooth fits round edges off by a tenth of a voxel, which is within any tolerance.
TEST_P(ScannedParts, KeepTheEdgesOfExactPoints)
{
    const double h = 0.03;
    const auto solid = parseSolid(GetParam());
    ScanSettings random;
    random.pattern = ScanSettings::Pattern::Random;
    random.points = std::size_t(2 * 13 / (h * h)); // two for each voxel that the surface passes
    Interrupter progress;
    test::Uncleaned settings;
    settings.voxelSize = Length{h};
    const ReconstructResult made =
        reconstruct(scan(*solid, random, &progress), settings, &progress);
    const Mesh mesh = extractMesh(made.levelSet(), {made.field.get()}, &progress);
    const Fit fit = fitOf(mesh, *solid, h), before = fitOf(yardstick(made.levelSet()), *solid, h);
    EXPECT_LT(fit.nearCreases, 0.02) << "voxels";
    EXPECT_LT(fit.nearCreases * 5, before.nearCreases);
    EXPECT_LT(fit.normalError * 3, before.normalError);
}

INSTANTIATE_TEST_SUITE_P(
    Solids, ScannedParts,
    testing::Values("rotate(box(2,1.5,1),1,2,3,33)",
                    "rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)"));

/// A prism of @a sides about the z axis, of radius 1 and height 1.
Mesh prism(unsigned sides)
{
    Mesh mesh;
    for (const float z : {-0.5f, 0.5f}) {
        mesh.positions.emplace_back(0, 0, z);
        for (unsigned n = 0; n < sides; ++n) {
            const double angle = 2 * kPi * n / sides;
            mesh.positions.emplace_back(std::cos(angle), std::sin(angle), z);
        }
    }
    const unsigned top = sides + 1;
    for (unsigned n = 0; n < sides; ++n) {
        const unsigned a = 1 + n, b = 1 + (n + 1) % sides;
        mesh.triangles.push_back({0, b, a});
        mesh.triangles.push_back({top, top + a, top + b});
        mesh.triangles.push_back({a, b, top + b});
        mesh.triangles.push_back({a, top + b, top + a});
    }
    return mesh;
}

/// How far the triangles on a prism's sides face from the sides that they lie on: mean by area,
/// degrees. @param toPrism  from the mesh's directions to the prism's.
double sideNormalError(const Mesh& mesh, unsigned sides, const Eigen::Quaterniond& toPrism)
{
    double error = 0, area = 0;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = toPrism * mesh.world(t[0]), b = toPrism * mesh.world(t[1]),
                    c = toPrism * mesh.world(t[2]);
        const Vec3d cross = (b - a).cross(c - a), middle = (a + b + c) / 3;
        if (std::abs(middle.z()) > 0.4) continue;
        const double turn = std::atan2(middle.y(), middle.x()) / (2 * kPi) * sides;
        const double angle = 2 * kPi * (std::floor(turn) + 0.5) / sides;
        const double cosine = cross.dot(Vec3d(std::cos(angle), std::sin(angle), 0)) / cross.norm();
        error += cross.norm() * std::acos(std::clamp(cosine, -1., 1.)) * 180 / kPi;
        area += cross.norm();
    }
    return error / area;
}

/// Between flat faces a fold of a few degrees is a crease, too: the surface lies on both.
TEST(FlatFaces, KeepTheirDullFolds)
{
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.6, Vec3d(1, 2, 3).normalized()));
    for (const unsigned sides : {24u, 40u, 60u}) {
        Mesh part = prism(sides);
        for (Vec3f& p : part.positions) p = (turn * p.cast<double>()).cast<float>();
        SampleSettings settings;
        settings.lattice.voxelSize = 1.0 / 40; // a side is 4 voxels wide and more
        Interrupter progress;
        const LevelSet levelSet = voxelize(part, settings, &progress);
        const auto error = [&](const Mesh& mesh) {
            return sideNormalError(mesh, sides, turn.conjugate());
        };
        const double kept = error(extractMesh(levelSet, {}, &progress));
        EXPECT_LT(kept, 0.03 * 360 / sides) << "degrees, " << sides << " sides";
        EXPECT_LT(5 * kept, error(yardstick(levelSet))) << sides << " sides";
    }
}

/// Exact points at random places of a mesh, with the normals of its triangles.
PointCloud pointsOn(const Mesh& mesh, std::size_t count)
{
    std::vector<double> area;
    const auto crossOf = [&](const Mesh::Triangle& t) -> Vec3d {
        return (mesh.world(t[1]) - mesh.world(t[0])).cross(mesh.world(t[2]) - mesh.world(t[0]));
    };
    for (const Mesh::Triangle& t : mesh.triangles) area.push_back(crossOf(t).norm());
    std::mt19937_64 random(7);
    std::discrete_distribution<std::size_t> pick(area.begin(), area.end());
    std::uniform_real_distribution<double> share;
    PointCloud cloud;
    for (std::size_t n = 0; n < count; ++n) {
        const Mesh::Triangle& t = mesh.triangles[pick(random)];
        const double s = std::sqrt(share(random)), u = share(random);
        const Vec3d p =
            (1 - s) * mesh.world(t[0]) + s * (1 - u) * mesh.world(t[1]) + s * u * mesh.world(t[2]);
        cloud.positions.push_back(p.cast<float>());
        cloud.normals.push_back(crossOf(t).normalized().cast<float>());
    }
    return cloud;
}

/// A smooth fit may round dull folds off within the tolerance, but exact normals know of them.
TEST(FlatFaces, OfExactPointsKeepTheirDullFolds)
{
    const unsigned sides = 40;
    const double h = 1.0 / 60; // a side is nine voxels wide
    test::Uncleaned settings;
    settings.voxelSize = Length{h};
    Interrupter progress;
    const ReconstructResult made =
        reconstruct(pointsOn(prism(sides), std::size_t(2 * 13 / (h * h))), settings, &progress);
    const auto error = [&](const Mesh& mesh) {
        return sideNormalError(mesh, sides, Eigen::Quaterniond::Identity());
    };
    const double kept = error(extractMesh(made.levelSet(), {made.field.get()}, &progress));
    EXPECT_LT(3 * kept, error(yardstick(made.levelSet())));
    EXPECT_LT(kept, 0.03 * 360 / sides) << "degrees";
}

/// The largest distance of a vertex from a sphere of radius 1, voxels of edge @a h, and the
/// smallest angle that 99 % of the triangles keep.
TEST(SmoothMeshes, ConvergeWithSecondOrderAndHaveGoodAngles)
{
    std::vector<double> errors;
    for (const double h : {0.1, 0.05, 0.025}) {
        const FieldPtr field = makeSolidField(parseSolid("translate(sphere(1),0.013,0.027,0.009)"));
        Interrupter progress;
        const Mesh mesh = extractMesh(sampled(*field, h), {}, &progress);
        double worst = 0;
        std::vector<double> angles;
        for (const Mesh::Triangle& t : mesh.triangles) {
            const std::array<Vec3d, 3> p = {mesh.world(t[0]), mesh.world(t[1]), mesh.world(t[2])};
            double least = kPi;
            for (std::size_t n = 0; n < 3; ++n) {
                const Vec3d u = (p[(n + 1) % 3] - p[n]).normalized(),
                            v = (p[(n + 2) % 3] - p[n]).normalized();
                least = std::min(least, std::acos(std::clamp(u.dot(v), -1., 1.)));
            }
            angles.push_back(least * 180 / kPi);
            const Vec3d middle = (p[0] + p[1] + p[2]) / 3;
            worst = std::max(worst, std::abs((middle - Vec3d(0.013, 0.027, 0.009)).norm() - 1));
        }
        errors.push_back(worst);
        std::sort(angles.begin(), angles.end());
        EXPECT_GT(angles[angles.size() / 100], 20) << h;
    }
    EXPECT_GT(std::log2(errors[0] / errors[1]), 1.7);
    EXPECT_GT(std::log2(errors[1] / errors[2]), 1.7);
}

/// A grid of the values of @a value at voxels 0 .. @a edge, outside about them.
LevelSet filled(int edge, const std::function<bool(const openvdb::Coord&)>& isInside)
{
    auto grid = openvdb::FloatGrid::create(1);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    auto accessor = grid->getAccessor();
    for (int x = -1; x <= edge + 1; ++x)
        for (int y = -1; y <= edge + 1; ++y)
            for (int z = -1; z <= edge + 1; ++z)
                accessor.setValue({x, y, z}, isInside({x, y, z}) ? -0.5f : 0.5f);
    return LevelSet(grid);
}

void expectClosedManifold(const LevelSet& levelSet, std::uint64_t leastTriangles)
{
    const MeshReport report = meshed(levelSet);
    EXPECT_GE(report.triangles, leastTriangles);
    EXPECT_EQ(report.boundaryEdges, 0u);
    EXPECT_EQ(report.nonManifoldEdges, 0u);
    EXPECT_GT(report.volume, 0);
}

TEST(ManifoldMeshes, OfEveryPairOfNeighboringCells)
{
    // Two cells that share a face have twelve corners: 4096 pairs along each axis.
    for (int axis = 0; axis < 3; ++axis) {
        constexpr int kRow = 64, kApart = 5;
        auto grid = openvdb::FloatGrid::create(1);
        grid->setGridClass(openvdb::GRID_LEVEL_SET);
        auto accessor = grid->getAccessor();
        for (int pair = 0; pair < 4096; ++pair) {
            const openvdb::Coord at(kApart * (pair % kRow), kApart * (pair / kRow), 0);
            for (int x = -1; x <= 3; ++x)
                for (int y = -1; y <= 3; ++y)
                    for (int z = -1; z <= 3; ++z) accessor.setValue(at.offsetBy(x, y, z), 0.5f);
            for (int corner = 0; corner < 12; ++corner) {
                openvdb::Coord step;
                step[axis] = corner / 4;
                step[(axis + 1) % 3] = corner / 2 % 2;
                step[(axis + 2) % 3] = corner % 2;
                if (pair >> corner & 1) accessor.setValue(at + step, -0.5f);
            }
        }
        expectClosedManifold(LevelSet(grid), 4096 * 8);
    }
}

TEST(ManifoldMeshes, OfCheckerboardsAndSlabsOfOneVoxel)
{
    expectClosedManifold(filled(15,
                                [](const openvdb::Coord& c) {
                                    const auto in = [](int i) { return i >= 0 && i <= 15; };
                                    return in(c[0]) && in(c[1]) && in(c[2]) &&
                                           (c[0] + c[1] + c[2]) % 2 == 0;
                                }),
                         16 * 16 * 16 / 2 * 8);
    for (int axis = 0; axis < 3; ++axis)
        expectClosedManifold(filled(15,
                                    [&](const openvdb::Coord& c) {
                                        const auto in = [](int i) { return i >= 2 && i <= 13; };
                                        return c[axis] == 7 && in(c[(axis + 1) % 3]) &&
                                               in(c[(axis + 2) % 3]);
                                    }),
                             2 * 12 * 12);
}

TEST(ManifoldMeshes, OfRandomSolids)
{
    constexpr int kSolids = 120;
    std::size_t triangles = 0, crossings = 0, inverted = 0;
    std::mt19937_64 random(20261122);
    RecordProperty("seed", "20261122");
    const auto uniform = [&](double low, double high) {
        return low + (high - low) * std::ldexp(double(random() >> 11), -53);
    };
    for (int n = 0; n < kSolids; ++n) {
        std::string text = fmt::format("intersection(sphere(0.7),rotate(box({},{},{}),{},{},1,{}))",
                                       uniform(.3, 1.5), uniform(.3, 1.5), uniform(.3, 1.5),
                                       uniform(-1, 1), uniform(-1, 1), uniform(0, 180));
        for (int k = 0; k < 4; ++k) {
            const char* const operation = std::array{"union", "difference"}[random() % 2];
            const std::string other =
                random() % 2 ? fmt::format("sphere({})", uniform(.2, .8))
                             : fmt::format("rotate(cylinder({},{}),1,{},{},{})", uniform(.1, .6),
                                           uniform(.2, 1.5), uniform(-1, 1), uniform(-1, 1),
                                           uniform(0, 180));
            text = fmt::format("{}({},translate({},{},{},{}))", operation, text, other,
                               uniform(-.6, .6), uniform(-.6, .6), uniform(-.6, .6));
        }
        const auto solid = parseSolid(text);
        const FieldPtr field = makeSolidField(solid);
        SampleSettings settings;
        settings.lattice.voxelSize = 0.09;
        settings.mayBeEmpty = true;
        Interrupter progress;
        const LevelSet levelSet = sampleField(*field, settings, &progress);
        for (const Field* oracle : {static_cast<const Field*>(nullptr), field.get()}) {
            const Mesh mesh = extractMesh(levelSet, {oracle}, &progress);
            triangles += mesh.triangles.size();
            crossings += findSelfIntersections(mesh, &progress).size();
            inverted += countInverted(mesh, *solid, settings.lattice.voxelSize);
            const Mesh strict = extractMesh(levelSet, {oracle, true}, &progress);
            EXPECT_EQ(findSelfIntersections(strict, &progress).size(), 0u) << text;
            for (const MeshReport& report : {measure(mesh), measure(strict)}) {
                EXPECT_EQ(report.boundaryEdges, 0u) << text;
                EXPECT_EQ(report.nonManifoldEdges, 0u) << text;
            }
        }
    }
    // Details of a voxel and less; without --strict.
    EXPECT_LT(double(crossings), 2.5e-3 * double(triangles));
    EXPECT_LT(double(inverted), 5e-5 * double(triangles));
}

} // namespace
} // namespace mpuvdb::test
