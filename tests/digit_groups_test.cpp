// Thousands are read right where their separators can be nothing else, and refused where they may
// be.
#include "io_fixture.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb::test
{
namespace
{

/// @a value with @a mark between groups of three digits.
std::string grouped(long value, const std::string& mark)
{
    std::string digits = std::to_string(std::abs(value));
    for (int at = int(digits.size()) - 3; at > 0; at -= 3) digits.insert(std::size_t(at), mark);
    return (value < 0 ? "-" : "") + digits;
}

/// Points of a ball in whole numbers, @a step apart from the next in their order.
std::vector<std::array<long, 3>> wholeBall(double radius, double middle, int step = 67)
{
    std::vector<std::array<long, 3>> points;
    for (int n = 0; n < 300; ++n) {
        const int i = n * step % 300;
        const double z = 1 - (2 * i + 1) / 300.0, s = std::sqrt(1 - z * z), turn = 2.399963 * i;
        points.push_back({std::lround(middle + radius * z),
                          std::lround(middle + radius * s * std::cos(turn)),
                          std::lround(middle + radius * s * std::sin(turn))});
    }
    return points;
}

using WholePoints = std::vector<std::array<long, 3>>;

std::string rows(const WholePoints& points, const std::string& separator, const std::string& mark,
                 const std::string& behind = "")
{
    std::string text;
    for (const auto& p : points)
        text += concat(grouped(p[0], mark), separator, grouped(p[1], mark), separator,
                       grouped(p[2], mark), behind, "\n");
    return text;
}

class DigitGroups : public IoTest
{
protected:
    void expectRead(const std::string& text, const WholePoints& points, const std::string& note,
                    const Vec3d& more = Vec3d::Zero(), const std::string& name = "a.csv")
    {
        SCOPED_TRACE(text.substr(0, 60));
        const PointInput input = read(name, text);
        ASSERT_EQ(input.cloud.size(), points.size());
        for (std::size_t i = 0; i < points.size(); ++i)
            for (std::size_t a = 0; a < 3; ++a)
                EXPECT_NEAR(input.cloud.world(i)[int(a)] - double(points[i][a]), more[int(a)],
                            1e-3);
        EXPECT_EQ(!input.notes.empty(), !note.empty());
        if (!note.empty() && !input.notes.empty()) {
            EXPECT_NE(input.notes[0].find(note), std::string::npos) << input.notes[0];
        }
    }
    void expectRefused(const std::string& text)
    {
        SCOPED_TRACE(text.substr(0, 60));
        const std::string message = error("a.csv", text);
        EXPECT_NE(message.find("thousands"), std::string::npos) << message;
        EXPECT_NE(message.find("Export"), std::string::npos) << message;
    }
    /// The first point of what is read as it always was.
    void expectFirst(const std::string& text, const Vec3d& first)
    {
        SCOPED_TRACE(text.substr(0, 60));
        const PointInput input = read("a.csv", text);
        EXPECT_LT((input.cloud.world(0) - first).norm(), 1e-5);
        EXPECT_TRUE(input.notes.empty()) << input.notes[0];
    }
};

TEST_F(DigitGroups, OfDotsAreTakenOut)
{
    const WholePoints points = wholeBall(900, 1000), far = wholeBall(5e5, 4e6),
                      both = wholeBall(30000, 0);
    for (const char* separator : {";", "\t", " ", "; "}) {
        expectRead(rows(points, separator, "."), points, "dots group");
        expectRead(rows(far, separator, "."), far, "dots group"); // 4.123.456
        expectRead(rows(both, separator, "."), both, "dots group");
    }
    expectRead("\xef\xbb\xbfRechtswert;Hochwert;H\xc3\xb6he\r\n" + rows(points, ";", ".", "\r"),
               points, "dots group");
    std::string quoted = "\"x\";\"y\";\"z\"\n";
    for (const auto& p : points)
        quoted += concat("\"", grouped(p[0], "."), "\";\"", grouped(p[1], "."), "\";\"",
                         grouped(p[2], "."), "\"\n");
    expectRead(quoted, points, "dots group");
    expectRead("x;y;z;day;note\n" + rows(points, ";", ".", ";12.05.2024;floor 3"), points,
               "dots group");
    const PointInput colored = read("c.txt", rows(points, ";", ".", ";255;0;10"));
    ASSERT_EQ(colored.cloud.colors.size(), points.size());
    EXPECT_EQ(colored.cloud.colors[5], (PointCloud::Rgb{255, 0, 10}));
    // Beside commas, which separate or are decimal.
    expectRead(rows(both, ",", "."), both, "dots group");
    expectRead(rows(far, ",25;", ".", ",25"), far, "dots group", Vec3d(0.25, 0.25, 0.25));
    expectRead("1.908,5;922,25;2.900,5\n", {{1908, 922, 2900}}, "dots group",
               Vec3d(0.5, 0.25, 0.5));
    for (const char* separator : {"; ", ";", "\t", " "})
        expectRead(rows(points, concat(".25", separator), ",", ".25"), points, "commas group",
                   Vec3d(0.25, 0.25, 0.25));
    // Sorted, so that the first thousand rows have dots only, or none.
    WholePoints sorted;
    for (int i = 0; i < 40; ++i)
        for (const auto& p : wholeBall(30, 3000 - 70 * i)) sorted.push_back(p);
    expectRead(rows(sorted, ";", "."), sorted, "dots group");
    std::reverse(sorted.begin(), sorted.end());
    expectRead(rows(sorted, ";", "."), sorted, "dots group");
}

TEST_F(DigitGroups, OfBlanksAreTakenOutWithinColumns)
{
    const WholePoints points = wholeBall(900, 1000), far = wholeBall(5e5, 4e6),
                      large = wholeBall(900, 2000);
    for (const char* separator : {";", "\t", "; ", " ; "}) {
        expectRead(rows(points, separator, " "), points, "blanks group");
        expectRead(rows(far, separator, " "), far, "blanks group");
        expectRead(rows(large, separator, " "), large, "blanks group"); // all with as many groups
    }
    expectRead("Est;Nord;Altitude\n" + rows(points, ";", " "), points, "blanks group");
    expectRead("x\ty\tz\troom\n" + rows(points, "\t", " ", "\tno 7"), points, "blanks group");
    // With decimal commas, as in France.
    std::string text;
    for (const auto& p : points)
        text += concat(grouped(p[0], " "), ",25;", grouped(p[1], " "), ",125;", grouped(p[2], " "),
                       "\n");
    expectRead(text, points, "blanks group", Vec3d(0.25, 0.125, 0));
    // A column below 1000 and no number like 1 034.
    expectRead("1 908,5;1 922,25;900,5\n", {{1908, 1922, 900}}, "blanks group",
               Vec3d(0.5, 0.25, 0.5));
}

// Apostrophes, and blanks that do not break a line, separate nothing else.
TEST_F(DigitGroups, OfOtherMarksAreTakenOut)
{
    const WholePoints points = wholeBall(900, 1000), far = wholeBall(5e5, -4e6);
    for (const char* mark :
         {"'", "\xe2\x80\x99", "\xc2\xa0", "\xe2\x80\xaf", "\xe2\x80\x89", "\xa0"})
        for (const char* separator : {";", " ", ",", "\t"}) {
            expectRead(rows(points, separator, mark), points, "");
            expectRead("x y z\n" + rows(far, separator, mark), far, "");
        }
    std::string text;
    for (const auto& p : points)
        text +=
            concat(grouped(p[0], "'"), ".25 ", grouped(p[1], "'"), ".5 ", grouped(p[2], "'"), "\n");
    expectRead(text, points, "", Vec3d(0.25, 0.5, 0), "a.xyz");
    EXPECT_NE(error("b.xyz", "1'08 2 3\n1 2 3\n").find("line 1"), std::string::npos);
}

TEST_F(DigitGroups, ThatMayBeSomethingElseAreRefused)
{
    WholePoints few = wholeBall(900, 1000);
    few.resize(25);
    expectRefused(rows(few, ";", "."));
    expectRefused("1 908;1 922;2 900\n1 964;1 982;2 899\n");
    expectRefused("1 908\t1 922\t2 900\n");
    // Blanks that both group digits and separate numbers.
    const WholePoints large = wholeBall(900, 2000), near = wholeBall(90, 5500);
    for (const char* decimals : {"", ",25", ".25"})
        expectRefused(rows(large, std::string(decimals) + " ", " ", decimals));
    for (const char* decimals : {",25", ".25"})
        expectRefused(rows(near, std::string(decimals) + " ", " ", decimals));
    // Numbers that have decimal points after all.
    const WholePoints points = wholeBall(900, 1000);
    std::string late;
    for (int i = 0; i < 20; ++i) late += rows(points, ";", ".");
    expectRefused(late + "1.5;2.25;900\n");
    expectRefused(late + "1.5;2.25;900\n" + late);
}

TEST_F(DigitGroups, DecimalPointsAndBlanksStayWhatTheyAre)
{
    const auto decimals = [](const char* format, const char* separator, double scale, double from,
                             const std::string& behind) {
        std::string text;
        for (const auto& p : wholeBall(scale, from)) {
            char row[200];
            std::snprintf(row, sizeof row, format, 1e-3 * double(p[0]), separator,
                          1e-3 * double(p[1]), separator, 1e-3 * double(p[2]));
            text += concat(row, behind, "\n");
        }
        return text;
    };
    const std::string fixed = "%.3f%s%.3f%s%.3f", shortest = "%g%s%g%s%g";
    const auto first = [](double scale, double from) -> Vec3d {
        const auto p = wholeBall(scale, from)[0];
        return 1e-3 * Vec3d(double(p[0]), double(p[1]), double(p[2]));
    };
    for (const char* separator : {";", " ", "\t", ","})
        for (const std::string& format : {fixed, shortest})
            for (const char* behind : {"", " 255 0 10"}) {
                expectFirst(decimals(format.c_str(), separator, 900, 3000, behind),
                            first(900, 3000));
                expectFirst(decimals(format.c_str(), separator, 90000, 500000, behind),
                            first(90000, 500000));
                expectFirst(decimals(format.c_str(), separator, 5000, 0, behind), first(5000, 0));
            }
    // Points that were not seen, and few numbers.
    expectFirst(decimals(fixed.c_str(), ";", 900, 3000, "") + "0;0;0\n0;0;0\n", first(900, 3000));
    expectFirst("1.125 2 3\n4 5.250 6\n", Vec3d(1.125, 2, 3));
    expectFirst("1.125;2;3.125\n2.375;5;6.875\n1;1.375;2\n", Vec3d(1.125, 2, 3.125));
    expectFirst("100 200 300\n150 255 100\n", Vec3d(100, 200, 300));
    expectFirst("1;2;3 10 20 30\n4;5;6 100 255 128\n", Vec3d(1, 2, 3));
    expectFirst("1.5 2.5;3.5 0;0 1\n4 5;6 0;0 1\n", Vec3d(1.5, 2.5, 3.5));
    expectFirst("x;y;z;room\n1;2;3;12 345\n4;5;6;7 8\n", Vec3d(1, 2, 3));
    EXPECT_TRUE(read("o.obj", "v 1.008 964 1.900\nv 2.125 3 1.008\n").notes.empty());
}

// The first large number of a large file stands in its last row.
TEST_F(DigitGroups, AreFoundWhereTheyComeLate)
{
    const std::string blanks(500, ' '); // more than is read at once
    const WholePoints points = wholeBall(900, 1000);
    for (const char* mark : {".", " ", "'"}) {
        std::string text;
        for (int i = 0; i < 20000; ++i)
            text +=
                concat(std::to_string(i % 100), ";", std::to_string(i / 100), ";", blanks, "7\n");
        const PointCloud cloud = read("late.csv", text + rows(points, ";", mark)).cloud;
        ASSERT_EQ(cloud.size(), 20300u);
        for (std::size_t i = 0; i < points.size(); ++i)
            for (std::size_t a = 0; a < 3; ++a)
                EXPECT_NEAR(cloud.world(20000 + i)[int(a)], double(points[i][a]), 1e-3);
    }
}

} // namespace
} // namespace mpuvdb::test
