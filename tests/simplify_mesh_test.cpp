// Fewer triangles, within a tolerance.
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/scan_sampler.h>

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb::test
{
namespace
{

struct Meshed {
    std::shared_ptr<const Solid> solid;
    Mesh mesh;
};

Meshed meshOf(const std::string& text, double voxelSize)
{
    const auto solid = parseSolid(text);
    const FieldPtr field = makeSolidField(solid);
    Interrupter progress;
    return {solid, extractMesh(sampled(*field, voxelSize), {field.get()}, &progress)};
}

Mesh simplified(const Mesh& mesh, double tolerance)
{
    Interrupter progress;
    return simplify(mesh, {tolerance}, &progress);
}

double squaredToSegment(const Vec3d& p, const Vec3d& a, const Vec3d& b)
{
    const double t = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0., 1.);
    return (a + t * (b - a) - p).squaredNorm();
}

/// By brute force. @return the largest distance of @a points from the triangles of @a mesh.
double farthest(const std::vector<Vec3d>& points, const Mesh& mesh)
{
    double worst = 0;
    for (const Vec3d& p : points) {
        double least = std::numeric_limits<double>::max();
        for (const Mesh::Triangle& t : mesh.triangles) {
            const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
            const Vec3d n = (b - a).cross(c - a).normalized(), foot = p - n.dot(p - a) * n;
            const bool inside = (b - a).cross(foot - a).dot(n) >= 0 &&
                                (c - b).cross(foot - b).dot(n) >= 0 &&
                                (a - c).cross(foot - c).dot(n) >= 0;
            least = std::min({least, inside ? (foot - p).squaredNorm() : least,
                              squaredToSegment(p, a, b), squaredToSegment(p, b, c),
                              squaredToSegment(p, c, a)});
        }
        worst = std::max(worst, least);
    }
    return std::sqrt(worst);
}

std::vector<Vec3d> verticesOf(const Mesh& mesh)
{
    std::vector<Vec3d> points;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) points.push_back(mesh.world(v));
    return points;
}

TEST(SimplifiedMesh, KeepsTheToleranceBothWays)
{
    const double h = 0.1, tolerance = 0.1 * h;
    for (const char* text :
         {"rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)", "torus(1,0.4)",
          "rotate(cylinder(0.6,1.2),1,2,3,33)", "blob(1,6,0.1)"}) {
        const auto [solid, mesh] = meshOf(text, h);
        const Mesh fewer = simplified(mesh, tolerance);
        const MeshReport before = measure(mesh), after = measure(fewer);
        EXPECT_EQ(after.eulerCharacteristic, before.eulerCharacteristic) << text;
        EXPECT_EQ(after.nonManifoldEdges + after.boundaryEdges, 0u) << text;
        EXPECT_LT(after.triangles, before.triangles / 2) << text;
        EXPECT_LE(farthest(verticesOf(mesh), fewer), tolerance) << text;
        // Of the result: its vertices, edges and middles.
        std::vector<Vec3d> places = verticesOf(fewer);
        for (const Mesh::Triangle& t : fewer.triangles) {
            const Vec3d a = fewer.world(t[0]), b = fewer.world(t[1]), c = fewer.world(t[2]);
            for (const Vec3d& p : {Vec3d((a + b + c) / 3), Vec3d((a + b) / 2)}) places.push_back(p);
        }
        EXPECT_LE(farthest(places, mesh), 1.2 * tolerance) << text;
    }
}

TEST(SimplifiedMesh, OfAPartNeedsATenthOfTheTriangles)
{
    const double h = 0.05;
    for (const char* text : {"rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)",
                             "rotate(box(1.3,1.1,0.9),1,2,3,33)"}) {
        const Meshed part = meshOf(text, h);
        const Mesh fewer = simplified(part.mesh, 0.1 * h);
        EXPECT_LT(10 * fewer.triangles.size(), part.mesh.triangles.size()) << text;
        for (std::size_t v = 0; v < fewer.positions.size(); ++v)
            EXPECT_LT(std::abs(part.solid->distance(fewer.world(v))), 0.1 * h);
        EXPECT_NEAR(measure(fewer).volume / measure(part.mesh).volume, 1, 1e-3);
    }
}

