// Fields of known values, sampled: the band is complete, closed and signed.
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/sampling.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>
#include <openvdb/tree/ValueAccessor.h>
#include <tbb/global_control.h>

#include <functional>
#include <thread>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Accessor = openvdb::FloatGrid::ConstAccessor;
using test::sampled;

CheckReport checked(const LevelSet& levelSet)
{
    Interrupter progress;
    return check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
}

/// Call f(voxel) for all voxels of a box @a margin voxels larger than @a bounds.
template <typename F>
void forEachVoxel(const Box3d& bounds, const Lattice& lattice, double margin, F f)
{
    const Vec3d reach = Vec3d::Constant(margin);
    const Vec3i low = ((bounds.min() - lattice.origin) / lattice.voxelSize - reach)
                          .array()
                          .floor()
                          .matrix()
                          .cast<int>();
    const Vec3i high = ((bounds.max() - lattice.origin) / lattice.voxelSize + reach)
                           .array()
                           .ceil()
                           .matrix()
                           .cast<int>();
    for (int x = low[0]; x <= high[0]; ++x)
        for (int y = low[1]; y <= high[1]; ++y)
            for (int z = low[2]; z <= high[2]; ++z) f(Coord(x, y, z));
}

/// A plane that says it ends.
class Endless final : public Field
{
public:
    Box3d bounds() const override { return {Vec3d::Constant(-0.5), Vec3d::Constant(0.5)}; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        return {p[2] - 0.01, Vec3d::UnitZ(), -1, true};
    }
    std::vector<Vec3i> seedBlocks(const Lattice&) const override { return {Vec3i::Zero()}; }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double) const override
    {
        return std::make_unique<Sampler>(lattice);
    }

private:
    class Sampler final : public BlockSampler
    {
    public:
        explicit Sampler(const Lattice& lattice) : mLattice(lattice) {}
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            for (int i = 0; i < kBlockVoxels; ++i) {
                const double z =
                    mLattice.origin[2] + mLattice.voxelSize * (kBlockDim * block[2] + (i & 7));
                values[std::size_t(i)] = float(z - 0.01);
            }
        }

    private:
        Lattice mLattice;
    };
};

/// Expects in every voxel around what the solid's exact distance says.
void expectExact(const std::string& description, double voxelSize, double halfWidth,
                 const Vec3d& origin)
{
    SCOPED_TRACE(description);
    const auto solid = parseSolid(description);
    const LevelSet levelSet = sampled(*makeSolidField(solid), voxelSize, halfWidth, origin);
    const double background = halfWidth * voxelSize, margin = 0.01 * voxelSize;
    const double rounding = 1e-6 * background;
    const Accessor at = levelSet.grid().getConstAccessor();
    std::uint64_t wrong = 0, inBand = 0;
    forEachVoxel(solid->bounds(), levelSet.lattice(), halfWidth + 10, [&](const Coord& c) {
        const double d = solid->distance(test::worldOf(levelSet.lattice(), c));
        const double value = double(at.getValue(c));
        const bool active = at.isValueOn(c);
        inBand += active;
        const double expected = active ? d : std::copysign(background, d);
        const bool near = std::abs(d)<background - margin, far = std::abs(d)> background + margin;
        const bool ok =
            std::abs(value - expected) <= rounding && !(near && !active) && !(far && active);
        if (!ok && ++wrong == 1)
            ADD_FAILURE() << c << " is " << value << (active ? ", active" : ", inactive")
                          << "; the distance is " << d;
    });
    EXPECT_EQ(wrong, 0u);
    EXPECT_EQ(levelSet.grid().activeVoxelCount(), inBand);
    EXPECT_EQ(float(background), levelSet.grid().background());
    const CheckReport report = checked(levelSet);
    EXPECT_TRUE(report.sound()) << test::texts(report);
}

TEST(SampleField, GivesExactDistancesInACompleteBand)
{
    expectExact("sphere(1)", 1.0 / 24, 3, Vec3d::Zero());
    expectExact("torus(1, 0.4)", 1.0 / 20, 3, Vec3d(0.013, 0.02, -0.007));
    expectExact("box(1, 0.8, 1.2)", 1.0 / 24, 3, Vec3d(0.0131, 0.0072, 0.0043));
    expectExact("rotate(roundedbox(1, 0.8, 1.2, 0.2), 1, 2, 3, 40)", 1.0 / 24, 5, Vec3d::Zero());
    expectExact("capsule(0.4, 1)", 1.0 / 24, 1.5, Vec3d(1e-3, 0, 0));
    expectExact("cylinder(0.5, 1)", 1.0 / 16, 10, Vec3d(1e-3, 2e-3, 3e-3));
}

