#include "grid/solid_bounds.h"
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <fmt/format.h>

#include <gtest/gtest.h>
#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <tbb/global_control.h>

#include <cstdlib>
#include <limits>
#include <random>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;

constexpr float kBallVoxel = 0.05f;

/// A sphere of radius 20 voxels about the origin.
FloatGrid::Ptr sphere(float halfWidth = 3)
{
    return openvdb::tools::createLevelSetSphere<FloatGrid>(20 * kBallVoxel, openvdb::Vec3f(0),
                                                           kBallVoxel, halfWidth);
}

CheckReport checked(const FloatGrid& grid)
{
    Interrupter progress;
    return check(grid, kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
}

/// The finding whose text contains @a what.
const CheckFinding* find(const CheckReport& report, const std::string& what)
{
    for (const CheckFinding& finding : report.findings)
        if (finding.what.find(what) != std::string::npos) return &finding;
    return nullptr;
}

std::string texts(const CheckReport& report)
{
    std::ostringstream out;
    for (const CheckFinding& f : report.findings)
        out << f.what << " at " << f.voxel << " (" << f.count << ")\n";
    return out.str();
}

/// Expects one kind of finding, at one voxel.
void expectOnly(const FloatGrid& grid, const std::string& what, const Coord& voxel,
                std::uint64_t count)
{
    const CheckReport report = checked(grid);
    ASSERT_EQ(report.findings.size(), 1u) << texts(report);
    EXPECT_NE(report.findings[0].what.find(what), std::string::npos) << texts(report);
    EXPECT_EQ(report.findings[0].voxel, voxel) << texts(report);
    EXPECT_EQ(report.findings[0].count, count) << texts(report);
}

/// Expects a finding that contains @a what among others.
void expectFound(const FloatGrid& grid, const std::string& what, const Coord& voxel)
{
    const CheckReport report = checked(grid);
    const CheckFinding* finding = find(report, what);
    ASSERT_TRUE(finding) << texts(report);
    EXPECT_EQ(finding->voxel, voxel) << texts(report);
}

TEST(Check, AcceptsSpheresOfEveryBand)
{
    for (const float halfWidth : {1.5f, 2.f, 3.f, 5.f, 10.f}) {
        const auto grid = sphere(halfWidth);
        const CheckReport report = checked(*grid);
        EXPECT_TRUE(report.sound()) << halfWidth << ": " << texts(report);
        EXPECT_EQ(report.activeVoxels, grid->activeVoxelCount());
        EXPECT_LT(report.meanGradientError, 0.01);
        EXPECT_NEAR(report.bandInside, halfWidth, 0.1);
        EXPECT_NEAR(report.bandOutside, halfWidth, 0.1);
    }
}

TEST(Check, AcceptsSmallAndFarAndEmpty)
{
    for (const float radius : {1.0f, 2.0f, 3.5f, 100.0f})
        EXPECT_TRUE(checked(*openvdb::tools::createLevelSetSphere<FloatGrid>(
                                radius, openvdb::Vec3f(12345.5f, -777, 0.25f), 1))
                        .sound())
            << radius;
    const auto empty = FloatGrid::create(3);
    empty->setGridClass(openvdb::GRID_LEVEL_SET);
    EXPECT_TRUE(checked(*empty).sound());
}

TEST(Check, AcceptsGridsOfOtherPrograms)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set";
    openvdb::initialize();
    for (const char* name : {"sphere.vdb", "cube.vdb"}) {
        openvdb::io::File file(std::string(folder) + "/vdb/" + name);
        file.open(false);
        const auto grid =
            openvdb::gridPtrCast<FloatGrid>(file.readGrid(file.beginName().gridName()));
        const CheckReport report = checked(*grid);
        EXPECT_TRUE(report.sound()) << name << ": " << texts(report);
        EXPECT_EQ(report.activeVoxels, grid->activeVoxelCount());
    }
}

