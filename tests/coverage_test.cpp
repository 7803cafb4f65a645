// Where data support a surface: the grid that says so, and meshes trimmed by it.
#include "field_fixture.h"
#include "mesh/cut_mesh.h"
#include "mpu/evidence/points_around.h"
#include "uncleaned.h"

#include <mpuvdb/error.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstring>
#include <map>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using test::treeBytes;

/// A round hole: its axis, and the angle about it within which there is no point.
struct Hole {
    Vec3d axis;
    double angle;
};

/// Even points on the unit sphere, without those in the holes.
PointCloud holedSphere(const std::vector<Hole>& holes, std::uint64_t points = 20000)
{
    ScanSettings settings;
    settings.points = points;
    PointCloud all = test::scanOf("sphere(1)", settings), cloud;
    cloud.frame = all.frame;
    for (std::size_t i = 0; i < all.size(); ++i) {
        const Vec3d p = all.world(i).normalized();
        if (std::any_of(holes.begin(), holes.end(),
                        [&](const Hole& hole) { return p.dot(hole.axis) > std::cos(hole.angle); }))
            continue;
        cloud.positions.push_back(all.positions[i]);
        cloud.normals.push_back(all.normals[i]);
    }
    return cloud;
}

/// A level set with its coverage.
struct Covered {
    ReconstructResult made;
    FloatGrid::Ptr coverage;
    double spacing;
};

Covered covered(PointCloud cloud, double voxelSize)
{
    test::Uncleaned settings;
    settings.voxelSize = Length{voxelSize, Length::Unit::World};
    Interrupter progress;
    ReconstructResult made = reconstruct(std::move(cloud), settings, &progress);
    const auto coverage = made.field->coverage(&progress);
    FloatGrid::Ptr grid = sampleCoverage(made.levelSet(), *coverage, &progress);
    return {std::move(made), std::move(grid), coverage->spacing()};
}

Mesh trimmed(const Covered& model, double closeUpTo, TrimReport& report)
{
    Interrupter progress;
    return trimMesh(extractMesh(model.made.levelSet(), {}, &progress), *model.coverage,
                    trimSettings(*model.coverage, closeUpTo), report, &progress);
}

float least(const FloatGrid& grid)
{
    float value = 1;
    for (auto v = grid.cbeginValueOn(); v; ++v) value = std::min(value, *v);
    return value;
}

/// Vertices at the ends of edges with one triangle.
std::vector<std::uint32_t> rimOf(const Mesh& mesh)
{
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
    for (const Mesh::Triangle& t : mesh.triangles)
        for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(t[k], t[(k + 1) % 3])];
    std::vector<std::uint32_t> rim;
    for (const auto& [edge, count] : uses) {
        if (count > 1) continue;
        rim.push_back(edge.first);
        rim.push_back(edge.second);
    }
    return rim;
}

/// Smallest height of a triangle over its longest side, of those with a vertex on the rim.
double thinnestAtRim(const Mesh& mesh)
{
    std::vector<char> onRim(mesh.positions.size(), 0);
    for (const std::uint32_t v : rimOf(mesh)) onRim[v] = 1;
    double thinnest = 1;
    for (const Mesh::Triangle& t : mesh.triangles) {
        if (!onRim[t[0]] && !onRim[t[1]] && !onRim[t[2]]) continue;
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const double side2 =
            std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
        thinnest = std::min(thinnest, (b - a).cross(c - a).norm() / side2);
    }
    return thinnest;
}

/// The spacing at the rim of the data by that of the others: half a disc of neighbors measures it.
const double kRimSpacing = std::sqrt(2);

/// How far the convex hull of the points about a place at the rim of a round hole reaches into it,
/// spacings: the height of an arc over a chord of twice the points' reach.
double hullBeyondRim(double radius, double spacing)
{
    const double reach = 3.75 * kRimSpacing;
    return reach * reach / (2 * radius / spacing);
}

const Hole kLarge{Vec3d::UnitX(), 0.8}, kSmall{-Vec3d::UnitY(), 0.35};

