// Columns without names: what their numbers can be, and what they cannot.
#include "io_fixture.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>

namespace mpuvdb::test
{
namespace
{

/// A point of a ball, which does not come in any order.
Vec3d ballPoint(int i, double radius)
{
    const double z = 1 - (2 * i + 1) / 300.0, s = std::sqrt(1 - z * z), turn = 2.399963 * i;
    return radius * Vec3d(s * std::cos(turn), s * std::sin(turn), z);
}

class PlainColumns : public IoTest
{
protected:
    /// Rows of a ball's points around @a middle, the i-th between before(i) and after(i).
    template <class Before, class After>
    static std::string ball(const Before& before, const After& after,
                            const std::string& separator = " ", double radius = 90,
                            const Vec3d& middle = Vec3d::Zero())
    {
        std::string text;
        for (int i = 0; i < kPoints; ++i) {
            const Vec3d p = middle + ballPoint(i * 67 % kPoints, radius);
            for (const std::string& field : before(i)) text += field + separator;
            text += concat(std::to_string(p.x()), separator, std::to_string(p.y()), separator,
                           std::to_string(p.z()));
            for (const std::string& field : after(i)) text += separator + field;
            text += "\n";
        }
        return text;
    }
    using Fields = std::vector<std::string>;
    static Fields none(int) { return {}; }