TEST(Check, ReportsNothingFinite)
{
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const Coord at(20, 0, 0), inactive(23, 0, 0);
    auto grid = sphere();
    ASSERT_FALSE(grid->tree().isValueOn(inactive));
    ASSERT_TRUE(grid->tree().probeConstLeaf(inactive));
    grid->tree().setValueOnly(at, nan);
    expectOnly(*grid, "not finite", at, 1);
    grid->tree().setValueOnly(inactive, -std::numeric_limits<float>::infinity());
    const CheckReport report = checked(*grid);
    ASSERT_TRUE(find(report, "not finite"));
    EXPECT_EQ(find(report, "not finite")->count, 2u);
    EXPECT_EQ(find(report, "not finite")->voxel, at);
    EXPECT_EQ(find(report, "sign changes")->voxel, inactive);
}

TEST(Check, ReportsAFlippedActiveVoxel)
{
    for (const Coord at : {Coord(22, 0, 0), Coord(-18, 0, 0), Coord(13, -13, 1)}) {
        auto grid = sphere();
        ASSERT_TRUE(grid->tree().isValueOn(at));
        grid->tree().setValueOnly(at, -grid->tree().getValue(at));
        expectFound(*grid, "from voxel to voxel", at);
    }
}

TEST(Check, ReportsAFlippedInactiveVoxelAndTile)
{
    auto grid = sphere();
    const Coord voxel(16, 0, 0);
    ASSERT_FALSE(grid->tree().isValueOn(voxel));
    ASSERT_TRUE(grid->tree().probeConstLeaf(voxel));
    grid->tree().setValueOnly(voxel, kBallVoxel * 3);
    expectFound(*grid, "sign changes", voxel);

    grid = sphere();
    ASSERT_FALSE(grid->tree().probeConstLeaf(Coord(0)));
    ASSERT_LT(grid->tree().getValue(Coord(0)), 0);
    grid->tree().addTile(1, Coord(0), 3 * kBallVoxel, false);
    // Named is a voxel that touches the tile.
    const CheckReport report = checked(*grid);
    ASSERT_TRUE(find(report, "sign changes")) << texts(report);
    const openvdb::CoordBBox touching(Coord(-1), Coord(8));
    EXPECT_TRUE(touching.isInside(find(report, "sign changes")->voxel)) << texts(report);
}

TEST(Check, ReportsInsideTilesMadePositive)
{
    auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(100.f, openvdb::Vec3f(0), 1.f);
    int flipped = 0;
    for (auto tile = grid->beginValueOff(); tile; ++tile)
        if (tile.isTileValue() && *tile < 0) {
            tile.setValue(-*tile);
            ++flipped;
        }
    ASSERT_GT(flipped, 10);
    const CheckReport report = checked(*grid);
    EXPECT_TRUE(find(report, "sign changes")) << texts(report);
}

TEST(Check, ReportsAHoleInTheBand)
{
    for (const Coord at : {Coord(20, 0, 0), Coord(0, 0, -21), Coord(12, 11, 11)}) {
        auto grid = sphere();
        const float value = grid->tree().getValue(at);
        grid->tree().setValueOff(at, value < 0 ? -3 * kBallVoxel : 3 * kBallVoxel);
        const CheckReport report = checked(*grid);
        const CheckFinding* hole = find(report, "missing");
        ASSERT_TRUE(hole) << texts(report);
        EXPECT_EQ(hole->voxel, at) << texts(report);
        EXPECT_EQ(hole->count, 1u);
    }
}

TEST(Check, ReportsBandsNarrowerThanPromised)
{
    // The inner half deactivated from two voxels on.
    auto grid = sphere();
    for (auto v = grid->beginValueOn(); v; ++v)
        if (*v < -1.95f * kBallVoxel) {
            v.setValue(-3 * kBallVoxel);
            v.setActiveState(false);
        }
    const CheckReport narrow = checked(*grid);
    ASSERT_TRUE(find(narrow, "missing")) << texts(narrow);
    EXPECT_EQ(find(narrow, "missing")->voxel, Coord(-18, -1, 0)) << texts(narrow);
    EXPECT_NEAR(narrow.bandInside, 1.95, 0.05);
    EXPECT_NEAR(narrow.bandOutside, 3, 0.05);

    // A background that promises more than there is: the inactive values disagree, too.
    grid = sphere();
    openvdb::tools::changeBackground(grid->tree(), 5 * kBallVoxel);
    EXPECT_TRUE(find(checked(*grid), "missing")) << texts(checked(*grid));
    // And less.
    grid = sphere();
    openvdb::tools::changeBackground(grid->tree(), 2 * kBallVoxel);
    EXPECT_TRUE(find(checked(*grid), "beyond the background")) << texts(checked(*grid));
}