TEST(SimplifiedMesh, OfALargeOneIsMadeInPartsThatLeaveNoSeams)
{
    const struct {
        const char* text;
        double h;
        std::size_t share; ///< of the triangles at most
    } solids[] = {{"rotate(box(1,1,1),1,2,3,33)", 0.0105, 1160}, {"torus(0.5,0.2)", 0.008, 25}};
    for (const auto& [text, h, share] : solids) {
        const double tolerance = 0.1 * h;
        const Mesh mesh = meshOf(text, h).mesh;
        ASSERT_GT(mesh.triangles.size(), 2u << 16) << text; // three parts
        Mesh one, four;
        for (const std::size_t threads : {1, 4}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            (threads == 1 ? one : four) = simplified(mesh, tolerance);
        }
        EXPECT_EQ(one.positions, four.positions) << text;
        EXPECT_EQ(one.triangles, four.triangles) << text;
        // Seams of three parts would be some four hundred edges of the original long.
        const MeshReport before = measure(mesh), after = measure(one);
        EXPECT_EQ(after.eulerCharacteristic, before.eulerCharacteristic) << text;
        EXPECT_EQ(after.nonManifoldEdges + after.boundaryEdges, 0u) << text;
        EXPECT_LT(after.triangles, before.triangles / share) << text;
        Interrupter progress;
        const TwoWayDistances apart = distances(one, mesh, &progress);
        EXPECT_LT(std::max(apart.there.max, apart.back.max), 1.2 * tolerance) << text;
    }
}

TEST(SimplifiedMesh, KeepsColors)
{
    // A box, red above a slanted line and green below: the line stays, each side is one color.
    Mesh box = meshOf("box(1,1,1)", 0.05).mesh;
    const auto isRed = [](const Vec3d& p) { return p.x() + 0.4 * p.y() + 0.2 * p.z() > 0.1; };
    std::vector<float> heights;
    for (std::size_t v = 0; v < box.positions.size(); ++v) {
        box.colors.push_back(isRed(box.world(v)) ? Vec3f(1, 0, 0) : Vec3f(0, 1, 0));
        heights.push_back(float(box.world(v).z()));
    }
    box.scalars.push_back({"height", heights});
    const Mesh fewer = simplified(box, 0.005);
    EXPECT_LT(fewer.triangles.size() * 2, box.triangles.size());
    ASSERT_EQ(fewer.colors.size(), fewer.positions.size());
    ASSERT_EQ(fewer.scalars.size(), 1u);
    ASSERT_EQ(fewer.scalars[0].values.size(), fewer.positions.size());
    for (std::size_t v = 0; v < fewer.positions.size(); ++v) {
        const Vec3d p = fewer.world(v);
        // The line was as wide as a triangle.
        const double fromLine = p.x() + 0.4 * p.y() + 0.2 * p.z() - 0.1;
        if (std::abs(fromLine) > 0.1) {
            EXPECT_NEAR(fewer.colors[v].x(), fromLine > 0, 0.07);
        }
        EXPECT_NEAR(fewer.scalars[0].values[v], p.z(), 0.02);
    }
}

TEST(SimplifiedMesh, HasNoCrossingsWhereItIsStrict)
{
    const Mesh mesh =
        meshOf("rotate(difference(union(box(2,2,0.3),rotate(cylinder(0.3,2),1,0,0,70)),"
               "translate(rotate(cylinder(0.25,3),0,1,0,65),0.3,0.2,0)),1,2,3,33)",
               0.05)
            .mesh;
    Interrupter progress;
    ASSERT_EQ(findSelfIntersections(mesh, &progress).size(), 0u);
    for (const double tolerance : {0.005, 0.02, 0.08}) {
        const Mesh fewer = simplify(mesh, {tolerance, true}, &progress);
        EXPECT_EQ(findSelfIntersections(fewer, &progress).size(), 0u) << tolerance;
        EXPECT_LT(fewer.triangles.size() * 3, mesh.triangles.size()) << tolerance;
    }
}

