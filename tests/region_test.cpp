// A part of a level set, beside the whole: the same voxels with the same values.
#include "field_fixture.h"
#include "thin_to.h"
#include "uncleaned.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;

/// Voxels in @a box whose state or, if active, value differs.
std::uint64_t differences(const LevelSet& part, const LevelSet& whole, const CoordBBox& box)
{
    const auto a = part.grid().getConstAccessor(), b = whole.grid().getConstAccessor();
    std::uint64_t count = 0;
    for (auto c = box.beginXYZ(); c; ++c) {
        const bool active = b.isValueOn(*c);
        if (a.isValueOn(*c) != active) ++count;
        // Signs too: what is inactive is deep inside or outside.
        else if (active ? a.getValue(*c) != b.getValue(*c)
                        : (a.getValue(*c) < 0) != (b.getValue(*c) < 0))
            ++count;
    }
    return count;
}

/// A box around a random active voxel of @a levelSet.
Box3d randomBox(const LevelSet& levelSet, test::Random& random, double voxels)
{
    std::size_t skip = random.below(levelSet.grid().activeVoxelCount());
    auto value = levelSet.grid().cbeginValueOn();
    while (skip-- > 0) ++value;
    const Vec3d center = test::worldOf(levelSet.lattice(), value.getCoord());
    const double h = levelSet.voxelSize();
    const Vec3d low(random.uniform(1, voxels), random.uniform(1, voxels),
                    random.uniform(1, voxels)),
        high(random.uniform(1, voxels), random.uniform(1, voxels), random.uniform(1, voxels));
    return {center - h * low, center + h * high};
}

std::array<Length, 6> lengths(const Box3d& box)
{
    std::array<Length, 6> result;
    for (std::size_t n = 0; n < 6; ++n)
        result[n] = {(n < 3 ? box.min() : box.max())[int(n % 3)], Length::Unit::World};
    return result;
}