TEST(Coverage, IsOneOnCompleteData)
{
    for (const char* solid : {"sphere(1)", "roundedbox(2, 1.6, 1.2, 0.3)", "box(1, 2, 1)",
                              "box(2, 2, 0.1)", "cone(1, 1)"}) {
        const Covered model = covered(test::randomScan(solid, 30000), 0.03);
        // Beyond edges of 45 degrees a voxel's way to the surface may lead past it.
        if (std::string(solid) != "cone(1, 1)") {
            EXPECT_EQ(least(*model.coverage), 1.0f) << solid;
        }
        TrimReport report;
        const Mesh mesh = trimmed(model, 0, report);
        EXPECT_EQ(report.open + report.closed + report.islands, 0u);
        EXPECT_EQ(measure(mesh).boundaryEdges, 0u);
    }
}

TEST(Coverage, SitsOnTheBandAndFollowsItsFormula)
{
    const double h = 0.03;
    const Covered model = covered(holedSphere({kLarge}), h);
    const FloatGrid& surface = model.made.levelSet().grid();
    EXPECT_TRUE(surface.tree().hasSameTopology(model.coverage->tree()));
    EXPECT_EQ(surface.transform(), model.coverage->transform());
    EXPECT_EQ(model.coverage->background(), 0);
    EXPECT_EQ(model.coverage->getName(), "coverage");
    EXPECT_NEAR(model.spacing, std::sqrt(4 * M_PI / 20000), 0.1 * model.spacing);
    EXPECT_EQ(coverageScale(*model.coverage), std::max(h, model.spacing));
    // Distance to the rim of the data, in spacings, of which the sampling leaves one open.
    std::size_t inside = 0;
    for (auto v = model.coverage->cbeginValueOn(); v; ++v) {
        const Vec3d p = test::worldOf(model.made.levelSet().lattice(), v.getCoord()).normalized();
        const double angle = std::acos(std::clamp(p.dot(kLarge.axis), -1.0, 1.0));
        const double beyond = 2 * std::sin((kLarge.angle - angle) / 2) / model.spacing;
        ASSERT_GE(*v, 0);
        ASSERT_LE(*v, 1);
        ASSERT_TRUE(beyond > 0.5 - 1 || *v == 1) << beyond << " " << *v;
        const double none = kRimSpacing + hullBeyondRim(kLarge.angle, model.spacing);
        ASSERT_TRUE(beyond < none || *v == 0) << beyond << " " << *v;
        inside += beyond > none;
    }
    EXPECT_GT(inside, 1000u);
}

TEST(Coverage, KnowsTheBackOfASheet)
{
    // One side of a disc is seen; the level set closes it behind, a few spacings away.
    PointCloud cloud;
    test::Random random(3);
    while (cloud.size() < 8000) {
        const Vec3d p = random.inCube(1);
        if (p[0] * p[0] + p[1] * p[1] > 1) continue;
        cloud.positions.emplace_back(float(p[0]), float(p[1]), 0.0f);
        cloud.normals.emplace_back(0.0f, 0.0f, 1.0f);
    }
    const Covered model = covered(std::move(cloud), 0.02);
    TrimReport report;
    const MeshReport mesh = measure(trimmed(model, 0, report));
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.boundaryLoops, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 1);
    EXPECT_GT(mesh.area, M_PI);
    EXPECT_LT(mesh.area, M_PI * std::pow(1 + 2 * model.spacing, 2));
}