TEST(SimplifiedMesh, KeepsBoundaries)
{
    // The upper half of a torus: two rims.
    Mesh half = meshOf("torus(1,0.4)", 0.1).mesh;
    half.triangles.erase(std::remove_if(half.triangles.begin(), half.triangles.end(),
                                        [&](const Mesh::Triangle& t) {
                                            return half.world(t[0]).z() < 0 ||
                                                   half.world(t[1]).z() < 0 ||
                                                   half.world(t[2]).z() < 0;
                                        }),
                         half.triangles.end());
    const MeshReport before = measure(half);
    const Mesh fewer = simplified(half, 0.02);
    const MeshReport after = measure(fewer);
    EXPECT_EQ(before.boundaryLoops, 2u);
    EXPECT_EQ(after.boundaryLoops, 2u);
    EXPECT_EQ(after.boundaryEdges, before.boundaryEdges);
    EXPECT_EQ(after.nonManifoldEdges, 0u);
    EXPECT_EQ(after.eulerCharacteristic, before.eulerCharacteristic);
    EXPECT_LT(after.triangles, before.triangles / 2);
}

TEST(SimplifiedMesh, OfNoiseStaysAManifoldWithinTheTolerance)
{
    std::mt19937_64 random(7);
    RecordProperty("seed", "7");
    auto grid = openvdb::FloatGrid::create(1);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    auto accessor = grid->getAccessor();
    for (int x = -1; x <= 16; ++x)
        for (int y = -1; y <= 16; ++y)
            for (int z = -1; z <= 16; ++z) {
                const bool border = std::min({x, y, z}) < 0 || std::max({x, y, z}) > 15;
                const double value = 2 * std::ldexp(double(random() >> 11), -53) - 1;
                accessor.setValue({x, y, z}, border ? 1.0f : float(value));
            }
    Interrupter progress;
    const Mesh mesh = extractMesh(LevelSet(grid), {}, &progress);
    const double tolerance = 0.5;
    const Mesh fewer = simplified(mesh, tolerance);
    // Bumps a voxel wide: corners that planes meet in may be far off, and so may what bridges them.
    std::vector<Vec3d> places;
    for (std::size_t n = 0; n < fewer.triangles.size(); n += 8) { // enough, and soon done
        const Mesh::Triangle& t = fewer.triangles[n];
        const Vec3d a = fewer.world(t[0]), b = fewer.world(t[1]), c = fewer.world(t[2]);
        for (const Vec3d& p : {a, b, c, Vec3d((a + b) / 2), Vec3d((b + c) / 2), Vec3d((c + a) / 2)})
            places.push_back(p);
    }
    EXPECT_LE(farthest(places, mesh), tolerance * (1 + 1e-5)); // floats, of a mesh 16 wide
    const MeshReport before = measure(mesh), after = measure(fewer);
    EXPECT_LT(after.triangles, before.triangles);
    EXPECT_EQ(after.nonManifoldEdges + after.boundaryEdges, 0u);
    EXPECT_EQ(after.eulerCharacteristic, before.eulerCharacteristic);
    EXPECT_EQ(after.components, before.components);
}

TEST(SimplifiedMesh, RefusesAToleranceOfNothingAndStops)
{
    const Mesh mesh = meshOf("sphere(1)", 0.05).mesh;
    EXPECT_THROW(simplified(mesh, 0), UsageError);
    EXPECT_THROW(simplified(mesh, std::nan("")), UsageError);
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(simplify(mesh, {0.01}, &progress), Interrupted);
    EXPECT_TRUE(simplified(Mesh(), 1).triangles.empty());
}

} // namespace
} // namespace mpuvdb::test
