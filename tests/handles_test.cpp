// Handles that no data hold up are taken away, others stay.
#include "field_fixture.h"
#include "grid/voxel_topology.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/sampling.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace mpuvdb
{
namespace
{

/// A solid of which some points are known, at @a place so many that it is no island.
class KnownField final : public Field
{
public:
    KnownField(const std::string& solid, const Vec3d& place, std::vector<Vec3d> points)
        : mShape(makeSolidField(parseSolid(solid))), mPoints(std::move(points))
    {
        mPoints.insert(mPoints.end(), 100, place);
    }

    Box3d bounds() const override { return mShape->bounds(); }
    FieldSample evaluate(const Vec3d& position) const override
    {
        FieldSample sample = mShape->evaluate(position);
        sample.supported = std::any_of(mPoints.begin(), mPoints.end(),
                                       [&](const Vec3d& p) { return (p - position).norm() < 4; });
        return sample;
    }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        return mShape->seedBlocks(lattice);
    }
    std::size_t countData(const Box3d& box, std::size_t) const override
    {
        return std::size_t(std::count_if(mPoints.begin(), mPoints.end(),
                                         [&](const Vec3d& p) { return box.contains(p); }));
    }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        return mShape->sampler(lattice, band);
    }

private:
    FieldPtr mShape;
    std::vector<Vec3d> mPoints;
};

/// The surface of @a field with voxels of size 1.
MeshReport surfaceOf(const Field& field)
{
    SampleSettings settings;
    settings.lattice = {Vec3d(0.13, 0.21, 0.37), 1};
    Interrupter progress;
    const LevelSet levelSet = sampleField(field, settings, &progress);
    const CheckReport report =
        check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << test::texts(report);
    return measure(extractMesh(levelSet, {}, &progress));
}

/// Points on a circle about the z axis, some heights of it.
std::vector<Vec3d> ringOfPoints(double radius, double height)
{
    std::vector<Vec3d> points;
    for (double z = -height; z <= height; ++z)
        for (int n = 0; n < 8; ++n)
            points.emplace_back(radius * std::cos(n * M_PI / 4), radius * std::sin(n * M_PI / 4),
                                z);
    return points;
}

const Vec3d kOnTop(14, 13, 4); // of the box
constexpr const char* kPierced = "difference(box(40,40,8), cylinder(1.7,30))";

TEST(Handles, TunnelWithoutDataIsFilled)
{
    const MeshReport mesh = surfaceOf(KnownField(kPierced, kOnTop, {}));
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.boundaryEdges, 0u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
}

TEST(Handles, TunnelWithDataStays)
{
    EXPECT_EQ(surfaceOf(KnownField(kPierced, kOnTop, ringOfPoints(1.7, 4))).eulerCharacteristic, 0);
}

TEST(Handles, WideTunnelStays)
{
    const KnownField field("difference(box(40,40,8), cylinder(5,30))", kOnTop, {});
    EXPECT_EQ(surfaceOf(field).eulerCharacteristic, 0);
}

TEST(Handles, ExactFieldStays)
{
    EXPECT_EQ(surfaceOf(*makeSolidField(parseSolid(kPierced))).eulerCharacteristic, 0);
}

// Two lobes of a folded sheet, joined where they face each other.
const Vec3d kOnLobe(14, 13, 20);
constexpr const char* kBridged =
    "union(difference(box(40,30,40), translate(box(40,30.1,20),10,0,0)), cylinder(1.5,30))";

TEST(Handles, BridgeWithoutDataIsCut)
{
    const MeshReport mesh = surfaceOf(KnownField(kBridged, kOnLobe, {}));
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.boundaryEdges, 0u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
}

TEST(Handles, WireWithDataStays)
{
    EXPECT_EQ(surfaceOf(KnownField(kBridged, kOnLobe, ringOfPoints(1.5, 10))).eulerCharacteristic,
              0);
}