TEST(Check, ReportsValuesBeyondTheBackground)
{
    auto grid = sphere();
    const Coord at(-22, 5, 0);
    grid->tree().setValueOnly(at, 3.01f * kBallVoxel);
    expectOnly(*grid, "beyond the background", at, 1);

    grid = sphere();
    const Coord inactive(16, 0, 0);
    grid->tree().setValueOnly(inactive, -2 * kBallVoxel);
    expectOnly(*grid, "inactive values", inactive, 1);
}

TEST(Check, ReportsActiveTiles)
{
    auto grid = sphere();
    grid->tree().addTile(1, Coord(40, 40, 40), 3 * kBallVoxel, true);
    expectOnly(*grid, "active tiles", Coord(40, 40, 40), 512);
}

TEST(Check, ReportsActiveVoxelsFarFromAnySurface)
{
    // A block of one value, of which the voxels inside see nothing else.
    const Coord low(56, 56, 56);
    auto grid = sphere();
    for (int x = 0; x < 8; ++x)
        for (int y = 0; y < 8; ++y)
            for (int z = 0; z < 8; ++z)
                grid->tree().setValue(low.offsetBy(x, y, z), 2 * kBallVoxel);
    expectOnly(*grid, "neighbors all have their value", low.offsetBy(1), 6 * 6 * 6);

    // One voxel of the background's value amid the background.
    grid = sphere();
    grid->tree().setValueOn(low, 3 * kBallVoxel);
    expectOnly(*grid, "neighbors all have their value", low, 1);
}

TEST(Check, ReportsWhatIsNoDistance)
{
    for (const float factor : {2.f, 0.5f}) {
        auto grid = sphere();
        for (auto v = grid->beginValueOn(); v; ++v)
            v.setValue(std::max(-3 * kBallVoxel, std::min(3 * kBallVoxel, *v * factor)));
        const CheckReport report = checked(*grid);
        ASSERT_TRUE(find(report, "not a distance")) << texts(report);
        EXPECT_GT(find(report, "not a distance")->count, report.activeVoxels / 4);
        EXPECT_GT(report.meanGradientError, 0.3);
    }
}

TEST(Check, KnowsLittleOfTheMeanOverFewVoxels)
{
    // Slopes that are 0.2 off, and 0.8, all over the band; and where it grazes one leaf.
    const openvdb::CoordBBox all = openvdb::CoordBBox::inf(),
                             grazed(Coord(-1, -1, 23), Coord(8, 8, 32));
    const auto isNoDistance = [](float factor, const openvdb::CoordBBox& within) {
        const auto grid =
            openvdb::tools::createLevelSetSphere<FloatGrid>(22.2f, openvdb::Vec3f(0), 1.f);
        for (auto v = grid->beginValueOn(); v; ++v) v.setValue(*v * factor);
        Interrupter progress;
        const CheckReport report = check(*grid, kGradientTolerance, within, &progress);
        EXPECT_NEAR(report.meanGradientError, factor - 1, 0.05);
        return find(report, "not a distance") != nullptr;
    };
    EXPECT_TRUE(isNoDistance(1.2f, all));
    EXPECT_FALSE(isNoDistance(1.2f, grazed));
    EXPECT_TRUE(isNoDistance(1.8f, grazed));
}