/// Parts of a reconstruction beside the whole.
void expectSameInRegions(const PointCloud& cloud, test::Uncleaned settings, std::uint64_t seed,
                         int regions, double voxels)
{
    Interrupter progress;
    const LevelSet whole = reconstruct(PointCloud(cloud), settings, &progress).levelSet();
    const CheckReport wholeReport =
        check(whole.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(wholeReport.sound()) << test::texts(wholeReport);
    test::Random random(seed);
    for (int n = 0; n < regions; ++n) {
        const Box3d box = randomBox(whole, random, voxels);
        settings.region = lengths(box);
        const ReconstructResult part = reconstruct(PointCloud(cloud), settings, &progress);
        const CoordBBox inside = voxelsIn(box, whole.lattice());
        EXPECT_EQ(differences(part.levelSet(), whole, inside), 0u)
            << "seed " << seed << " " << inside;
        EXPECT_TRUE(inside.isInside(part.levelSet().grid().evalActiveVoxelBoundingBox()));
        const CheckReport report =
            check(part.levelSet().grid(), kGradientTolerance, inside, &progress);
        EXPECT_TRUE(report.sound()) << test::texts(report);
    }
}

test::Uncleaned voxelSize(double h)
{
    test::Uncleaned settings;
    settings.voxelSize = Length{h, Length::Unit::World};
    return settings;
}

TEST(Region, IsTheSameAsTheWholeOnCompleteData)
{
    expectSameInRegions(test::randomScan("torus(1, 0.4)", 40000), voxelSize(0.015), 1, 4, 60);
    expectSameInRegions(test::randomScan("rotate(box(2, 1.5, 1), 1, 2, 3, 25)", 40000),
                        voxelSize(0.015), 2, 4, 60);
    expectSameInRegions(test::randomScan("difference(sphere(1), sphere(0.8))", 60000),
                        voxelSize(0.015), 3, 4, 30);
}

TEST(Region, IsTheSameAsTheWholeOnIncompleteAndNoisyData)
{
    ScanSettings scan;
    scan.points = 40000;
    scan.pattern = ScanSettings::Pattern::Random;
    scan.holes = 4;
    scan.holeRadius = 0.15;
    expectSameInRegions(test::scanOf("blob(1, 20, 0.05)", scan), voxelSize(0.015), 4, 6, 60);
    scan.noise = 0.01;
    expectSameInRegions(test::scanOf("torus(1, 0.2)", scan), voxelSize(0.015), 5, 6, 60);
}

TEST(Region, IsTheSameAsTheWholeOnCoarseData)
{
    // Points six voxels from each other and more: no narrow part is one of the data for certain.
    expectSameInRegions(test::randomScan("torus(1, 0.4)", 5000), voxelSize(0.01), 7, 6, 40);
    expectSameInRegions(test::randomScan("difference(sphere(1), sphere(0.96))", 4000),
                        voxelSize(0.015), 8, 6, 40);
    expectSameInRegions(test::randomScan("rotate(box(2, 1.5, 0.04), 1, 2, 3, 25)", 2000),
                        voxelSize(0.015), 9, 6, 40);
    expectSameInRegions(test::randomScan("blob(1, 20, 0.05)", 3000), voxelSize(0.012), 10, 6, 40);
}

/// Where surfaces cross at an acute angle, narrow parts are cut into pieces by chance, and a piece
/// in a region may be one of a cut that goes on beyond it, which data support.
TEST(Region, IsTheSameAsTheWholeWhereSurfacesCross)
{
    PointCloud cloud = test::randomScan("torus(1, 0.4)", 40000);
    const PointCloud other = test::randomScan("difference(box(2, 2, 1), cylinder(0.4, 3))", 60000);
    cloud.positions.insert(cloud.positions.end(), other.positions.begin(), other.positions.end());
    cloud.normals.insert(cloud.normals.end(), other.normals.begin(), other.normals.end());
    test::Uncleaned settings = voxelSize(0.018666);
    Interrupter progress;
    const LevelSet whole = reconstruct(PointCloud(cloud), settings, &progress).levelSet();
    for (const double z : {-0.5, 0.0, 0.18})
        for (const double x : {-1.35, -0.7, 0.1, 0.7}) {
            const Box3d box(Vec3d(x, 0.91, z), Vec3d(x + 1.16, 1.61, z + 0.95));
            settings.region = lengths(box);
            const ReconstructResult part = reconstruct(PointCloud(cloud), settings, &progress);
            EXPECT_EQ(differences(part.levelSet(), whole, voxelsIn(box, whole.lattice())), 0u)
                << "box at " << box.min().transpose();
        }
}

TEST(Region, OfCoarseDataIsSampledOnce)
{
    // Steps of voxels along a smooth surface are narrow all around it; none of them is a handle.
    const PointCloud cloud = test::randomScan("torus(1, 0.4)", 5000);
    test::Uncleaned settings = voxelSize(0.01);
    for (const Vec3d& center : {Vec3d(1.4, 0, 0), Vec3d(0, 1, 0.4), Vec3d(-0.7, 0.7, -0.4)}) {
        const Vec3d half = Vec3d::Constant(0.3);
        settings.region = lengths({center - half, center + half});
        Interrupter progress;
        reconstruct(PointCloud(cloud), settings, &progress);
        const std::vector<StageTime> stages = progress.stages();
        EXPECT_EQ(std::count_if(stages.begin(), stages.end(),
                                [](const StageTime& stage) { return stage.name == "sample"; }),
                  1)
            << center.transpose();
    }
}

TEST(Region, IsTheSameAsTheWholeOnScans)
{
    const char* const folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set: no real data";
    Interrupter progress;
    for (const char* name :
         {"bunny/bun000.ply", "bunny/bun.conf", "dragon_stand/dragonStandRight.conf"}) {
        SCOPED_TRACE(name);
        PointInput input =
            readPoints({std::filesystem::path(folder) / name}, BadPoints::Drop, {}, {}, &progress);
        test::thinTo(input.cloud, 25000);
        clean(input.cloud, {}, &progress);
        test::Uncleaned settings;
        settings.voxels = 120;
        expectSameInRegions(input.cloud, settings, 6, 3, 50);
    }
}

TEST(Region, DoesNotDependOnThreads)
{
    const PointCloud cloud = test::randomScan("torus(1, 0.4)", 20000);
    test::Uncleaned settings = voxelSize(0.02);
    settings.region = lengths({Vec3d(0.3, -0.5, -1), Vec3d(2, 0.5, 1)});
    std::vector<std::string> bytes;
    for (const std::size_t threads : {1u, 2u, 8u}) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Interrupter progress;
        bytes.push_back(
            test::treeBytes(reconstruct(PointCloud(cloud), settings, &progress).levelSet().grid()));
    }
    EXPECT_TRUE(bytes[0] == bytes[1]);
    EXPECT_TRUE(bytes[0] == bytes[2]);
}

TEST(Region, KnowsInsideFromOutsideWithoutASurface)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = 1.0 / 32;
    const auto ball = makeSolidField(parseSolid("sphere(1)"));
    for (const Vec3d& center : {Vec3d(0, 0, 0), Vec3d(5, 0, 0)}) {
        settings.region = Box3d(center - Vec3d::Constant(0.1), center + Vec3d::Constant(0.1));
        const LevelSet part = sampleField(*ball, settings, &progress);
        EXPECT_EQ(part.grid().activeVoxelCount(), 0u);
    }
    // Half of it inside: tiles there are.
    settings.region = Box3d(Vec3d(0, -0.3, -0.3), Vec3d(1.2, 0.3, 0.3));
    const LevelSet part = sampleField(*ball, settings, &progress);
    settings.region.reset();
    const LevelSet whole = sampleField(*ball, settings, &progress);
    EXPECT_EQ(
        differences(part, whole,
                    voxelsIn(Box3d(Vec3d(0, -0.3, -0.3), Vec3d(1.2, 0.3, 0.3)), settings.lattice)),
        0u);
}