TEST(SampleField, RoundingOnFacesInAPlaneOfVoxelsDoesNoHarm)
{
    // Turned there and back: every voxel on a face is some 1e-17 to one side of it or the other.
    expectExact("rotate(rotate(rotate(box(1,0.5,0.3),0,0,1,10),0,0,1,50),0,0,1,-60)", 0.01, 3,
                Vec3d::Zero());
    expectExact("rotate(box(1,1,1),1,1,1,120)", 0.02, 6, Vec3d::Zero());
}

TEST(SampleField, FindsPartsThatDoNotMeet)
{
    const auto solid =
        parseSolid("union(translate(sphere(0.5), -2, 0, 0),"
                   "translate(sphere(0.25), 3, 1, 0), translate(sphere(0.1), 0, 0, 5))");
    const LevelSet levelSet = sampled(*makeSolidField(solid), 1.0 / 32);
    const Accessor at = levelSet.grid().getConstAccessor();
    for (const Vec3i& inside : {Vec3i(-64, 0, 0), Vec3i(96, 32, 0), Vec3i(0, 0, 160)})
        EXPECT_LT(at.getValue(Coord(inside[0], inside[1], inside[2])), 0);
    EXPECT_GT(at.getValue(Coord(0, 0, 0)), 0);
    Interrupter progress;
    const MeshReport mesh = measure(extractMesh(levelSet, {}, &progress));
    EXPECT_EQ(mesh.components, 3u);
    EXPECT_EQ(mesh.eulerCharacteristic, 6);
    EXPECT_TRUE(checked(levelSet).sound()) << test::texts(checked(levelSet));
}

TEST(SampleField, SignsHollowsOutsideAndSolidsInside)
{
    // A hollow ball with a ball in it, each far thicker than the band: tiles of every sign.
    const auto solid = parseSolid("union(difference(sphere(2), sphere(1.4)), sphere(0.7))");
    const LevelSet levelSet = sampled(*makeSolidField(solid), 1.0 / 32);
    const Accessor at = levelSet.grid().getConstAccessor();
    const float background = levelSet.grid().background();
    EXPECT_EQ(at.getValue(Coord(0, 0, 0)), -background);
    EXPECT_EQ(at.getValue(Coord(33, 0, 0)), background);
    EXPECT_EQ(at.getValue(Coord(0, 54, 0)), -background);
    EXPECT_EQ(at.getValue(Coord(0, 0, 100)), background);
    EXPECT_TRUE(checked(levelSet).sound()) << test::texts(checked(levelSet));
}

// --- Fields that are no distance

/// Any function as a field, with the seeds of its box.
class FunctionField final : public Field
{
public:
    using Function = std::function<double(const Vec3d&)>;

    FunctionField(Function function, const Box3d& box) : mFunction(std::move(function)), mBox(box)
    {
    }
    Box3d bounds() const override { return mBox; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        return {mFunction(p), Vec3d::UnitX(), 0, true};
    }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        const double edge = kBlockDim * lattice.voxelSize;
        const Vec3i low = (mBox.min() / edge).array().floor().cast<int>();
        const Vec3i high = (mBox.max() / edge).array().floor().cast<int>();
        std::vector<Vec3i> blocks;
        for (int x = low[0]; x <= high[0]; ++x)
            for (int y = low[1]; y <= high[1]; ++y)
                for (int z = low[2]; z <= high[2]; ++z) blocks.emplace_back(x, y, z);
        return blocks;
    }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double) const override
    {
        return std::make_unique<Sampler>(mFunction, lattice);
    }

private:
    class Sampler final : public BlockSampler
    {
    public:
        Sampler(const Function& function, const Lattice& lattice)
            : mFunction(function), mLattice(lattice)
        {
        }
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            for (int i = 0; i < kBlockVoxels; ++i) {
                const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
                values[std::size_t(i)] =
                    float(mFunction(mLattice.origin + mLattice.voxelSize * voxel.cast<double>()));
            }
        }

    private:
        const Function& mFunction;
        Lattice mLattice;
    };

    Function mFunction;
    Box3d mBox;
};