// As thin as a voxel: points beside it support fits there, but do not show it.
TEST(Handles, ThinWireStaysOnlyWithPointsOnIt)
{
    const std::string bridged =
        "union(difference(box(40,30,40), translate(box(40,30.1,20),10,0,0)), cylinder(0.7,30))";
    EXPECT_EQ(surfaceOf(KnownField(bridged, kOnLobe, ringOfPoints(0.7, 10))).eulerCharacteristic,
              0);
    EXPECT_EQ(surfaceOf(KnownField(bridged, kOnLobe, ringOfPoints(3, 10))).eulerCharacteristic, 2);
}

TEST(Islands, OneWithinAnotherGoesWithIt)
{
    const KnownField field("union(difference(box(40,40,40), sphere(9)), sphere(4))", kOnLobe, {});
    const MeshReport mesh = surfaceOf(field);
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
}

TEST(Islands, VoxelOfNoDepthGoes)
{
    const KnownField field(
        "difference(box(40,40,40), translate(sphere(0.000000001), 0.13, 0.21, 0.37))", kOnLobe, {});
    const MeshReport mesh = surfaceOf(field);
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
}

// A row of voxels that rounding puts inside, as along an edge of a box in the lattice's planes.
TEST(Handles, HairIsNeitherWireNorObject)
{
    const Vec3d place(15.13, 0.21, 0.37);
    const std::string hair = "translate(box(0.02,0.02,50), 0.13, 0.21, 0)";
    const std::string bridged =
        "union(difference(box(40,30,40), translate(box(40,30.1,20),10,0,0)), " + hair + ")";
    EXPECT_EQ(surfaceOf(KnownField(bridged, kOnLobe, ringOfPoints(0.5, 10))).eulerCharacteristic,
              2);
    const KnownField beside("union(box(20,20,20), translate(" + hair + ", 15, 0, 0))",
                            Vec3d(10, 0, 0), std::vector<Vec3d>(100, place));
    EXPECT_EQ(surfaceOf(beside).components, 1u);
}

TEST(Handles, NeckOfABottleStaysOpen)
{
    const KnownField field("difference(sphere(22), sphere(16), "
                           "translate(cylinder(1.7,30),0,0,20))",
                           Vec3d(0, 0, -22), {});
    const MeshReport mesh = surfaceOf(field);
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
}

TEST(VoxelTopology, KnowsPlanesEdgesAndBridges)
{
    const auto set = [](auto isOn) {
        Neighborhood around = 0;
        for (int n = 0; n < 27; ++n)
            if (isOn(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1)) around |= 1u << n;
        return around;
    };
    const auto half = set([](int x, int, int) { return x <= 0; });
    EXPECT_TRUE(isSimple(half));
    EXPECT_EQ(eulerChange(half), 0);
    const auto sheet = set([](int x, int, int) { return x == 0; });
    EXPECT_FALSE(isSimple(sheet));
    EXPECT_EQ(eulerChange(sheet), 1); // fills a hole
    const auto rod = set([](int x, int y, int) { return x == 0 && y == 0; });
    EXPECT_FALSE(isSimple(rod));
    EXPECT_EQ(eulerChange(rod), -1); // joins two parts
    EXPECT_FALSE(isSimple(kCenter));
    EXPECT_EQ(eulerChange(kCenter), 1); // a part of its own
    EXPECT_FALSE(isSimple((1u << 27) - 1));
    EXPECT_EQ(eulerChange((1u << 27) - 1), -1); // fills a hollow
}

TEST(VoxelTopology, SimpleVoxelsDoNotChangeTheEulerCharacteristic)
{
    std::mt19937 random(7);
    int simple = 0;
    for (int n = 0; n < 200000; ++n) {
        const Neighborhood around = (random() & random() & ((1u << 27) - 1)) | kCenter;
        if (!isSimple(around)) continue;
        ++simple;
        ASSERT_EQ(eulerChange(around), 0) << "neighborhood " << around << " of seed 7";
    }
    EXPECT_GT(simple, 1000);
}

} // namespace
} // namespace mpuvdb
