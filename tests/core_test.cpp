#include <mpuvdb/error.h>
#include <mpuvdb/length.h>
#include <mpuvdb/progress.h>

#include <gtest/gtest.h>

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

TEST(Progress, ReportsStagesAndStops)
{
    std::vector<std::pair<std::string, double>> seen;
    Progress progress([&](const std::string& s, double f) { seen.emplace_back(s, f); });
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

} // namespace
} // namespace mpuvdb