/// Pairs of face neighbors of different sign, of which one is inactive.
std::uint64_t openSignChanges(const LevelSet& levelSet)
{
    const Accessor at = levelSet.grid().getConstAccessor();
    openvdb::CoordBBox box = levelSet.grid().evalActiveVoxelBoundingBox();
    box.expand(20);
    std::uint64_t open = 0;
    for (auto c = box.beginXYZ(); c; ++c) {
        for (const Coord& step : {Coord(1, 0, 0), Coord(0, 1, 0), Coord(0, 0, 1)}) {
            const Coord next = *c + step;
            open += (at.getValue(*c) < 0) != (at.getValue(next) < 0) &&
                    !(at.isValueOn(*c) && at.isValueOn(next));
        }
    }
    return open;
}

void expectClosed(const LevelSet& levelSet)
{
    EXPECT_EQ(openSignChanges(levelSet), 0u);
    Interrupter progress;
    const MeshReport mesh = measure(extractMesh(levelSet, {}, &progress));
    EXPECT_GT(mesh.triangles, 0u);
    EXPECT_EQ(mesh.boundaryEdges, 0u);
    EXPECT_EQ(mesh.nonManifoldEdges, 0u);
}

TEST(SampleField, ClosesAFieldWhoseValuesJump)
{
    // A ball of which a half is far inside up to a cut, where the value jumps beyond the band.
    const double h = 1.0 / 16;
    const FunctionField::Function cutBall = [](const Vec3d& p) {
        const double d = p.norm() - 1;
        return p[0] + 0.3 * p[1] > 0.11 ? 5.0 : d;
    };
    const LevelSet levelSet =
        sampled(FunctionField(cutBall, Box3d(Vec3d(-1, -1, -1), Vec3d(-0.5, 1, 1))), h);
    expectClosed(levelSet);
    const Accessor at = levelSet.grid().getConstAccessor();
    EXPECT_LT(at.getValue(Coord(-4, 0, 0)), 0);
    EXPECT_GT(at.getValue(Coord(8, 0, 0)), 0);
}

TEST(SampleField, ClosesAFieldOfTwoValues)
{
    const double h = 1.0 / 16;
    const FunctionField::Function indicator = [](const Vec3d& p) {
        return p.norm() < 1 ? -1.0 : 1.0;
    };
    const LevelSet levelSet =
        sampled(FunctionField(indicator, Box3d(Vec3d::Constant(-1), Vec3d::Constant(1))), h);
    expectClosed(levelSet);
    EXPECT_LT(levelSet.grid().getConstAccessor().getValue(Coord(0, 0, 0)), 0);
}

TEST(SampleField, KeepsTheSurfaceWhereValuesRiseTooFast)
{
    // A ball whose values rise by 1 to 1.8 per unit, more on one side than on the other.
    const double h = 1.0 / 40;
    const FunctionField::Function steepBall = [](const Vec3d& p) {
        return (p.norm() - 1) * (1.4 + 0.4 * std::sin(3 * p[0] + p[1]));
    };
    const LevelSet levelSet =
        sampled(FunctionField(steepBall, Box3d(Vec3d::Constant(-1), Vec3d::Constant(1))), h);
    EXPECT_TRUE(checked(levelSet).sound()) << test::texts(checked(levelSet));
    Interrupter progress;
    double farthest = 0, turned = 0;
    const Mesh mesh = extractMesh(levelSet, {}, &progress);
    for (const Mesh::Triangle& t : mesh.triangles) {
        std::array<Vec3d, 3> corner;
        for (std::size_t k = 0; k < 3; ++k) {
            corner[k] = mesh.world(t[k]);
            farthest = std::max(farthest, std::abs(corner[k].norm() - 1));
        }
        const Vec3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
        const Vec3d middle = (corner[0] + corner[1] + corner[2]) / 3;
        turned = std::max(turned, std::acos(std::min(1.0, normal.dot(middle.normalized()))));
    }
    // Corrected here and not there, such values move the surface by half a voxel and turn it by 64
    // degrees. Evened, they are off by how much the slope changes over two voxels, 2 * 3 h * 0.4.
    EXPECT_LT(farthest, 0.1 * h);
    EXPECT_LT(turned, 4 * h);
}

