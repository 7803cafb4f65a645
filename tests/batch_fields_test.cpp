// Functions and warps of many points at once are those of single points.
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>

#include <gtest/gtest.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

const Box3d kBounds(Vec3d::Constant(-1.2), Vec3d::Constant(1.2));
constexpr double kBand = 0.3;

double ballOf(const Vec3d& p)
{
    return p.norm() - 1;
}

FieldPtr single()
{
    return makeFunctionField(ballOf, kBounds, 1);
}

/// Counts its calls.
FieldPtr batch(int& calls)
{
    return makeFunctionField(
        [&calls](const std::vector<Vec3d>& points, std::vector<double>& values) {
            ++calls;
            values.resize(points.size());
            std::transform(points.begin(), points.end(), values.begin(), ballOf);
        },
        kBounds, 1);
}

Vec3d sheared(const Vec3d& p)
{
    return p - 0.2 * p.z() * Vec3d::UnitX();
}

Box3d shearedBox(const Box3d& box)
{
    return {box.min() - 0.3 * Vec3d::UnitX(), box.max() + 0.3 * Vec3d::UnitX()};
}

std::shared_ptr<const Warp> batchWarp()
{
    return makeWarp(
        [](const std::vector<Vec3d>& points, std::vector<Vec3d>& from) {
            from.resize(points.size());
            std::transform(points.begin(), points.end(), from.begin(), sheared);
        },
        shearedBox, 1.2);
}

/// Blocks about the surface have the same values in the band.
void expectSameBand(const Field& a, const Field& b)
{
    const Lattice lattice{Vec3d::Zero(), 0.05};
    const std::vector<Vec3i> blocks = a.seedBlocks(lattice);
    ASSERT_EQ(blocks, b.seedBlocks(lattice));
    ASSERT_GT(blocks.size(), 20u);
    const auto ofA = a.sampler(lattice, kBand), ofB = b.sampler(lattice, kBand);
    for (const Vec3i& block : blocks) {
        BlockValues valuesA, valuesB;
        ofA->evaluate(block, valuesA);
        ofB->evaluate(block, valuesB);
        for (std::size_t i = 0; i < valuesA.size(); ++i) {
            if (std::abs(valuesA[i]) < 0.99 * kBand)
                ASSERT_EQ(valuesA[i], valuesB[i]);
            else
                ASSERT_GE(valuesA[i] * valuesB[i], 0.97 * kBand * kBand);
        }
    }
}

TEST(BatchField, IsTheFieldOfSinglePoints)
{
    int calls = 0;
    expectSameBand(*single(), *batch(calls));
}

TEST(BatchField, TakesABlockInOneCall)
{
    int calls = 0;
    const FieldPtr fields[] = {batch(calls), makeClippedField(batch(calls), kBounds),
                               makeWarpedField(batch(calls), batchWarp())};
    for (const FieldPtr& field : fields) {
        const auto sampler = field->sampler({Vec3d::Zero(), 0.05}, kBand);
        calls = 0;
        BlockValues values;
        sampler->evaluate(Vec3i(2, 0, 0), values);
        EXPECT_EQ(calls, 1);
    }
}

TEST(BatchField, FindsItsSeedsInFewCalls)
{
    int calls = 0;
    const std::size_t seeds = batch(calls)->seedBlocks({Vec3d::Zero(), 0.01}).size();
    ASSERT_GT(seeds, 2000u);
    EXPECT_LT(calls, int(seeds / 50)) << "each call is to test hundreds of cubes";
}

TEST(BatchField, WantsAValueForEachPoint)
{
    const auto none = [](const std::vector<Vec3d>&, std::vector<double>& values) {
        values.clear();
    };
    EXPECT_THROW(makeFunctionField(none, kBounds, 1)->evaluate(Vec3d::Zero()), InputError);
    const auto nowhere = [](const std::vector<Vec3d>&, std::vector<Vec3d>& from) { from.clear(); };
    EXPECT_THROW(makeWarp(nowhere, shearedBox, 1.2)->inverse(Vec3d::Zero()), InputError);
}

TEST(BatchWarp, IsTheWarpOfSinglePoints)
{
    const auto warp = makeWarp(sheared, shearedBox, 1.2);
    expectSameBand(*makeWarpedField(single(), warp), *makeWarpedField(single(), batchWarp()));
    int calls = 0;
    expectSameBand(*makeWarpedField(single(), warp), *makeWarpedField(batch(calls), batchWarp()));
}

} // namespace
} // namespace mpuvdb
