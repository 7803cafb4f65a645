#include "core/lanes.h"
#include "core/union_find.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/length.h>

#include <gtest/gtest.h>

#include <random>

namespace mpuvdb
{
namespace
{

TEST(Length, ParsesEveryUnit)
{
    EXPECT_EQ(Length::parse("0.002").resolve(7, 9), 0.002);
    EXPECT_EQ(Length::parse("1.5vx").resolve(2, 9), 3.0);
    EXPECT_DOUBLE_EQ(Length::parse("0.1%").resolve(7, 50), 0.05);
    EXPECT_EQ(Length::parse("+1e-3").resolve(1, 1), 1e-3);
    EXPECT_EQ(Length::parse("1.5vx").text(), "1.5vx");
}

TEST(Length, RefusesEverythingElse)
{
    for (const char* text : {"", "vx", "1 vx", "1mm", "nan", "inf", "1e999", "--1", "0x10", "1%%"})
        EXPECT_THROW(Length::parse(text), UsageError) << text;
}

TEST(BitsOf, GivesEachLaneItsBit)
{
    using Lanes = float __attribute__((vector_size(32)));
    for (unsigned expected = 0; expected < 256; ++expected) {
        Lanes lanes;
        for (int n = 0; n < 8; ++n) lanes[n] = expected >> n & 1u ? -1.5f : 2.5f;
        EXPECT_EQ(bitsOf(lanes < 0), expected);
    }
}

TEST(Interrupter, ReportsStagesAndStops)
{
    std::vector<std::pair<std::string, double>> seen;
    Interrupter progress([&](const std::string& s, double f) { seen.emplace_back(s, f); });
    progress.beginStage("one", 4);
    progress.advance(1);
    progress.beginStage("two");
    progress.advance();
    progress.endStage();
    const std::vector<std::pair<std::string, double>> expected{
        {"one", 0}, {"one", 0.25}, {"two", 0}, {"two", 1}};
    EXPECT_EQ(seen, expected);
    ASSERT_EQ(progress.stages().size(), 2u);
    EXPECT_EQ(progress.stages()[1].name, "two");
    EXPECT_GE(progress.stages()[0].seconds, 0);
    EXPECT_GT(progress.stages()[0].peakBytes, 0u);
    progress.stop();
    EXPECT_TRUE(progress.wasInterrupted());
    EXPECT_THROW(progress.check(), Interrupted);
    EXPECT_THROW(progress.advance(), Interrupted);
}

TEST(UnionFind, RootsAreTheLowestMembers)
{
    for (unsigned seed = 0; seed < 50; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto below = [&](std::uint32_t n) { return std::uint32_t(random() % n); };
        const std::uint32_t count = 1 + below(60);
        UnionFind sets(count);
        std::vector<std::uint32_t> expected(count);
        std::iota(expected.begin(), expected.end(), 0u);
        for (std::uint32_t joins = below(count); joins > 0; --joins) {
            const std::uint32_t a = below(count), b = below(count);
            const std::uint32_t low = std::min(expected[a], expected[b]);
            const std::uint32_t high = std::max(expected[a], expected[b]);
            EXPECT_EQ(sets.join(a, b), low != high);
            std::replace(expected.begin(), expected.end(), high, low);
            EXPECT_EQ(sets.find(b), expected[b]);
        }
        EXPECT_EQ(sets.roots(), expected);
    }
}

} // namespace
} // namespace mpuvdb