TEST(Coverage, EndsWhereATerrainDoes)
{
    // Hills over a square, over an L and over a disc, at random and on a grid, exact and noisy.
    const auto height = [](double x, double y) { return 0.06 * std::sin(7 * x) * std::cos(6 * y); };
    const auto inL = [](double x, double y) { return x > 0.5 || y > 0.5; };
    const auto inDisc = [](double x, double y) { return std::hypot(x - 0.5, y - 0.5) < 0.5; };
    const auto anywhere = [](double, double) { return true; };
    const double areaOf[] = {1, 0.75, M_PI / 4}, rimOf[] = {4, 4, M_PI};
    for (int shape = 0; shape < 3; ++shape)
        for (const bool even : {true, false})
            for (const double noise : {0.0, 0.003}) {
                PointCloud cloud;
                test::Random random(std::uint64_t(7 + shape));
                const int side = 70;
                for (int n = 0; n < side * side; ++n) {
                    const double x = even ? (n % side + 0.5) / side : random.uniform();
                    const double y = even ? (n / side + 0.5) / side : random.uniform();
                    if (!(shape == 0 ? anywhere(x, y) : shape == 1 ? inL(x, y) : inDisc(x, y)))
                        continue;
                    const double off = noise * random.uniform(-1, 1);
                    cloud.positions.emplace_back(float(x), float(y), float(height(x, y) + off));
                    const Vec3d slope(-0.42 * std::cos(7 * x) * std::cos(6 * y),
                                      0.36 * std::sin(7 * x) * std::sin(6 * y), 1);
                    cloud.normals.push_back(slope.normalized().cast<float>());
                }
                const Covered model = covered(std::move(cloud), 0.012);
                TrimReport report;
                const Mesh mesh = trimmed(model, 0, report);
                double plan = 0, lowest = 0;
                for (const Mesh::Triangle& t : mesh.triangles) {
                    const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
                    plan += (b - a).cross(c - a)[2] / 2;
                    lowest = std::min({lowest, a[2], b[2], c[2]});
                }
                // The rim is within a spacing of the data's, and does not turn down.
                const double spacing = 1.0 / side;
                EXPECT_NEAR(plan, areaOf[shape], rimOf[shape] * spacing) << shape << even << noise;
                EXPECT_GT(lowest, -0.06 - noise - spacing) << shape << even << noise;
                EXPECT_EQ(report.open, 1u) << shape << even << noise;
            }
}

// Lines up to 25 times as far apart as their points, the twelve nearest of which lie on one
// line.
TEST(Coverage, CoversATerrainOfScanLines)
{
    constexpr int kLines = 15;
    for (const int along : {kLines, 6 * kLines, 20 * kLines, 25 * kLines}) {
        PointCloud cloud;
        for (int n = 0; n < kLines * along; ++n) {
            const double x = (n / along + 0.5) / kLines, y = (n % along + 0.5) / along;
            const double slope = 0.3 * std::cos(5 * x);
            cloud.positions.emplace_back(float(x), float(y), float(0.06 * std::sin(5 * x)));
            cloud.normals.push_back(Vec3d(-slope, 0, 1).normalized().cast<float>());
        }
        const Covered model = covered(std::move(cloud), 0.02);
        TrimReport report;
        const Mesh mesh = trimmed(model, 0, report);
        double plan = 0;
        for (const Mesh::Triangle& t : mesh.triangles) {
            const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
            plan += (b - a).cross(c - a)[2] / 2;
        }
        // Every rim is within a distance between lines of the data's.
        EXPECT_NEAR(plan, 1, 4.0 / kLines) << along << " points to a line";
        EXPECT_EQ(report.open, 1u) << along << " points to a line";
    }
}