TEST(Check, ReportsClassTransformAndBackground)
{
    auto grid = sphere();
    grid->setGridClass(openvdb::GRID_FOG_VOLUME);
    expectOnly(*grid, "fog volume", Coord(), 0);

    grid = sphere();
    grid->transform().preScale(openvdb::Vec3d(1, 1, 2));
    expectOnly(*grid, "not cubes", Coord(), 0);
    grid = sphere();
    grid->transform().preRotate(0.1);
    expectOnly(*grid, "turns or shears the axes", Coord(), 0);
    grid = sphere();
    grid->transform().preScale(openvdb::Vec3d(1, -1, 1));
    expectOnly(*grid, "mirrors an axis", Coord(), 0);
    EXPECT_THROW(LevelSet{grid}, InputError);

    grid = sphere();
    grid->tree().root().setBackground(-3 * kBallVoxel, false);
    expectOnly(*grid, "background", Coord(), 0);
    grid->tree().root().setBackground(0.5f * kBallVoxel, false);
    expectOnly(*grid, "background is 0.5 voxels", Coord(), 0);
}

TEST(Check, IsTheSameForAnyNumberOfThreads)
{
    auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(60.f, openvdb::Vec3f(0), 1.f);
    for (auto v = grid->beginValueOn(); v; ++v)
        if ((v.getCoord().x() * 31 + v.getCoord().y() * 17 + v.getCoord().z()) % 97 == 0)
            v.setValue(-*v);
    std::string first;
    double mean = 0;
    for (const std::size_t threads : {1, 2, 8}) {
        tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        const CheckReport report = checked(*grid);
        EXPECT_FALSE(report.sound());
        if (first.empty()) {
            first = texts(report);
            mean = report.meanGradientError;
        }
        EXPECT_EQ(texts(report), first);
        EXPECT_EQ(report.meanGradientError, mean);
    }
}