    /// That the points of @a input lie on the ball; the first of its notes says @a note.
    void expectBall(const PointInput& input, const std::string& note, double radius = 90,
                    const Vec3d& middle = Vec3d::Zero()) const
    {
        ASSERT_EQ(input.cloud.size(), std::size_t(kPoints));
        for (std::size_t i = 0; i < input.cloud.size(); ++i)
            EXPECT_NEAR((input.cloud.world(i) - middle).norm(), radius, 1e-5 * radius + 1e-6);
        EXPECT_EQ(!input.notes.empty(), !note.empty());
        if (!input.notes.empty()) {
            EXPECT_NE(input.notes[0].find(note), std::string::npos) << input.notes[0];
        }
    }
    static constexpr int kPoints = 300;
};

TEST_F(PlainColumns, BeforePositionsMayNumberOrTimeTheRows)
{
    const auto from = [](int first, int step) {
        return [=](int i) { return Fields{std::to_string(first + step * i)}; };
    };
    const auto time = [](double first, double step) {
        return [=](int i) { return Fields{std::to_string(first + step * i)}; };
    };
    const auto gap = [](int i) { return Fields{std::to_string(5 + i + i * i % 7 * 3)}; };
    const auto rgb = [](int i) { return Fields{std::to_string(i % 256), "20", "30"}; };
    const auto up = [](int) { return Fields{"0", "0", "1"}; };
    const Vec3d utm(432100, 5412300, 410);
    for (const char* separator : {" ", ",", ";", "\t"}) {
        SCOPED_TRACE(separator);
        for (const auto& [first, step] : {std::pair(1, 1), {0, 1}, {1000, 1}, {1, 10}})
            expectBall(read("id.xyz", ball(from(first, step), none, separator)),
                       "column 1 numbers the rows: x, y and z are columns 2, 3 and 4");
        expectBall(read("unix.xyz", ball(time(1.6e9, 0.001), none, separator)), "column 1 times");
        expectBall(read("utm.xyz", ball(time(1.6e9, 0.25), none, separator, 9, utm)),
                   "column 1 times", 9, utm);
        const PointInput colors = read("rgb.xyz", ball(from(1, 1), rgb, separator));
        expectBall(colors, "column 1 numbers");
        EXPECT_EQ(colors.cloud.colors.at(7), (PointCloud::Rgb{7, 20, 30}));
        const PointInput normals = read("n.xyz", ball(time(1.6e9, 0.001), up, separator));
        expectBall(normals, "column 1 times");
        EXPECT_TRUE(normals.cloud.hasNormals());
    }
    expectBall(read("gaps.xyz",
                    "# id and points\n" +
                        ball([](int i) { return Fields{std::to_string(3 * i + i % 3)}; }, none)),
               "column 1 numbers");
    const PointInput both = read(
        "both.txt",
        ball(
            [](int i) {
                return Fields{std::to_string(i), std::to_string(1.7e9 + i / 7)}; // in whole seconds
            },
            rgb, ",", 0.1));
    expectBall(both, "column 1 numbers the rows, column 2 times the rows: x, y and z are columns 3",
               0.1);
    EXPECT_FALSE(both.cloud.colors.empty());
    // It does not rise, and is whole beside coordinates with decimals.
    expectBall(read("gap.xyz", ball(gap, none)), "column 1 has whole numbers");
}

TEST_F(PlainColumns, OfWholeNumbersBeforeDecimalsAreLabels)
{
    std::mt19937 random(5);
    const auto intensity = [&](int) { return Fields{std::to_string(random() % 256)}; };
    std::vector<int> order(kPoints);
    std::iota(order.begin(), order.end(), 1);
    std::shuffle(order.begin(), order.end(), random);
    const auto shuffled = [&](int i) { return Fields{std::to_string(order[std::size_t(i)])}; };
    const auto scan = [](int i) { return Fields{std::to_string(i / 100)}; };
    const auto up = [](int) { return Fields{"0", "0", "1"}; };
    const auto rgb = [](int i) { return Fields{std::to_string(i % 256), "20", "30"}; };
    for (const char* separator : {" ", ";", ","}) {
        SCOPED_TRACE(separator);
        for (const auto& column : {std::function<Fields(int)>(intensity), {shuffled}}) {
            expectBall(read("a.xyz", ball(column, none, separator)),
                       "column 1 has whole numbers beside coordinates with decimals, and is left "
                       "out: x, y and z are columns 2, 3 and 4");
            const PointInput normals = read("n.xyz", ball(column, up, separator));
            expectBall(normals, "column 1 has whole numbers");
            EXPECT_TRUE(normals.cloud.hasNormals());
            const PointInput colors = read("c.xyz", ball(column, rgb, separator));
            expectBall(colors, "column 1 has whole numbers");
            EXPECT_EQ(colors.cloud.colors.at(7), (PointCloud::Rgb{7, 20, 30}));
        }
        // It might be the stations of profiles, unless something behind z tells.
        EXPECT_NE(error("s.xyz", ball(scan, none, separator)).find("never fall"),
                  std::string::npos);
        expectBall(read("s.xyz", ball(scan, up, separator)), "column 1 has whole numbers");
    }
    // Six digits leave no decimals of coordinates from 100000 on.
    std::string text;
    for (int i = 0; i < kPoints; ++i) {
        char row[200];
        const Vec3d p = Vec3d(432100, 5412.3, 41) + ballPoint(i * 67 % kPoints, 90);
        std::snprintf(row, sizeof row, "%g %g %g %g\n", p.x(), p.y(), p.z(), std::sin(i));
        text += row;
    }
    EXPECT_NEAR(read("g.xyz", text).cloud.world(0).y(), 5412.3, 90);
    // A face of a box whose x is 0 for long, and then no more.
    std::string box;
    for (int i = 0; i < 6000; ++i) {
        const double u = std::fmod(0.6180339 * i, 1), v = std::fmod(0.7548776 * i, 1);
        box += concat(i < 3000 ? "0 " : std::to_string(u) + " ", std::to_string(v), " ",
                      i < 3000 ? std::to_string(u) : "0.5", " ", std::to_string(u * v), "\n");
    }
    const PointInput faces = read("b.xyz", box);
    EXPECT_TRUE(faces.notes.empty());
    EXPECT_NEAR(faces.cloud.world(10).y(), std::fmod(7.548776, 1), 1e-5);
}

TEST_F(PlainColumns, OfUnitLengthBeforeOthersAreNormals)
{
    const auto normal = [](int i) {
        const Vec3d n = ballPoint(i * 67 % kPoints, 1);
        return Fields{std::to_string(n.x()), std::to_string(n.y()), std::to_string(n.z())};
    };
    const auto rgb = [](int i) { return Fields{std::to_string(i % 256), "20", "30"}; };
    const Vec3d middle(500, 30, 8);
    const auto expectNormals = [&](const PointInput& input, const std::string& note) {
        expectBall(input, note, 90, middle);
        ASSERT_TRUE(input.cloud.hasNormals());
        for (std::size_t i = 0; i < input.cloud.size(); ++i)
            EXPECT_GT(input.cloud.normals[i].cast<double>().dot(input.cloud.world(i) - middle), 89);
    };
    const std::string note = "columns 1, 2 and 3 are of unit length, so normals: x, y and z are "
                             "columns 4, 5 and 6";
    expectNormals(read("n.xyz", ball(normal, none, " ", 90, middle)), note);
    const PointInput colors = read("c.xyz", ball(normal, rgb, " ", 90, middle));
    expectNormals(colors, note);
    EXPECT_EQ(colors.cloud.colors.at(7), (PointCloud::Rgb{7, 20, 30}));
    // Behind an intensity, which is whole or a fraction.
    const auto gray = [&](int i) {
        Fields fields = normal(i);
        fields.insert(fields.begin(), std::to_string(0.5 + 0.5 * std::sin(i)));
        return fields;
    };
    const PointInput behind = read("g.xyz", ball(none, gray, " ", 90, middle));
    expectNormals(behind, "");
    const Vec3d half(0.5, 0.5, 0.5);
    expectBall(read("h.xyz", ball(none, gray, " ", 0.4, half)), "", 0.4, half);
    expectBall(read("h.xyz", ball(none, gray, " ", 1)), "", 1);
    // About the origin the normals of a ball are parallel to its points, and so are its own points
    // to longer normals; the unit ball may have colors.
    for (const double radius : {90.0, 0.5}) {
        const std::string message = error("o.xyz", ball(normal, none, " ", radius));
        EXPECT_NE(message.find("columns 1, 2 and 3 are of unit length"), std::string::npos);
        EXPECT_NE(message.find("Name the columns"), std::string::npos);
    }
    expectBall(read("unit.xyz", ball(none, normal, " ", 1)), "", 1);
    expectBall(read("unit.xyz", ball(none, rgb, " ", 1)), "", 1);
    expectBall(read("o.xyz", "nx ny nz x y z\n" + ball(normal, none)), "");
    // Colors first, or a small solid with vectors of any length.
    for (const double scale : {1.0, 1 / 255.0}) {
        const auto color = [=](int i) {
            const auto text = [=](int value) {
                return scale == 1 ? std::to_string(value) : std::to_string(value * scale);
            };
            return Fields{text(i % 256), text(20), text(i * i % 256)};
        };
        EXPECT_NE(error("rgb.xyz", ball(color, none)).find("may be positions or colors"),
                  std::string::npos);
    }
}

// A raster's rows are longer than what is looked at.
TEST_F(PlainColumns, OfRastersMayBeNumbered)
{
    std::string text;
    for (int i = 0; i < 4500; ++i)
        text += concat(std::to_string(i + 1), " ", std::to_string(i % 1500), " ",
                       std::to_string(i / 1500), " ", std::to_string(std::sin(0.01 * i)), "\n");
    const PointInput input = read("a.xyz", text);
    EXPECT_LT((input.cloud.world(1501) - Vec3d(1, 1, std::sin(15.01))).norm(), 1e-4);
    ASSERT_FALSE(input.notes.empty());
    EXPECT_NE(input.notes[0].find("column 1 numbers the rows"), std::string::npos);
}

// A box's points face by face: x is constant for longer than what is looked at first.
TEST_F(PlainColumns, OfFlatFacesMayBeNumbered)
{
    const auto box = [](int face, const Vec3d& corner, const auto& before) {
        std::string text;
        for (int i = 0; i < 3 * face; ++i) {
            const double u = std::fmod(0.6180339 * i, 1), v = std::fmod(0.7548776 * i, 1);
            const Vec3d p = corner + (i < face       ? Vec3d(0, u, v)
                                      : i < 2 * face ? Vec3d(1, u, v)
                                                     : Vec3d(u, 0, v));
            text += concat(before(i), " ", std::to_string(p.x()), " ", std::to_string(p.y()), " ",
                           std::to_string(p.z()), "\n");
        }
        return text;
    };
    const auto from = [](int first, int step) {
        return [=](int i) { return std::to_string(first + step * i); };
    };
    const auto expectBox = [&](int face, const Vec3d& corner, const auto& before) {
        SCOPED_TRACE(concat(std::to_string(face), " from ", before(0)));
        const PointInput input = read("a.xyz", box(face, corner, before));
        ASSERT_EQ(input.cloud.size(), std::size_t(3 * face));
        for (std::size_t i = 0; i < std::size_t(face); ++i)
            ASSERT_NEAR(input.cloud.world(i).x(), corner.x(), 1e-5);
        ASSERT_FALSE(input.notes.empty());
        EXPECT_NE(input.notes[0].find("column 1 numbers the rows"), std::string::npos);
    };
    const Vec3d whole(0, 0, 0), half(-0.5, -0.5, -0.5);
    for (const int face : {400, 1500, 20000, 70000}) { // the last longer than a raster's line
        expectBox(face, whole, from(0, 1));
        expectBox(face, half, from(1, 1));
        expectBox(face, half, from(1000, 10));
    }
    // x steps evenly for long.
    std::string lines;
    for (int i = 0; i < 6000; ++i)
        lines += concat(std::to_string(i), " ", std::to_string(0.001 * (i % 2000)), " ",
                        std::to_string(i / 2000), " ", std::to_string(std::sin(0.01 * i)), "\n");
    EXPECT_NEAR(read("b.xyz", lines).cloud.world(1000).x(), 1, 1e-5);
    // What may be a time is refused as it is where x varies at once.
    const auto even = [](int i) { return std::to_string(0.01 * i); };
    EXPECT_NE(error("t.xyz", box(1500, half, even)).find("column 1 rises"), std::string::npos);
}

// Millimeters beside numbers, which are as whole as they are.
TEST_F(PlainColumns, OfWholeCoordinatesMayBeNumbered)
{
    std::string text;
    for (int i = 0; i < kPoints; ++i) {
        const Vec3d p = ballPoint(i * 67 % kPoints, 9000);
        text += concat(std::to_string(i + 1), "\t", std::to_string(std::lround(p.x())), "\t",
                       std::to_string(std::lround(p.y())), "\t", std::to_string(std::lround(p.z())),
                       "\t7\t8\t9\n");
    }
    const PointInput input = read("mm.txt", text);
    ASSERT_EQ(input.cloud.size(), std::size_t(kPoints));
    EXPECT_FALSE(input.cloud.colors.empty());
    for (std::size_t i = 0; i < input.cloud.size(); ++i)
        EXPECT_NEAR(input.cloud.world(i).norm(), 9000, 2);
}

TEST_F(PlainColumns, ThatMayBeXOrATimeAreRefused)
{
    const auto even = [](int i) { return Fields{std::to_string(0.01 * i)}; };
    const auto ofDay = [](int i) { return Fields{std::to_string(34567.5 + 0.01 * i * i)}; };
    for (const std::string& text :
         {ball(even, none), ball(even, none, ";", 0.5), ball(ofDay, none, ",", 30)}) {
        const std::string message = error("a.xyz", text);
        EXPECT_NE(message.find("column 1 rises"), std::string::npos) << message;
        EXPECT_NE(message.find("Name the columns"), std::string::npos) << message;
    }
    // As it says.
    expectBall(read("a.xyz", "time x y z\n" + ball(even, none)), "");
    EXPECT_EQ(read("a.xyz", "x y z i\n" + ball(even, none)).cloud.size(), std::size_t(kPoints));
    // Two scans behind each other.
    std::string scan;
    for (int part = 0; part < 4; ++part)
        scan += ball([=](int i) { return Fields{std::to_string(i + part * kPoints)}; }, none);
    EXPECT_EQ(read("a.xyz", scan).cloud.size(), std::size_t(kPoints));
    EXPECT_NE(error("a.xyz", scan + scan).find("column 1 rises"), std::string::npos);
}

// Clouds that are sorted, or lie on a raster, with something behind their positions.
TEST_F(PlainColumns, OfPositionsThatRiseStayPositions)
{
    const auto expectFirst = [&](const std::string& text, const Vec3d& first) {
        SCOPED_TRACE(text.substr(0, text.find('\n')));
        const PointInput input = read("a.xyz", text);
        EXPECT_LT((input.cloud.world(0) - first).norm(), 1e-5);
        EXPECT_TRUE(input.notes.empty()) << input.notes[0];
    };
    const auto row = [](double x, double y, double z, const std::string& behind, int i) {
        const std::string fraction = concat(" ", std::to_string(std::cos(7.0 * i)));
        return concat(std::to_string(x), " ", std::to_string(y), " ", std::to_string(z),
                      behind == "fraction" ? fraction : behind, "\n");
    };
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(0, 10);
    std::vector<Vec3d> sorted(2000);
    for (Vec3d& p : sorted) p = Vec3d(uniform(random), uniform(random), uniform(random));
    std::sort(sorted.begin(), sorted.end(), [](auto& a, auto& b) { return a.x() < b.x(); });
    for (const char* behind : {"", "fraction", " 17", " -3", " 0 0 1", " 10 20 30", " 7 10 20 30"})
        for (const Vec3d& offset : {Vec3d(0, 0, 0), Vec3d(432100, 5412300, 410)}) {
            std::string text;
            for (int i = 0; i < 2000; ++i) {
                const Vec3d p = sorted[std::size_t(i)] + offset + Vec3d(1e-5 * i, 0, 0);
                text += row(p.x(), p.y(), p.z(), behind, i);
            }
            expectFirst(text, sorted[0] + offset);
        }
    for (const int width : {40, 1500})
        for (const char* behind : {"", "fraction", " 12"}) {
            std::string raster, camera, rolled, shifted, turned;
            for (int i = 0; i < 3 * width; ++i) {
                const int x = i % width, y = i / width;
                const double z = std::sin(0.01 * i);
                raster += row(x, y, z, behind, i);
                camera += row(0.5 * x + 0.1 * std::sin(i), y + 0.1 * std::cos(i), z, behind, i);
                rolled += row(0.5 * x, 0.25 * x - y, z, behind, i);
                shifted += row(x, y + 0.5, z, behind, i);
                turned += row(x, -0.34 * x - y, z, behind, i);
            }
            expectFirst(raster, Vec3d(0, 0, 0));
            expectFirst(camera, Vec3d(0, 0.1, 0));
            expectFirst(rolled, Vec3d(0, 0, 0));
            expectFirst(shifted, Vec3d(0, 0.5, 0));
            expectFirst(turned, Vec3d(0, 0, 0));
        }
    // A lathe's: x goes on evenly.
    for (const char* behind : {"", " 12", " 10 20 30", " 0 0.6 0.8"}) {
        std::string text;
        for (int i = 0; i < 1500; ++i)
            text += row(0.01 * i, std::cos(0.1 * i), std::sin(0.1 * i), behind, i);
        expectFirst(text, Vec3d(0, 1, 0));
    }
    // Too few rows to say.
    expectFirst("1 0.5 3.5 2.5\n2 1.5 0.5 7.5\n3 0.5 0.25 0.5\n", Vec3d(1, 0.5, 3.5));
}

// Whole numbers that are no bytes, between black and white of 16 bits, with what stands beside
// them.
TEST_F(PlainColumns, ColorsOf16BitsAreToldFromNormals)
{
    const auto rows = [](const std::string& separator, bool intensity, bool normals, int largest) {
        std::string text;
        for (int i = 0; i < 60; ++i) {
            const auto add = [&](const std::string& value) { text += separator + value; };
            text += std::to_string(0.25 * (i % 8));
            add(std::to_string(i / 8));
            add("-1.5");
            if (intensity) add(std::to_string(i * 700));
            for (int c = 1; c <= 3; ++c) add(std::to_string(i * c % 6 * largest / 5));
            if (normals) text += concat(separator, "0", separator, "0", separator, "1");
            text += "\n";
        }
        return text;
    };
    for (const char* separator : {" ", ";", ",", "\t"})
        for (const bool intensity : {false, true})
            for (const bool normals : {false, true}) {
                SCOPED_TRACE(
                    concat(separator, intensity ? "intensity" : "", normals ? "normals" : ""));
                const PointCloud cloud =
                    read("a.xyz", rows(separator, intensity, normals, 65535)).cloud;
                EXPECT_EQ(cloud.hasNormals(), normals);
                ASSERT_EQ(cloud.colors.size(), 60u);
                EXPECT_EQ(cloud.colors[1], (PointCloud::Rgb{51, 102, 153}));
                EXPECT_EQ(cloud.colors[5], (PointCloud::Rgb{255, 204, 153}));
            }
    EXPECT_FALSE(read("dark.xyz", rows(" ", false, false, 1000)).cloud.hasNormals());
    // Larger numbers, negative ones and fractions are no colors.
    const auto both = [&](const std::string& triple) {
        return read("n.xyz", concat("0 0 0 ", triple, "\n1 2 3 300 0 0\n")).cloud;
    };
    EXPECT_TRUE(both("100000 2 3").hasNormals());
    EXPECT_TRUE(both("-300 0 0").hasNormals());
    EXPECT_TRUE(both("0 299.5 0").hasNormals());
    // A number that follows three others is no color's end.
    EXPECT_TRUE(
        read("s.xyz", "0 0 0 300 2 3 400 0.5\n1 2 3 400 5 6 700 0.5\n").cloud.colors.empty());
}

// Fractions are colors where positions and normals leave nothing else.
TEST_F(PlainColumns, OfFractionsAreColorsBesideNormals)
{
    const auto color = [](int i) { return concat("0.2 0.4 ", i % 2 ? "1" : "0.6"); };
    const auto normal = [](int i) { return i % 2 ? "0 0 1" : "0 -0.6 0.8"; };
    const auto rows = [&](const auto& behind) {
        return ball(none, [&](int i) { return Fields{behind(i)}; });
    };
    const auto expectBoth = [&](const std::string& text, const std::string& note = "") {
        SCOPED_TRACE(text.substr(0, text.find('\n')));
        const PointInput input = read("a.xyz", text);
        expectBall(input, note);
        ASSERT_TRUE(input.cloud.hasNormals());
        ASSERT_EQ(input.cloud.colors.size(), std::size_t(kPoints));
        for (std::size_t i = 0; i < std::size_t(kPoints); ++i) {
            const bool odd = i % 2 == 1;
            const Vec3f expected = odd ? Vec3f(0, 0, 1) : Vec3f(0, -0.6f, 0.8f);
            EXPECT_LT((input.cloud.normals[i] - expected).norm(), 1e-6f);
            EXPECT_EQ(input.cloud.colors[i],
                      (PointCloud::Rgb{51, 102, std::uint8_t(odd ? 255 : 153)}));
        }
    };
    const auto after = rows([&](int i) { return concat(normal(i), " ", color(i)); });
    expectBoth(after);
    expectBoth(rows([&](int i) { return concat(color(i), " ", normal(i)); }));
    expectBoth(std::to_string(kPoints) + "\n" + after);
    expectBoth(ball([](int i) { return Fields{std::to_string(i)}; },
                    [&](int i) { return Fields{concat(normal(i), " ", color(i))}; }),
               "column 1 numbers the rows");
    // Three fractions of several, numbers beyond 1, or beside no normals are no colors.
    const auto expectNone = [&](const std::string& behind, bool normals) {
        SCOPED_TRACE(behind);
        const PointInput input = read("b.xyz", rows([&](int) { return behind; }));
        expectBall(input, "");
        EXPECT_TRUE(input.cloud.colors.empty());
        EXPECT_EQ(input.cloud.hasNormals(), normals);
    };
    for (const char* behind : {" 0.2 0.4 0.6 0.5", " 0.2 0.4", " 0.2 0.4 1.5", " -0.2 0.4 0.5"})
        expectNone(concat("0 0 1", behind), true);
    expectNone("0.2 0.4 0.6 0.2 0.4 0.6", false);
    expectNone("3.5 4.5 5.5 0.2 0.4 0.6", false);
    expectNone("0.2 0.4 0.6 3.5 4.5 5.5", false);
}

// In PTS an intensity stands before the color, though it is a number as colors are.
TEST_F(PlainColumns, OfPtsHaveTheIntensityBeforeTheColor)
{
    const std::string count = std::to_string(kPoints) + "\n";
    const auto with = [](const std::string& intensity, const std::string& behind) {
        return ball(none, [=](int i) {
            return Fields{intensity.empty() ? std::to_string(i % 256) : intensity, behind};
        });
    };
    const auto expectColor = [&](const std::string& name, const std::string& text,
                                 const PointCloud::Rgb& rgb, bool normals = false) {
        SCOPED_TRACE(text.substr(0, text.find('\n')));
        const PointInput input = read(name, text);
        expectBall(input, "");
        EXPECT_EQ(input.cloud.hasNormals(), normals);
        ASSERT_EQ(input.cloud.colors.size(), std::size_t(kPoints));
        for (const PointCloud::Rgb& color : input.cloud.colors) EXPECT_EQ(color, rgb);
    };
    for (const std::string& before : {std::string(), count})
        for (const char* intensity : {"", "0", "255", "17", "0.5", "-1203"}) {
            expectColor("a.pts", before + with(intensity, "10 20 30"), {10, 20, 30});
            expectColor("A.PTS", before + with(intensity, "10 20 30 0 0 1"), {10, 20, 30}, true);
            expectColor("f.pts", before + with(intensity, "0.2 0.4 1"), {51, 102, 255});
            expectColor("w.pts", before + with(intensity, "257 0 65535"), {1, 0, 255});
        }
    // What is no color's order, or no PTS, is as its numbers say.
    expectColor("n.pts", with("0", "0 1 10 20 30"), {10, 20, 30}, true);
    expectColor("c.pts", with("10", "20 30"), {10, 20, 30});
    expectColor("last.pts", with("10", "20 30 -700"), {10, 20, 30});
    expectColor("wide.pts", with("10", "20 30 1023"), {10, 20, 30});
    expectColor("a.xyz", with("10", "20 30 40"), {10, 20, 30});
    expectColor("a.txt", count + with("10", "20 30 40"), {10, 20, 30});
    const PointInput numbered = read("i.pts", ball([](int i) { return Fields{std::to_string(i)}; },
                                                   [](int) {
                                                       return Fields{"7", "10", "20", "30"};
                                                   }));
    expectBall(numbered, "column 1 numbers the rows");
    EXPECT_EQ(numbered.cloud.colors.at(9), (PointCloud::Rgb{10, 20, 30}));
}

} // namespace
} // namespace mpuvdb::test