TEST(Region, KnowsInsideFromOutsideFarFromTheSurface)
{
    // Of a node of the tree (128 voxels) the part that is looked at lies inside, without a surface.
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = 1.0 / 160;
    const auto ball = makeSolidField(parseSolid("sphere(1)"));
    const LevelSet whole = sampleField(*ball, settings, &progress);
    const Box3d box(Vec3d(0.6, -0.1, -0.1), Vec3d(1.1, 0.1, 0.1));
    settings.region = box;
    const LevelSet part = sampleField(*ball, settings, &progress);
    EXPECT_EQ(differences(part, whole, voxelsIn(box, settings.lattice)), 0u);
}

/// The unit ball; at (2,0,0) the value falls to a voxel and a half, and rises again.
class NearMiss final : public Field
{
public:
    static constexpr double kVoxel = 1.0 / 32;

    Box3d bounds() const override { return {Vec3d(-1, -1, -1), Vec3d(1, 1, 1)}; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        FieldSample sample;
        sample.value = std::min(p.norm() - 1, (p - Vec3d(2, 0, 0)).norm() + 1.5 * kVoxel);
        return sample;
    }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        return {Vec3i(int(std::floor(1 / (lattice.voxelSize * kBlockDim))), 0, 0)};
    }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        return std::make_unique<Sampler>(*this, lattice, band);
    }

private:
    struct Sampler final : BlockSampler {
        Sampler(const NearMiss& field, const Lattice& lattice, double band)
            : mField(field), mLattice(lattice), mBand(band)
        {
        }
        void evaluate(const Vec3i& block, BlockValues& values) override
        {
            for (int n = 0; n < kBlockVoxels; ++n) {
                const Vec3i at = kBlockDim * block + Vec3i(n >> 6, n >> 3 & 7, n & 7);
                const Vec3d p = mLattice.origin + mLattice.voxelSize * at.cast<double>();
                values[std::size_t(n)] = float(std::clamp(mField.evaluate(p).value, -mBand, mBand));
            }
        }
        const NearMiss& mField;
        Lattice mLattice;
        double mBand;
    };
};

TEST(Region, HasNoBandWhereTheFieldOnlyComesNearToZero)
{
    Interrupter progress;
    SampleSettings settings;
    settings.lattice.voxelSize = NearMiss::kVoxel;
    const LevelSet whole = sampleField(NearMiss(), settings, &progress);
    for (const double low : {0.9, 1.9}) { // with the ball's surface, and without
        const Box3d box(Vec3d(low, -0.2, -0.2), Vec3d(2.1, 0.2, 0.2));
        settings.region = box;
        const LevelSet part = sampleField(NearMiss(), settings, &progress);
        EXPECT_EQ(differences(part, whole, voxelsIn(box, settings.lattice)), 0u);
    }
}

TEST(Region, FarLargerThanTheDataIsTheWhole)
{
    // Its sides are ten thousand voxels long, and nothing lies along them.
    const PointCloud cloud = test::randomScan("sphere(1)", 5000);
    test::Uncleaned settings = voxelSize(0.05);
    const auto bytesOf = [&] {
        Interrupter progress;
        return test::treeBytes(
            reconstruct(PointCloud(cloud), settings, &progress).levelSet().grid());
    };
    const std::string whole = bytesOf();
    const auto start = std::chrono::steady_clock::now();
    settings.region = lengths({Vec3d::Constant(-250), Vec3d(250, 250, 250)});
    EXPECT_TRUE(bytesOf() == whole);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    EXPECT_LT(taken.count(), 20) << "before it was minutes, and all of the memory";
}

TEST(Region, RefusesWhatIsNone)
{
    Interrupter progress;
    const PointCloud cloud = test::randomScan("sphere(1)", 2000);
    test::Uncleaned settings = voxelSize(0.1);
    settings.region = lengths({Vec3d(1, 0, 0), Vec3d(0, 1, 1)});
    EXPECT_THROW(reconstruct(PointCloud(cloud), settings, &progress), UsageError);
    SampleSettings sampling;
    sampling.region = Box3d(Vec3d(0, 0, 0), Vec3d(0, 0, std::nan("")));
    EXPECT_THROW(sampleField(*makeSolidField(parseSolid("sphere(1)")), sampling, &progress),
                 UsageError);
}

} // namespace
} // namespace mpuvdb