TEST(Check, CanBeInterrupted)
{
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(check(*sphere(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress),
                 Interrupted);
}

TEST(LevelSetClass, TellsItsLattice)
{
    auto grid = sphere(4);
    grid->transform().postTranslate(openvdb::Vec3d(5e6, -1, 2));
    const LevelSet levelSet(grid);
    EXPECT_DOUBLE_EQ(levelSet.voxelSize(), double(kBallVoxel));
    EXPECT_NEAR(levelSet.halfWidth(), 4, 1e-6);
    EXPECT_EQ(levelSet.lattice().origin, Vec3d(5e6, -1, 2));
}

TEST(LevelSetClass, RefusesWhatIsNone)
{
    EXPECT_THROW(LevelSet(nullptr), InputError);
    auto grid = sphere();
    grid->setGridClass(openvdb::GRID_UNKNOWN);
    EXPECT_THROW(LevelSet{grid}, InputError);
    grid = sphere();
    grid->transform().preScale(openvdb::Vec3d(1, 1, 1.01));
    EXPECT_THROW(LevelSet{grid}, InputError);
    grid = sphere();
    grid->transform().preScale(openvdb::Vec3d(1, -1, 1));
    EXPECT_THROW(LevelSet{grid}, InputError);
    grid = sphere();
    grid->tree().root().setBackground(0, false);
    EXPECT_THROW(LevelSet{grid}, InputError);
}

TEST(Lattice, KeepsTheWorldsMultiplesOfTheVoxelSize)
{
    const double h = 0.3;
    for (const double at : {0.0, 1e5, 5e6, -5e6}) {
        const Vec3d middle(at, 2 * at + 0.7, -3);
        const Box3d bounds(middle - Vec3d(1, 2, 3), middle + Vec3d(1, 2, 3));
        const Lattice lattice = latticeFor(bounds, h);
        EXPECT_EQ(lattice.voxelSize, h);
        const double reach = bounds.max().cwiseAbs().cwiseMax(bounds.min().cwiseAbs()).maxCoeff();
        if (reach / h < 1 << 20)
            EXPECT_EQ(lattice.origin, Vec3d::Zero());
        else
            EXPECT_LE((lattice.origin - middle).cwiseAbs().maxCoeff(), 4 * h * (1 + 1e-9));
        for (int axis = 0; axis < 3; ++axis) {
            const double steps = lattice.origin[axis] / (8 * h);
            EXPECT_NEAR(steps, std::round(steps), 1e-8);
        }
    }
}

TEST(Lattice, RefusesNonsense)
{
    const Box3d unit(Vec3d::Zero(), Vec3d::Ones());
    const double infinity = std::numeric_limits<double>::infinity();
    for (const double h : {0.0, -1.0, infinity, std::nan("")})
        EXPECT_THROW(latticeFor(unit, h), UsageError) << h;
    EXPECT_THROW(latticeFor(Box3d(), 1), InputError);
    EXPECT_THROW(latticeFor(Box3d(Vec3d::Zero(), Vec3d(1, 1, infinity)), 1), InputError);
    EXPECT_THROW(latticeFor(unit, 1e-12), LimitError);
    EXPECT_THROW(latticeFor(unit, 1e19), LimitError);
    EXPECT_THROW(latticeFor(Box3d(Vec3d(1e18, 0, 0), Vec3d(1e18, 1, 1)), 1), LimitError);
}

TEST(Lattice, IsWholeInCopiesOrRefused)
{
    constexpr double h = 0.03;
    for (double far = 1e6; far < 1e9; far *= 1.37) {
        const Box3d box(Vec3d(far, 0, 0), Vec3d(far + 1, 1, 1));
        if (far / h < 8e9) {
            const LevelSet made = emptyLevelSet(latticeFor(box, h), 3);
            EXPECT_NEAR(LevelSet(made.grid().deepCopy()).voxelSize(), h, 1e-6 * h) << far;
        } else {
            EXPECT_THROW(latticeFor(box, h), LimitError) << far;
            EXPECT_THROW(emptyLevelSet({box.min(), h}, 3), LimitError) << far;
        }
    }
}

TEST(SolidBounds, AreThoseOfTheSurface)
{
    // In the band, above a corner, lies a voxel at a height t of two voxels or more and at most
    // s = sqrt(1/2) voxels beside it. Its distance to the corner exceeds t by s^2 / (2 t) or less.
    constexpr double kCorner = 0.5 / (2 * 2);
    const unsigned seed = 3;
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto one = [&] { return Vec3d(unit(random), unit(random), unit(random)); };
    for (int trial = 0; trial < 20; ++trial) {
        SCOPED_TRACE(testing::Message() << "seed " << seed << ", trial " << trial);
        const Eigen::Affine3d turn = Eigen::Translation3d(5 * one()) *
                                     Eigen::AngleAxisd(3 * unit(random), one().normalized());
        const Vec3d half = Vec3d(15, 11, 8) + one();
        const double h = 0.7;
        const Shape box(makeSolidField(parseSolid(fmt::format("box({},{},{})", 2 * h * half[0],
                                                              2 * h * half[1], 2 * h * half[2]))),
                        "box");
        Eigen::Affine3d motion = turn;
        motion.translation() *= h;
        const Box3d found = solidBounds(box.moved(motion).evaluate({h, 3, 0}));
        Box3d exact;
        for (int corner = 0; corner < 8; ++corner)
            exact.extend(Vec3d(
                motion * (h * half.cwiseProduct(Vec3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1,
                                                      corner & 4 ? 1 : -1)))));
        for (int axis = 0; axis < 3; ++axis) {
            EXPECT_NEAR((found.min()[axis] - exact.min()[axis]) / h, kCorner / 2,
                        kCorner / 2 + 1e-3);
            EXPECT_NEAR((exact.max()[axis] - found.max()[axis]) / h, kCorner / 2,
                        kCorner / 2 + 1e-3);
        }
    }
    const Box3d ball = solidBounds(LevelSet(sphere()));
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(ball.min()[axis], -20 * kBallVoxel, 1e-5);
        EXPECT_NEAR(ball.max()[axis], 20 * kBallVoxel, 1e-5);
    }
    EXPECT_TRUE(solidBounds(emptyLevelSet({Vec3d::Zero(), 1}, 3)).isEmpty());
}

} // namespace
} // namespace mpuvdb