TEST(PointsAround, AgreeWithEverySegment)
{
    for (std::uint64_t seed = 1; seed <= 400; ++seed) {
        test::Random random(seed);
        const Vec3f normal = random.inCube(1).normalized().cast<float>();
        const Vec3f first = normal.unitOrthogonal(), second = normal.cross(first);
        const Vec3f away = float(random.uniform(0, 2)) * first;
        PointsAround around;
        around.start(normal);
        std::vector<Eigen::Vector2d> points;
        for (std::uint64_t n = 0; n < 1 + seed % 40; ++n) {
            const Vec3f p = away + random.inCube(1).cast<float>();
            around.add(p);
            points.emplace_back(first.dot(p), second.dot(p));
        }
        // The origin is outside the hull if all points are on one side of a line through it and
        // one of them; then some segment between two is nearest.
        double nearest = 1e9;
        bool outside = false;
        for (const auto& a : points) {
            std::size_t left = 0, right = 0;
            for (const auto& b : points) {
                const double cross = a[0] * b[1] - a[1] * b[0];
                left += cross > 0;
                right += cross < 0;
                const Eigen::Vector2d side = b - a;
                const double t = std::clamp(-a.dot(side) / (side.squaredNorm() + 1e-30), 0.0, 1.0);
                nearest = std::min(nearest, (a + t * side).norm());
            }
            outside = outside || left == 0 || right == 0;
        }
        EXPECT_NEAR(around.distanceToHull(), outside ? nearest : 0, 1e-4) << "seed " << seed;
        EXPECT_FALSE(around.surround() && outside) << "seed " << seed;
    }
}

TEST(Coverage, KnowsDensityThatChanges)
{
    // Twenty times as many points on one half of a sphere.
    PointCloud cloud = test::randomScan("sphere(1)", 60000), uneven;
    uneven.frame = cloud.frame;
    test::Random random(5);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (cloud.positions[i][0] < 0 && random.uniform() > 0.05) continue;
        uneven.positions.push_back(cloud.positions[i]);
        uneven.normals.push_back(cloud.normals[i]);
    }
    const Covered model = covered(std::move(uneven), 0.03);
    TrimReport report;
    EXPECT_EQ(measure(trimmed(model, 0, report)).boundaryEdges, 0u);
    EXPECT_EQ(report.open, 0u);
}

TEST(Trim, CutsARoundHoleWhereTheDataEnd)
{
    for (const double h : {0.05, 0.025}) {
        const Covered model = covered(holedSphere({kLarge}), h);
        TrimReport report;
        const Mesh mesh = trimmed(model, 0, report);
        const MeshReport measured = measure(mesh);
        EXPECT_EQ(report.open, 1u);
        EXPECT_EQ(measured.components, 1u);
        EXPECT_EQ(measured.boundaryLoops, 1u);
        EXPECT_EQ(measured.nonManifoldEdges, 0u);
        EXPECT_EQ(measured.eulerCharacteristic, 1);
        // Half way between a half and a whole spacing beyond the data, which the sampling ends up
        // to a spacing before the rim.
        double low = 10, high = -10, sum = 0, sum2 = 0;
        const std::vector<std::uint32_t> rim = rimOf(mesh);
        for (const std::uint32_t v : rim) {
            const double angle = std::acos(mesh.world(v).normalized().dot(kLarge.axis));
            const double beyond = (kLarge.angle - angle) / model.spacing;
            low = std::min(low, beyond);
            high = std::max(high, beyond);
            sum += beyond;
            sum2 += beyond * beyond;
        }
        EXPECT_GT(low, 0.75 - 1 - 0.5 * h / model.spacing);
        EXPECT_LT(high, 0.75 * kRimSpacing + hullBeyondRim(kLarge.angle, model.spacing) +
                            0.5 * h / model.spacing);
        // A smooth curve: no rougher than half a spacing.
        const double mean = sum / double(rim.size());
        EXPECT_LT(std::sqrt(sum2 / double(rim.size()) - mean * mean), 0.5);
        EXPECT_GT(thinnestAtRim(mesh), 0.05);
    }
}

TEST(Trim, ClosesHolesUpToALength)
{
    const Covered model = covered(holedSphere({kLarge, kSmall}), 0.04);
    const auto loops = [&](double closeUpTo) {
        TrimReport report;
        const MeshReport mesh = measure(trimmed(model, closeUpTo, report));
        EXPECT_EQ(mesh.boundaryLoops, report.open);
        EXPECT_EQ(report.open + report.closed, 2u);
        EXPECT_EQ(mesh.nonManifoldEdges, 0u);
        return mesh.boundaryLoops;
    };
    EXPECT_EQ(loops(0), 2u);
    EXPECT_EQ(loops(2 * std::sin(kSmall.angle)), 1u);
    EXPECT_EQ(loops(2 * std::sin(kLarge.angle)), 0u);
}

