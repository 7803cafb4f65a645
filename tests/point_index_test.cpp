// The index of points and its cells: their queries are those of a search through all of them.
#include "field_fixture.h"
#include "spatial/key_order.h"
#include "spatial/point_cells.h"
#include "spatial/position_order.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <numeric>
#include <random>

namespace mpuvdb
{
namespace
{

using test::Random;
using Positions = std::vector<Vec3f>;

/// Clouds that are hard to sort and to search: none, one, copies, ties, lines, far away, clumps.
std::vector<Positions> clouds(Random& random)
{
    Positions even, copies, ties, line, far, clump;
    for (int i = 0; i < 3000; ++i) even.push_back(random.inCube(1).cast<float>());
    for (int i = 0; i < 2000; ++i) copies.push_back(even[random.below(60)]);
    for (int i = 0; i < 1000; ++i)
        ties.emplace_back(float(random.below(8)), float(random.below(8)), float(random.below(8)));
    for (int i = 0; i < 500; ++i) line.emplace_back(0.f, float(random.uniform(-1, 1)), 0.f);
    for (int i = 0; i < 1000; ++i)
        far.push_back((1e30 * random.inCube(1) + Vec3d(3e30, 0, 0)).cast<float>());
    for (int i = 0; i < 2000; ++i) clump.push_back((1e-6 * random.inBall(1)).cast<float>());
    clump.emplace_back(1e3f, 0.f, 0.f);
    return {{},   {Vec3f(1, 2, 3)}, Positions(100, Vec3f(-1, 0, 2)), even, copies, ties, line, far,
            clump};
}

/// Calls test(positions, random) for each cloud; failures say the seed and the cloud.
template <class Test>
void forEachCloud(Test test)
{
    const std::uint64_t seed = std::random_device()();
    Random random(seed);
    int cloud = 0;
    for (const Positions& positions : clouds(random)) {
        SCOPED_TRACE("seed " + std::to_string(seed) + ", cloud " + std::to_string(cloud++));
        test(positions, random);
    }
}

PointIndex indexOf(const Positions& positions)
{
    Interrupter progress;
    return PointIndex(positions, progress);
}

Positions inOrder(const PointIndex& index)
{
    Positions positions;
    for (std::size_t n = 0; n < index.size(); ++n) positions.push_back(index[n]);
    return positions;
}

double squaredDistance(const Vec3f& a, const Vec3f& b)
{
    return (a.cast<double>() - b.cast<double>()).squaredNorm();
}

TEST(KeyOrder, IsThatOfAStableSort)
{
    const std::uint64_t seed = std::random_device()();
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    Interrupter progress;
    // Keys with runs that are equal in the upper bits, from none to all, across the borders of
    // chunks; and short ones.
    for (const auto& [upper, bits] : {std::pair{1u << 30, 63}, {300u, 63}, {1u, 63}, {1u, 11}}) {
        std::vector<std::uint64_t> keys(50000);
        std::vector<int> second(keys.size());
        for (std::uint64_t& key : keys)
            key = std::uint64_t(random.below(upper)) << 33 | std::uint64_t(random.below(2048));
        for (int& value : second) value = int(random.below(2));
        const auto keyOf = [&](std::uint32_t i) { return keys[i]; };
        const auto isBefore = [&](std::uint32_t i, std::uint32_t j) {
            return second[i] < second[j];
        };
        std::vector<std::uint32_t> wanted(keys.size());
        std::iota(wanted.begin(), wanted.end(), 0u);
        std::stable_sort(wanted.begin(), wanted.end(), [&](std::uint32_t i, std::uint32_t j) {
            return keys[i] != keys[j] ? keys[i] < keys[j] : isBefore(i, j);
        });
        EXPECT_EQ(orderByKeys(keys.size(), bits, keyOf, isBefore, progress), wanted);
    }
}

// Large arrays are taken by shorter digits; equal keys keep their order there, too.
TEST(RadixSort, OfLargeArrays)
{
    constexpr std::size_t kCount = (std::size_t(1) << 25) + 12345; // of 8 bytes
    std::vector<std::uint64_t> items(kCount);
    for (std::size_t n = 0; n < kCount; ++n) // keys of 20 bits, each 32 times, and numbers
        items[n] = (n * 0x9e3779b97f4a7c15u >> 44) << 32 | n;
    Interrupter progress;
    radixSort(
        items, 32, 52, [](std::uint64_t item) { return item; }, progress);
    EXPECT_TRUE(std::is_sorted(items.begin(), items.end()));
    std::vector<bool> isThere(kCount);
    for (const std::uint64_t item : items) isThere[item & 0xffffffff] = true;
    EXPECT_EQ(std::count(isThere.begin(), isThere.end(), true), std::ptrdiff_t(kCount));
}

TEST(PointIndex, HoldsEachPointOnceAndCopiesTogetherWhateverTheOrderAndTheThreads)
{
    forEachCloud([](const Positions& positions, Random& random) {
        const PointIndex index = indexOf(positions);
        std::vector<std::uint32_t> order = index.order();
        for (std::size_t n = 0; n < order.size(); ++n) {
            EXPECT_EQ(index[n], positions[order[n]]);
            EXPECT_TRUE(!index.isCopy(n) || order[n - 1] < order[n]);
        }
        std::sort(order.begin(), order.end());
        for (std::size_t n = 0; n < order.size(); ++n) EXPECT_EQ(order[n], n);
        Positions runs = inOrder(index), distinct = positions;
        runs.erase(std::unique(runs.begin(), runs.end()), runs.end());
        std::sort(distinct.begin(), distinct.end(), positionBefore);
        distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
        EXPECT_EQ(runs.size(), distinct.size());
        Positions shuffled = positions;
        for (std::size_t n = shuffled.size(); n > 1; --n)
            std::swap(shuffled[n - 1], shuffled[random.below(n)]);
        const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
        EXPECT_EQ(indexOf(positions).order(), index.order());
        EXPECT_EQ(inOrder(indexOf(shuffled)), inOrder(index));
    });
}

TEST(PointIndex, NearestAreThoseOfASearchThroughAll)
{
    forEachCloud([](const Positions& positions, Random& random) {
        const PointIndex index = indexOf(positions);
        for (int trial = 0; trial < 30; ++trial) {
            const Vec3f center = positions.empty() || trial % 3 == 0
                                     ? Vec3f(random.inCube(2).cast<float>())
                                     : positions[random.below(positions.size())];
            Positions all = positions;
            std::sort(all.begin(), all.end(), positionBefore);
            all.erase(std::unique(all.begin(), all.end()), all.end());
            std::stable_sort(all.begin(), all.end(), [&](const Vec3f& a, const Vec3f& b) {
                return squaredDistance(a, center) < squaredDistance(b, center);
            });
            const std::size_t count = random.below(60);
            std::vector<PointIndex::Near> found;
            index.nearest(center, count, found);
            ASSERT_EQ(found.size(), std::min(count, all.size()));
            for (std::size_t k = 0; k < found.size(); ++k) {
                EXPECT_EQ(index[found[k].place], all[k]);
                EXPECT_EQ(found[k].squared, squaredDistance(all[k], center));
                EXPECT_FALSE(index.isCopy(found[k].place));
            }
        }
    });
}

TEST(PointIndex, BallsHoldWhatASearchThroughAllFinds)
{
    forEachCloud([](const Positions& positions, Random& random) {
        const PointIndex index = indexOf(positions);
        const double size = index.size() ? double(index.bounds().sizes().maxCoeff()) : 1;
        for (int trial = 0; trial < 30 && index.size() > 0; ++trial) {
            const Vec3f center = positions[random.below(positions.size())];
            const double radius = random.uniform(0, 0.3) * size;
            std::vector<std::uint32_t> found, all;
            const auto add = [&](std::uint32_t n, std::vector<std::uint32_t>& places) {
                if (squaredDistance(index[n], center) <= radius * radius) places.push_back(n);
            };
            index.forEachRunNear(center, radius, [&](std::uint32_t begin, std::uint32_t end) {
                for (std::uint32_t n = begin; n < end; ++n) add(n, found);
            });
            for (std::uint32_t n = 0; n < index.size(); ++n) add(n, all);
            EXPECT_EQ(found, all);
        }
    });
}

TEST(PointIndex, PartsOfItAreInItsOrder)
{
    forEachCloud([](const Positions& positions, Random& random) {
        const PointIndex index = indexOf(positions);
        std::vector<std::uint8_t> keep;
        std::vector<std::uint32_t> dropped, staying;
        Positions left;
        for (std::uint32_t i = 0; i < positions.size(); ++i) {
            keep.push_back(std::uint8_t(random.below(3) > 0));
            (keep[i] ? staying : dropped).push_back(i);
            if (keep[i]) left.push_back(positions[i]);
        }
        Interrupter progress;
        const auto kept = index.kept(keep, progress), moved = index.without(dropped, progress);
        ASSERT_EQ(kept->size(), left.size());
        ASSERT_EQ(moved->size(), left.size());
        for (std::size_t n = 0; n < left.size(); ++n) {
            EXPECT_EQ((*kept)[n], positions[kept->order()[n]]);
            EXPECT_EQ((*moved)[n], left[moved->order()[n]]);
            EXPECT_EQ(staying[moved->order()[n]], kept->order()[n]);
        }
        std::vector<std::uint32_t> placeOf;
        const auto distinct = index.distinct(placeOf, progress);
        for (std::size_t n = 0; n < distinct->size(); ++n) {
            EXPECT_FALSE(distinct->isCopy(n));
            EXPECT_EQ(distinct->order()[n], n);
        }
        for (std::size_t i = 0; i < positions.size(); ++i)
            EXPECT_EQ((*distinct)[placeOf[i]], positions[i]);
    });
}

TEST(PointCells, HoldEachPointOnceAndKnowThoseAround)
{
    forEachCloud([](const Positions& positions, Random& random) {
        const PointIndex index = indexOf(positions);
        const double size = index.size() ? double(index.bounds().sizes().maxCoeff()) : 1;
        Interrupter progress;
        const PointCells cells(index, random.uniform(0.02, 0.3) * size, progress);
        std::vector<char> seen(index.size(), 0);
        for (std::uint32_t c = 0; c < cells.cells().size(); ++c) {
            const PointCells::Cell& cell = cells.cells()[c];
            std::uint32_t points = 0;
            cells.forEachPoint(cell, [&](std::uint32_t n) {
                const Vec3d apart = index[n].cast<double>() - cells.center(cell);
                EXPECT_LE(apart.cwiseAbs().maxCoeff(), 0.50001 * cells.side());
                ++seen[n];
                ++points;
            });
            EXPECT_EQ(points, cell.size());
            const std::vector<std::uint32_t> sorted = cells.byPosition(cell);
            EXPECT_EQ(index[sorted.front()], index[cells.firstOf(cell)]);
            std::vector<std::uint32_t> around, all, after, allAfter;
            cells.forEachAround(cell, [&](std::uint32_t other) { around.push_back(other); });
            cells.forFacesAfter(cell, [&](std::uint32_t other) { after.push_back(other); });
            for (std::uint32_t other = 0; other < cells.cells().size(); ++other) {
                const Vec3i apart = cells.cells()[other].at - cell.at;
                if (apart.cwiseAbs().maxCoeff() == 1) all.push_back(other);
                if (apart.minCoeff() == 0 && apart.sum() == 1) allAfter.push_back(other);
            }
            std::sort(around.begin(), around.end());
            std::sort(after.begin(), after.end());
            EXPECT_EQ(around, all);
            EXPECT_EQ(after, allAfter);
        }
        EXPECT_TRUE(std::all_of(seen.begin(), seen.end(), [](char n) { return n == 1; }));
    });
}

TEST(PointIndex, StopsWhereItIsAskedTo)
{
    Interrupter progress;
    progress.stop();
    const Positions positions(100, Vec3f::Zero());
    EXPECT_THROW(PointIndex(positions, progress), Interrupted);
}

} // namespace
} // namespace mpuvdb
