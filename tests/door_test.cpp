// The door: the same points and options give the same bytes, whichever way they come.
#include "solid_level_set.h"

#include <mpuvdb/error.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <gtest/gtest.h>
#include <openvdb/util/NullInterrupter.h>

#include <array>
#include <atomic>
#include <cstring>

namespace mpuvdb
{
namespace
{

/// Points of a torus in single precision, so that every way in holds the same numbers.
struct Points {
    std::vector<openvdb::Vec3f> positions, normals;

    Points()
    {
        ScanSettings settings;
        settings.points = 4000;
        settings.noise = 0.003;
        const PointCloud cloud = scan(*parseSolid("torus(1, 0.4)"), settings);
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const Vec3d p = cloud.world(i);
            const Vec3f& n = cloud.normals[i];
            positions.emplace_back(float(p.x()), float(p.y()), float(p.z()));
            normals.emplace_back(n.x(), n.y(), n.z());
        }
    }
    PointView view() const
    {
        PointView view(positions);
        view.normals = normals;
        return view;
    }
};

void expectSame(const openvdb::FloatGrid& a, const openvdb::FloatGrid& b)
{
    ASSERT_EQ(a.activeVoxelCount(), b.activeVoxelCount());
    ASSERT_EQ(a.transform(), b.transform());
    ASSERT_EQ(a.background(), b.background());
    const auto other = b.getConstAccessor();
    for (auto voxel = a.cbeginValueOn(); voxel; ++voxel) {
        float there = 0;
        ASSERT_TRUE(other.probeValue(voxel.getCoord(), there));
        ASSERT_EQ(std::memcmp(&*voxel, &there, sizeof there), 0) << voxel.getCoord();
    }
}

ReconstructOptions options(double halfWidth = 3)
{
    ReconstructOptions options;
    options.voxelSize = Length{0.05, Length::Unit::World};
    options.halfWidth = halfWidth;
    return options;
}

TEST(Door, PointsInGridOut)
{
    const Points points;
    const ReconstructResult made = reconstruct(points.view());
    EXPECT_EQ(made.grid.use_count(), 1);
    EXPECT_EQ(made.report.points, points.positions.size());
    EXPECT_TRUE(made.report.explained.findings.empty());
    EXPECT_TRUE(check(*made.grid).sound());
    EXPECT_FALSE(made.coverage);
    EXPECT_TRUE(made.attributes.empty());
}

TEST(Door, EveryTypeOfNumberGivesTheSameBytes)
{
    const Points points;
    std::vector<Vec3d> doubles;
    for (const openvdb::Vec3f& p : points.positions) doubles.emplace_back(p.x(), p.y(), p.z());
    PointView view(doubles);
    view.normals = points.normals;
    expectSame(*reconstruct(points.view(), options()).grid, *reconstruct(view, options()).grid);
}

/// A shape samples the same field into the same band, at every half-width.
TEST(Door, ShapesGiveTheSameBytes)
{
    const Points points;
    for (const double halfWidth : {3.0, 6.0, 9.5, 25.0}) {
        const ReconstructResult made = reconstruct(points.view(), options(halfWidth));
        ShapeSettings settings;
        settings.voxelSize = 0.05;
        settings.halfWidth = halfWidth;
        const LevelSet shape = Shape(made.field, "points").evaluate(settings);
        expectSame(*made.grid, shape.grid());
        EXPECT_TRUE(check(*made.grid).sound()) << halfWidth;
    }
}

TEST(Door, ARegionOfAWideBandIsThatOfTheWhole)
{
    const Points points;
    ReconstructOptions part = options(12);
    const ReconstructResult whole = reconstruct(points.view(), part);
    part.region = {Length{0.2, Length::Unit::World}, Length{-2, Length::Unit::World},
                   Length{-2, Length::Unit::World},  Length{0.9, Length::Unit::World},
                   Length{2, Length::Unit::World},   Length{2, Length::Unit::World}};
    const ReconstructResult some = reconstruct(points.view(), part);
    openvdb::FloatGrid::Ptr cut = whole.grid->deepCopy();
    cut->clip(
        voxelsIn(Box3d(Vec3d(0.2, -2, -2), Vec3d(0.9, 2, 2)), whole.report.settings.grid.lattice));
    expectSame(*some.grid, *cut);
}

TEST(Door, GivesWhatIsAskedFor)
{
    const Points points;
    const std::vector<std::array<std::uint8_t, 3>> red(points.positions.size(), {255, 0, 0});
    const std::vector<float> heat(points.positions.size(), 7);
    PointView view = points.view();
    view.colors = red;
    view.scalars = {{"heat", heat}};
    ReconstructOptions wanted = options();
    wanted.coverage = true;
    wanted.attributes = {kColorName, "heat"};
    const ReconstructResult made = reconstruct(view, wanted);
    ASSERT_TRUE(made.coverage);
    EXPECT_EQ(made.coverage->getName(), kCoverageName);
    EXPECT_GT(*made.report.coverageSpacing, 0);
    ASSERT_EQ(made.attributes.size(), 2u);
    const auto colors = openvdb::gridPtrCast<openvdb::Vec3SGrid>(made.attributes[0]);
    const openvdb::Coord at = made.grid->cbeginValueOn().getCoord();
    EXPECT_NEAR(colors->getConstAccessor().getValue(at).x(), 1, 1e-6);
    wanted.attributes = {"cold"};
    EXPECT_THROW(reconstruct(view, wanted), UsageError);
}

TEST(Door, RefusesWhatDoesNotFit)
{
    const Points points;
    ReconstructOptions small = options();
    small.maxBytes = 1 << 20;
    EXPECT_THROW(reconstruct(points.view(), small), LimitError);
    EXPECT_THROW(reconstruct(PointView()), InputError);
    EXPECT_THROW(reconstruct(points.view(), options(1)), UsageError);
}

/// What OpenVDB's programs stop work by.
struct StopAfter final : openvdb::util::NullInterrupter {
    std::atomic<int> left;

    explicit StopAfter(int calls) : left(calls) {}
    bool wasInterrupted(int = -1) override { return --left < 0; }
};

TEST(Door, OpenVdbsInterrupterStopsIt)
{
    const Points points;
    StopAfter never(1 << 30);
    InterrupterOf<openvdb::util::NullInterrupter> patient(never);
    EXPECT_NO_THROW(reconstruct(points.view(), options(), &patient));
    StopAfter atOnce(0);
    InterrupterOf<openvdb::util::NullInterrupter> impatient(atOnce);
    EXPECT_THROW(reconstruct(points.view(), options(), &impatient), Interrupted);
}

} // namespace
} // namespace mpuvdb