TEST(Trim, DropsIslandsOfStrayPoints)
{
    PointCloud cloud = holedSphere({kLarge});
    cloud.positions.emplace_back(1.0f, 0.0f, 0.0f);
    cloud.normals.emplace_back(1.0f, 0.0f, 0.0f);
    const Covered model = covered(std::move(cloud), 0.03);
    TrimReport report;
    const MeshReport mesh = measure(trimmed(model, 0, report));
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.boundaryLoops, 1u);
}

TEST(Trim, IsManifoldHoweverTheLineRuns)
{
    // Noise: every way in which the line can pass a triangle and a vertex.
    Interrupter progress;
    const Covered model = covered(holedSphere({}, 8000), 0.05);
    const Mesh whole = extractMesh(model.made.levelSet(), {}, &progress);
    for (const std::uint64_t seed : {1, 2, 3, 4}) {
        test::Random random(seed);
        std::vector<float> values(whole.positions.size());
        for (float& value : values) value = float(random.uniform(-1, 1));
        const Mesh mesh = cutMesh(whole, values, progress);
        const MeshReport measured = measure(mesh);
        EXPECT_GT(measured.boundaryLoops, 200u) << seed;
        EXPECT_EQ(measured.nonManifoldEdges, 0u) << seed;
        EXPECT_GT(measured.area, 0.3 * 4 * M_PI) << seed;
        EXPECT_LT(measured.area, 0.7 * 4 * M_PI) << seed;
        EXPECT_EQ(measured.vertices, mesh.positions.size()) << seed;
        std::vector<int> ends(mesh.positions.size(), 0);
        for (const std::uint32_t v : rimOf(mesh)) ++ends[v];
        for (const int n : ends) ASSERT_TRUE(n == 0 || n == 2) << seed << " " << n;
    }
}

TEST(Trim, OfNothingCoveredIsNothing)
{
    Interrupter progress;
    const Covered model = covered(holedSphere({}, 4000), 0.08);
    const auto none = FloatGrid::create(0);
    TrimReport report;
    const Mesh mesh =
        trimMesh(extractMesh(model.made.levelSet(), {}, &progress), *none, {}, report, &progress);
    EXPECT_TRUE(mesh.triangles.empty());
    EXPECT_TRUE(mesh.positions.empty());
}

TEST(Trim, IsTheSameForAnyNumberOfThreads)
{
    const auto make = [](std::size_t threads) {
        tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        const Covered model = covered(holedSphere({kLarge, kSmall}), 0.04);
        TrimReport report;
        return std::make_pair(treeBytes(*model.coverage), trimmed(model, 0, report));
    };
    const auto [bytes, mesh] = make(1);
    for (const std::size_t threads : {2, 5}) {
        const auto [otherBytes, other] = make(threads);
        EXPECT_TRUE(bytes == otherBytes);
        EXPECT_EQ(mesh.triangles, other.triangles);
        ASSERT_EQ(mesh.positions.size(), other.positions.size());
        EXPECT_EQ(std::memcmp(mesh.positions.data(), other.positions.data(),
                              mesh.positions.size() * sizeof(Vec3f)),
                  0);
    }
}

TEST(Trim, Stops)
{
    const Covered model = covered(holedSphere({kLarge}, 4000), 0.08);
    Interrupter progress;
    const Mesh mesh = extractMesh(model.made.levelSet(), {}, &progress);
    progress.stop();
    TrimReport report;
    EXPECT_THROW(trimMesh(mesh, *model.coverage, {}, report, &progress), Interrupted);
    EXPECT_THROW(model.made.field->coverage(&progress), Interrupted);
    const auto coverage = [&] {
        Interrupter fresh;
        return model.made.field->coverage(&fresh);
    }();
    EXPECT_THROW(sampleCoverage(model.made.levelSet(), *coverage, &progress), Interrupted);
}

} // namespace
} // namespace mpuvdb
