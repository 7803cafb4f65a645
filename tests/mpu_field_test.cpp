// The blended field: one point at a time, block by block, and what both promise.
#include "field_fixture.h"
#include "mpu/sample/mpu_block_sampler.h"

#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/mpu_field.h>
#include <mpuvdb/shape.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

namespace mpuvdb
{
namespace
{

using test::Random;

MpuField fieldOf(PointCloud cloud, double voxelSize, double tolerance = 0)
{
    MpuSettings settings;
    settings.voxelSize = voxelSize;
    settings.tolerance = tolerance > 0 ? tolerance : 0.1 * voxelSize;
    Interrupter progress;
    return MpuField(std::move(cloud), settings, &progress);
}

/// A solid, its longest side, its area: for points about a voxel apart.
struct Model {
    const char* name;
    double extent, area;
    double voxelSize(double voxels) const { return extent / voxels; }
    PointCloud cloud(double voxels) const
    {
        return test::randomScan(name, area / (voxelSize(voxels) * voxelSize(voxels)));
    }
};

const Model kSphere{"sphere(1)", 2, 4 * M_PI};
const Model kTorus{"torus(1, 0.4)", 2.8, 4 * M_PI* M_PI * 0.4};
/// Turned, so that no voxel is exactly between two faces.
const Model kBox{"rotate(box(2, 1.5, 1), 1, 2, 3, 25)", 2.4, 13};

struct Sampled {
    Vec3i block;
    BlockValues values;
};

/// Blocks of the seeds and around them, sampled in this order.
std::vector<Sampled> sampleAll(const MpuField& field, const Lattice& lattice, double band,
                               std::size_t everyNth)
{
    const std::vector<Vec3i> seeds = field.seedBlocks(lattice);
    const auto sampler = field.sampler(lattice, band);
    std::vector<Sampled> result;
    for (std::size_t n = 0; n < seeds.size(); n += everyNth) {
        for (const Vec3i& beside : {Vec3i(0, 0, 0), Vec3i(1, 0, 0), Vec3i(0, 0, -1)}) {
            result.push_back({seeds[n] + beside, {}});
            sampler->evaluate(result.back().block, result.back().values);
        }
    }
    return result;
}

Vec3d voxelAt(const Lattice& lattice, const Vec3i& block, int i)
{
    const Vec3i voxel = kBlockDim * block + Vec3i(i >> 6, i >> 3 & 7, i & 7);
    return lattice.origin + lattice.voxelSize * voxel.cast<double>();
}

// --- The partition of unity

TEST(MpuField, IsThePlaneWhereThePointsArePlanar)
{
    // The middle of a box's faces: weights that did not sum to one would show.
    const Eigen::AngleAxisd turn(25 * M_PI / 180, Vec3d(1, 2, 3).normalized());
    const Vec3d half(1, 0.75, 0.5);
    const double h = kBox.voxelSize(64);
    // Fits to a ten-thousandth of a voxel: none that holds points of these has an edge in its ball.
    // Cells off the surface take over fits of larger cells, which are not held to the tolerance and
    // may have an edge in their balls: farther off single values may be out by a part of a voxel.
    const MpuField field = fieldOf(kBox.cloud(64), h, 1e-4 * h);
    Random random(1);
    double sum = 0;
    const int count = 3000;
    for (int i = 0; i < count; ++i) {
        const int axis = i % 3;
        const double side = i % 2 ? 1 : -1, distance = random.uniform(-3 * h, 3 * h);
        Vec3d p = 0.5 * random.inCube(1).cwiseProduct(half);
        p[axis] = side * (half[axis] + distance);
        const FieldSample sample = field.evaluate(turn * p);
        const double tolerance = std::abs(distance) < h ? 5e-3 : 0.5; // voxels
        EXPECT_NEAR(sample.value, distance, tolerance * h) << "seed 1, " << p.transpose();
        EXPECT_LT((sample.gradient - turn * (side * Vec3d::Unit(axis))).norm(), tolerance);
        sum += std::pow((sample.value - distance) / h, 2);
    }
    EXPECT_LT(std::sqrt(sum / count), 0.03); // voxels
}

// --- Blocks

/// Largest difference between blocks and points, in voxels, where neither is clamped.
double blockError(const Model& model)
{
    const double h = model.voxelSize(48), band = 3 * h;
    const MpuField field = fieldOf(model.cloud(48), h);
    const Lattice lattice{Vec3d(0.3, -0.2, 0.1) * h, h};
    double worst = 0;
    std::size_t inBand = 0;
    for (const Sampled& s : sampleAll(field, lattice, band, 5)) {
        for (int i = 0; i < kBlockVoxels; ++i) {
            const double expected = field.evaluate(voxelAt(lattice, s.block, i)).value;
            const double clamped = std::clamp(expected, -band, band);
            worst = std::max(worst, std::abs(double(s.values[std::size_t(i)]) - clamped) / h);
            inBand += std::abs(expected) < band;
        }
    }
    EXPECT_GT(inBand, 5000u);
    return worst;
}

TEST(MpuBlockSampler, GivesTheValuesOfThePoints)
{
    // Coefficients and sums in floats, over blocks of 8 voxels: some hundred roundings of 6e-8.
    for (const Model& model : {kSphere, kTorus, kBox})
        EXPECT_LT(blockError(model), 1e-4) << model.name;
}

TEST(MpuBlockSampler, AgreesInSignWithThePointsWhereDataAreMissing)
{
    ScanSettings scan;
    scan.points = 8000;
    scan.pattern = ScanSettings::Pattern::Random;
    scan.holes = 1;
    scan.holeRadius = 0.15;
    const double h = 2.0 / 48, band = 3 * h;
    const MpuField field = fieldOf(test::scanOf("sphere(1)", scan), h);
    const Lattice lattice{Vec3d::Zero(), h};
    for (const Sampled& s : sampleAll(field, lattice, band, 7)) {
        for (int i = 0; i < kBlockVoxels; ++i) {
            const double value = s.values[std::size_t(i)];
            const double expected = field.evaluate(voxelAt(lattice, s.block, i)).value;
            ASSERT_TRUE(std::isfinite(value));
            ASSERT_LE(std::abs(value), band * (1 + 1e-6));
            if (std::abs(expected) > 1e-3 * h) {
                ASSERT_EQ(value < 0, expected < 0);
            }
        }
    }
}

TEST(MpuBlockSampler, LeavesOutOnlyWhatIsBeyondTheBand)
{
    // With a wider band more is summed. What is in the narrow one has the same bits.
    ScanSettings scan;
    scan.points = 8000;
    scan.holes = 1;
    scan.holeRadius = 0.15;
    for (const PointCloud& cloud :
         {test::scanOf("sphere(1)", scan), kTorus.cloud(48), kBox.cloud(48)}) {
        const double h = 2.0 / 48;
        const MpuField field = fieldOf(cloud, h);
        const Lattice lattice{Vec3d(0.3, -0.2, 0.1) * h, h};
        const std::vector<Sampled> narrow = sampleAll(field, lattice, 1.5 * h, 2),
                                   wide = sampleAll(field, lattice, 5 * h, 2);
        const float limit = 1.5f * float(h);
        std::size_t inside = 0, beyond = 0;
        for (std::size_t n = 0; n < wide.size(); ++n) {
            for (std::size_t i = 0; i < std::size_t(kBlockVoxels); ++i) {
                const float value = wide[n].values[i];
                ASSERT_EQ(narrow[n].values[i], std::clamp(value, -limit, limit));
                ++(std::abs(value) < limit ? inside : beyond);
            }
        }
        EXPECT_GT(inside, 10000u);
        EXPECT_GT(beyond, 10000u);
    }
}

TEST(MpuBlockSampler, ABlockDoesNotDependOnTheBlocksBefore)
{
    ScanSettings scan;
    scan.points = 8000;
    scan.holes = 1;
    scan.holeRadius = 0.15;
    for (const PointCloud& cloud : {test::scanOf("sphere(1)", scan), kBox.cloud(48)}) {
        const double h = 2.0 / 48;
        const MpuField field = fieldOf(cloud, h);
        const Lattice lattice{Vec3d::Zero(), h};
        const std::vector<Sampled> forward = sampleAll(field, lattice, 3 * h, 3);
        const auto backward = field.sampler(lattice, 3 * h);
        BlockValues values;
        for (std::size_t n = forward.size(); n-- > 0;) {
            backward->evaluate(forward[n].block, values);
            ASSERT_EQ(values, forward[n].values);
            if (n % 16) continue;
            field.sampler(lattice, 3 * h)->evaluate(forward[n].block, values);
            ASSERT_EQ(values, forward[n].values);
        }
    }
}

TEST(MpuField, SeedBlocksHoldAllPointsOnceInOrder)
{
    const PointCloud cloud = kTorus.cloud(32);
    const double h = kTorus.voxelSize(32);
    const Lattice lattice{Vec3d(0.1, 0.2, 0.3), h};
    const MpuField field = fieldOf(cloud, h);
    const std::vector<Vec3i> seeds = field.seedBlocks(lattice);
    const auto before = [](const Vec3i& a, const Vec3i& b) {
        return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
    };
    for (std::size_t n = 1; n < seeds.size(); ++n) ASSERT_TRUE(before(seeds[n - 1], seeds[n]));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d at = (cloud.world(i) - lattice.origin) / h;
        const Vec3i block =
            (at.array().round() / double(kBlockDim)).floor().cast<int>(); // of its nearest voxel
        ASSERT_TRUE(std::binary_search(seeds.begin(), seeds.end(), block, before));
    }
}

// --- Points

TEST(MpuField, GradientIsThatOfTheValue)
{
    // The blend's gradient leaves out the weights' derivatives, which fits within a tenth of a
    // voxel of each other can make a few per cent.
    for (const Model& model : {kSphere, kTorus}) {
        const double h = model.voxelSize(64), step = 0.02 * h;
        const PointCloud cloud = model.cloud(64);
        const MpuField field = fieldOf(cloud, h);
        Random random(2);
        for (int i = 0; i < 500; ++i) {
            const Vec3d p = cloud.world(random.below(cloud.size())) + random.inBall(h);
            const FieldSample sample = field.evaluate(p);
            Vec3d difference;
            for (int k = 0; k < 3; ++k)
                difference[k] = (field.evaluate(p + step * Vec3d::Unit(k)).value -
                                 field.evaluate(p - step * Vec3d::Unit(k)).value) /
                                (2 * step);
            EXPECT_LT((sample.gradient - difference).norm(), 0.06)
                << model.name << " seed 2 at " << i;
            EXPECT_NEAR(sample.gradient.norm(), 1, 0.01) << model.name;
        }
    }
}

/// Places near each other and far apart, in the root cube and beyond it, and some of them twice.
std::vector<Vec3d> wander(const PointCloud& cloud, double voxelSize)
{
    Random random(4);
    std::vector<Vec3d> places;
    for (int start = 0; start < 150; ++start) {
        Vec3d p = cloud.world(random.below(cloud.size()));
        for (int step = 0; step < 20; ++step) {
            p += random.inBall(random.uniform(0, 2) * voxelSize);
            places.push_back(p);
        }
        places.push_back(random.inCube(1.5));
        places.push_back(random.uniform(1, 100) * random.direction());
        places.push_back(places[random.below(places.size())]);
    }
    return places;
}

void expectEvaluatorGivesSamples(const Field& field, const std::vector<Vec3d>& places,
                                 double voxelSize)
{
    const std::unique_ptr<PointEvaluator> evaluator = field.evaluator(voxelSize);
    for (std::size_t n = 0; n < places.size(); ++n) {
        const FieldSample expected = field.evaluate(places[n]);
        const FieldSample found = evaluator->evaluate(places[n]);
        ASSERT_EQ(found.value, expected.value) << "seed 4, place " << n;
        ASSERT_EQ(found.gradient, expected.gradient) << "seed 4, place " << n;
        ASSERT_EQ(found.level, expected.level) << "seed 4, place " << n;
        ASSERT_EQ(found.supported, expected.supported) << "seed 4, place " << n;
    }
}

TEST(MpuField, EvaluatorGivesTheSamplesToTheBit)
{
    ScanSettings scan;
    scan.points = 8000;
    scan.holes = 1;
    scan.holeRadius = 0.15;
    const double h = 2.0 / 48;
    for (const PointCloud& cloud :
         {kBox.cloud(48), kTorus.cloud(96), test::scanOf("sphere(1)", scan)})
        for (const bool interpolate : {false, true}) {
            MpuSettings settings;
            settings.voxelSize = h;
            settings.tolerance = 0.1 * h;
            settings.interpolate = interpolate;
            if (interpolate) settings.alpha = kInterpolationAlpha;
            Interrupter progress;
            const MpuField field(PointCloud(cloud), settings, &progress);
            expectEvaluatorGivesSamples(field, wander(cloud, h), h);
        }
}

TEST(MpuField, OfPointsNextToNothingApartIsOneFunctionForPlacesAndBlocks)
{
    // Leaves of the deepest level there is, about a voxel of the block.
    PointCloud cloud = kSphere.cloud(32);
    for (Vec3f& p : cloud.positions) p.x() += 1;
    for (int n = 0; n < 6; ++n) {
        cloud.positions.push_back(1e-9f * float(n) * Vec3f::UnitY());
        cloud.normals.push_back(-Vec3f::UnitX());
    }
    const double h = kSphere.voxelSize(32);
    MpuSettings settings;
    settings.voxelSize = h;
    settings.tolerance = 0.1 * h;
    settings.interpolate = true;
    settings.alpha = kInterpolationAlpha;
    Interrupter progress;
    std::vector<Vec3d> places = wander(cloud, 1e-7);
    for (std::size_t n = 0; n < 6; ++n) places.push_back(cloud.world(cloud.size() - 1 - n));
    const MpuField field(std::move(cloud), settings, &progress);
    EXPECT_EQ(field.statistics().levels, Octree::kMaxLevel);
    expectEvaluatorGivesSamples(field, places, 1e-7);
    const Lattice lattice{Vec3d::Zero(), h};
    BlockValues values;
    field.sampler(lattice, 3 * h)->evaluate(Vec3i::Zero(), values);
    for (int i = 0; i < kBlockVoxels; ++i) {
        const double value = field.evaluate(voxelAt(lattice, Vec3i::Zero(), i)).value;
        EXPECT_NEAR(values[std::size_t(i)], std::clamp(value, -3 * h, 3 * h), 1e-4 * h);
    }
}

TEST(MpuField, EvaluatorsOfFieldsMadeFromItGiveTheirSamples)
{
    const double h = 2.0 / 48;
    const PointCloud cloud = kBox.cloud(48);
    const std::shared_ptr<const MpuField> field(new MpuField(fieldOf(cloud, h)));
    Eigen::Affine3d shift = Eigen::Affine3d::Identity(), turn = shift;
    shift.translate(Vec3d(0.1, 0, -0.2)).scale(1.1);
    turn.rotate(Eigen::AngleAxisd(0.3, Vec3d::UnitY()));
    const std::vector<Vec3d> places = wander(cloud, h);
    expectEvaluatorGivesSamples(*makeMovedField(field, shift), places, h);
    expectEvaluatorGivesSamples(*makeMovedField(field, turn), places, h);
    expectEvaluatorGivesSamples(*makeWarpedField(field, makeTwist({}, 0.5)), places, h);
    expectEvaluatorGivesSamples(
        *makeClippedField(field, Box3d(Vec3d(-1, -1, -1), Vec3d(0.5, 1, 0.4))), places, h);
    const Shape box(field, "box"), moved(makeMovedField(field, shift), "moved");
    for (const Shape& both : {box | moved, box & moved, box - moved})
        expectEvaluatorGivesSamples(*both.field(), places, h);
}

TEST(MpuField, SaysWhereItsValuesComeFrom)
{
    const PointCloud cloud = kSphere.cloud(64);
    const double h = kSphere.voxelSize(64);
    const MpuField field = fieldOf(cloud, h);
    Random random(3);
    for (int i = 0; i < 500; ++i) {
        const FieldSample sample = field.evaluate(cloud.world(random.below(cloud.size())));
        EXPECT_TRUE(sample.supported);
        EXPECT_GE(sample.level, 1);
        EXPECT_LE(sample.level, field.statistics().levels);
        EXPECT_LT(std::abs(sample.value), 0.1 * h);
    }
    for (int i = 0; i < 200; ++i) {
        const FieldSample sample = field.evaluate(random.inCube(1.2)); // in the root cube
        EXPECT_GE(sample.level, 0);
        EXPECT_TRUE(std::isfinite(sample.value));
        EXPECT_GT(field.evaluate(random.uniform(3, 1000) * random.direction()).value, 1);
    }
    EXPECT_TRUE(field.bounds().contains(Vec3d(0.9, 0, 0)));
    EXPECT_LT((field.bounds().sizes() - Vec3d(2, 2, 2)).norm(), 0.01);
}

TEST(MpuField, IsNotSupportedInALargeHole)
{
    PointCloud whole = kSphere.cloud(64), cloud;
    cloud.frame = whole.frame;
    for (std::size_t i = 0; i < whole.size(); ++i) {
        if ((whole.world(i) - Vec3d(0, 0, 1)).norm() < 0.7) continue;
        cloud.positions.push_back(whole.positions[i]);
        cloud.normals.push_back(whole.normals[i]);
    }
    const MpuField field = fieldOf(cloud, kSphere.voxelSize(64));
    EXPECT_FALSE(field.evaluate(Vec3d(0, 0, 1)).supported);
    EXPECT_FALSE(field.evaluate(Vec3d(0, 0.1, 0.9)).supported);
    EXPECT_TRUE(field.evaluate(Vec3d(0, 0, -1)).supported);
    EXPECT_TRUE(field.evaluate(Vec3d(1, 0, 0)).supported);
    EXPECT_LT(field.evaluate(Vec3d::Zero()).value, 0);
    EXPECT_GT(field.evaluate(Vec3d(0, 0, 2)).value, 0);
    for (const Vec3d& direction : {Vec3d(0, 0, 1), Vec3d(0, 1, 1), Vec3d(0, 0, -1)})
        EXPECT_GT(field.evaluate(100 * direction).value, 50);
}

// --- What the fit counts

TEST(MpuField, CountsWhatItFitted)
{
    const double h = kSphere.voxelSize(48);
    const MpuField field = fieldOf(kSphere.cloud(48), h);
    const MpuStatistics& s = field.statistics();
    EXPECT_EQ(s.leaves, 1 + (s.cells - 1) / 8 * 7); // eight children per split
    EXPECT_GT(s.fits, 0u);
    EXPECT_LE(s.fits, s.cells);
    EXPECT_EQ(s.sharpFits, 0u);
    EXPECT_EQ(s.overTolerance, 0u);
    EXPECT_LE(s.maxError, 0.1 * h);
    EXPECT_GT(s.maxError, 0);
    EXPECT_GT(s.bytes, s.cells * sizeof(OctreeNode));
    EXPECT_GT(fieldOf(kBox.cloud(48), h).statistics().sharpFits, 20u);
}

TEST(MpuField, ASmallerToleranceMeansSmallerErrorsAndMoreCells)
{
    std::uint64_t cells = 0;
    for (const double tolerance : {0.5, 0.05, 0.005}) { // voxels
        const double h = kTorus.voxelSize(48);
        const MpuField field = fieldOf(kTorus.cloud(96), h, tolerance * h);
        EXPECT_LE(field.statistics().maxError, tolerance * h);
        EXPECT_GT(field.statistics().cells, cells);
        cells = field.statistics().cells;
    }
}

/// Root mean square of the values at the points of the cloud's own field.
double errorOf(const PointCloud& cloud, double voxelSize, double tolerance)
{
    const MpuField field = fieldOf(cloud, voxelSize, tolerance);
    double squares = 0;
    for (const Vec3f& p : cloud.positions) {
        const double value = field.evaluate(cloud.frame + p.cast<double>()).value;
        squares += value * value;
    }
    return std::sqrt(squares / double(cloud.size()));
}

TEST(MpuField, PointsOfLowConfidenceAreBlurredNoMoreThanOthers)
{
    const double h = kTorus.voxelSize(48), tolerance = 1e-6 * h; // all cells as small as may be
    PointCloud cloud = kTorus.cloud(48);
    const double alike = errorOf(cloud, h, tolerance);
    cloud.confidence.assign(cloud.size(), 0.1f);
    cloud.confidence[0] = 1;
    EXPECT_LT(errorOf(cloud, h, tolerance), 1.2 * alike);
}

// --- Errors

TEST(MpuField, RefusesWhatItCannotFit)
{
    EXPECT_THROW(fieldOf({}, 0.1), InputError);
    PointCloud bare;
    bare.positions.assign(10, Vec3f(1, 2, 3));
    EXPECT_THROW(fieldOf(bare, 0.1), InputError);
    const PointCloud cloud = test::randomScan("sphere(1)", 200);
    Interrupter progress;
    const auto expectRefused = [&](auto change) {
        MpuSettings settings;
        settings.voxelSize = 0.1;
        settings.tolerance = 0.01;
        change(settings);
        EXPECT_THROW(MpuField(PointCloud(cloud), settings, &progress), UsageError);
    };
    const double nan = std::nan(""), infinite = std::numeric_limits<double>::infinity();
    for (const double bad : {0.0, -1.0, nan, infinite}) {
        expectRefused([&](MpuSettings& s) { s.voxelSize = bad; });
        expectRefused([&](MpuSettings& s) { s.tolerance = bad; });
    }
    for (const double bad : {0.49, 2.01, nan})
        expectRefused([&](MpuSettings& s) { s.alpha = bad; });
    for (const int bad : {-1, 5, 1001}) expectRefused([&](MpuSettings& s) { s.minPoints = bad; });
}

TEST(MpuField, AcceptsTheWholeRangeOfItsSettings)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 3000);
    Interrupter progress;
    for (const double alpha : {0.6, 2.0}) // as the header says
        for (const int minPoints : {6, 1000}) {
            MpuSettings settings;
            settings.voxelSize = 0.1;
            settings.tolerance = 0.01;
            settings.alpha = alpha;
            settings.minPoints = minPoints;
            const MpuField field(PointCloud(cloud), settings, &progress);
            EXPECT_LT(field.evaluate(Vec3d(0, 0, 0.5)).value, 0) << alpha << ' ' << minPoints;
            EXPECT_GT(field.evaluate(Vec3d(0, 0, 1.2)).value, 0) << alpha << ' ' << minPoints;
        }
}

} // namespace
} // namespace mpuvdb