TEST(SampleField, SignsAJumpThatItsSeedsOnlyTouch)
{
    // The seeds see the inside alone where the field jumps without a band.
    const double h = 1.0 / 16;
    const FunctionField::Function halfIndicator = [](const Vec3d& p) {
        const double d = p.norm() - 1;
        return p[2] > 0.1 ? d : d < 0 ? -1.0 : 1.0;
    };
    const LevelSet levelSet =
        sampled(FunctionField(halfIndicator, Box3d(Vec3d(-1, -1, 0.5), Vec3d(1, 1, 1))), h);
    expectClosed(levelSet);
    EXPECT_LT(levelSet.grid().getConstAccessor().getValue(Coord(0, 0, 0)), 0);
    EXPECT_GT(levelSet.grid().getConstAccessor().getValue(Coord(0, 0, -40)), 0);
}

// --- Settings, limits, threads

TEST(SampleField, RefusesWhatItCannotSample)
{
    const FieldPtr field = makeSolidField(parseSolid("sphere(1)"));
    const double nan = std::nan("");
    for (const double bad : {0.0, -1.0, nan, std::numeric_limits<double>::infinity()})
        EXPECT_THROW(sampled(*field, bad), UsageError);
    for (const double bad : {1.4, 1000.5, nan}) EXPECT_THROW(sampled(*field, 0.1, bad), UsageError);
    const FunctionField outside([](const Vec3d& p) { return 1 + p.norm(); },
                                Box3d(Vec3d::Constant(-1), Vec3d::Constant(1)));
    EXPECT_THROW(sampled(outside, 0.1), InputError);
}

TEST(SampleField, StaysWithinItsMemory)
{
    const FieldPtr field = makeSolidField(parseSolid("sphere(1)"));
    SampleSettings settings;
    settings.lattice.voxelSize = 1.0 / 64;
    Interrupter progress;
    settings.maxBytes = 1000000;
    EXPECT_THROW(sampleField(*field, settings, &progress), LimitError);
    settings.maxBytes = 1000000000;
    EXPECT_NO_THROW(sampleField(*field, settings, &progress));
}

TEST(SampleField, SetsWhatALevelSetIs)
{
    SampleSettings settings;
    settings.lattice = {Vec3d(10, -20, 30), 0.1};
    settings.halfWidth = 4;
    settings.name = "skin";
    Interrupter progress;
    const LevelSet levelSet = sampleField(
        *makeSolidField(parseSolid("translate(sphere(1), 10, -20, 30)")), settings, &progress);
    EXPECT_EQ(levelSet.grid().getGridClass(), openvdb::GRID_LEVEL_SET);
    EXPECT_EQ(levelSet.grid().getName(), "skin");
    EXPECT_NEAR(levelSet.halfWidth(), 4, 1e-6);
    EXPECT_EQ(levelSet.lattice().origin, settings.lattice.origin);
    EXPECT_EQ(levelSet.lattice().voxelSize, 0.1);
    EXPECT_LT(levelSet.grid().getConstAccessor().getValue(Coord(0, 0, 0)), 0);
}

TEST(SampleField, DoesNotDependOnThreads)
{
    const FieldPtr field =
        makeSolidField(parseSolid("union(torus(1, 0.3), translate(sphere(0.5), 0, 0, 2))"));
    std::vector<std::string> bytes;
    for (const std::size_t threads : {1u, 2u, 8u}) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        bytes.push_back(test::treeBytes(sampled(*field, 1.0 / 32).grid()));
    }
    EXPECT_TRUE(bytes[0] == bytes[1]);
    EXPECT_TRUE(bytes[0] == bytes[2]);
}

TEST(SampleField, RefusesASurfaceThatLeavesItsBounds)
{
    try {
        sampled(Endless(), 0.02);
        FAIL() << "an endless surface was sampled";
    } catch (const InputError& e) {
        EXPECT_NE(std::string(e.what()).find("leaves its bounds (-0.5"), std::string::npos)
            << e.what();
    }
}

} // namespace
} // namespace mpuvdb
