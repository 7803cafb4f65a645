// Decimal commas are read right where they can be nothing else, and refused by name where they can.
#include "case_files.h"
#include "io_fixture.h"

#include <cmath>

namespace mpuvdb::test
{
namespace
{

/// A number as a program of another country writes it.
std::string withComma(std::string number)
{
    for (char& c : number)
        if (c == '.') c = ',';
    return number;
}

std::string fixed(double value, const char* format)
{
    char text[64];
    std::snprintf(text, sizeof text, format, value);
    return text;
}

/// Points of a helix about the origin, of both signs.
std::vector<Vec3d> helix()
{
    std::vector<Vec3d> points;
    for (int i = 0; i < 60; ++i)
        points.emplace_back(std::cos(0.4 * i), std::sin(0.4 * i), 0.07 * i - 1.9);
    return points;
}

/// Rows of the helix's points, or of @a points.
std::string rows(const std::string& separator, const char* format = "%.6f",
                 const std::string& before = "", const std::string& after = "",
                 const std::vector<Vec3d>& points = helix())
{
    std::string text;
    for (const Vec3d& p : points) {
        text += before;
        for (int a = 0; a < 3; ++a)
            text += (a > 0 ? separator : "") + withComma(fixed(p[a], format));
        text += after + "\n";
    }
    return text;
}

class DecimalCommas : public IoTest
{
protected:
    void expectHelix(const std::string& name, const std::string& text, double error = 1e-6)
    {
        SCOPED_TRACE(name + ": " + text.substr(0, 60));
        const PointInput input = read(name, text);
        const std::vector<Vec3d> expected = helix();
        ASSERT_EQ(input.cloud.size(), expected.size());
        for (std::size_t i = 0; i < expected.size(); ++i)
            EXPECT_LT((input.cloud.world(i) - expected[i]).cwiseAbs().maxCoeff(), error);
        ASSERT_FALSE(input.notes.empty());
        EXPECT_NE(input.notes[0].find("decimal commas"), std::string::npos);
    }
    void expectRefused(const std::string& name, const std::string& text)
    {
        SCOPED_TRACE(text.substr(0, 60));
        const std::string message = error(name, text);
        EXPECT_NE(message.find("decimal comma"), std::string::npos) << message;
        EXPECT_NE(message.find("Export"), std::string::npos) << message;
    }
};

TEST_F(DecimalCommas, AreReadWhereSomethingElsePartsTheColumns)
{
    for (const char* separator : {" ", "\t", ";", "; ", "   "})
        expectHelix("a.xyz", rows(separator));
    expectHelix("a.csv", "X;Y;Z\r\n" + rows(";", "%.6f", "", "\r"));
    expectHelix("a.txt", rows(" ", "%.6E"));
    expectHelix("a.txt", rows("\t", "%.6f", "", "\t255\t0\t10"));
    expectHelix("short.xyz", rows(" ", "%.3g"), 6e-3); // with whole numbers among them
}

TEST_F(DecimalCommas, AreReadWhereOnlyTheyMakeATable)
{
    expectHelix("blank.csv", rows(", ", "%.3g"), 6e-3); // as separators: 4 to 6 numbers in a row
    expectHelix("zeros.csv", rows(", "));               // "070000" is no whole number
    expectHelix("quoted.csv", "\"x\",\"y\",\"z\"\n" + rows("\",\"", "%.6f", "\"", "\""));
    expectHelix("quoted.csv", rows("\";\"", "%.6f", "\"", "\""));
}

TEST_F(DecimalCommas, AreReadInEveryFormatOfText)
{
    const std::string count = std::to_string(helix().size());
    expectHelix("a.pts", count + "\n" + rows(" ", "%.6f", "", " -1203 1 2 3"));
    expectHelix("a.obj", "# 1,5 by 2,5\no Part 1,2,3\n" + rows(" ", "%.6f", "v "));
    expectHelix("a.off", "OFF\n" + count + " 0 0\n" + rows(" "));
    expectHelix("a.ply", "ply\nformat ascii 1.0\nelement vertex " + count +
                             "\nproperty float x\nproperty float y\nproperty float z\n"
                             "end_header\n" +
                             rows(" "));
    expectHelix("a.pcd", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nVIEWPOINT 0,5 0 0 1,0 "
                         "0 0 0\nPOINTS " +
                             count + "\nDATA ascii\n" + rows(" "));
    expectHelix("a.ptx", "10\n6\n0,0 0,0 0,0\n1,0 0 0\n0 1,0 0\n0 0 1,0\n1,0 0 0 0\n0 1,0 0 0\n0 0 "
                         "1,0 0\n0 0 0 1,0\n" +
                             rows(" ", "%.6f", "", " 0,5"));
}

TEST_F(DecimalCommas, AreReadInMeshesAndScanSets)
{
    Interrupter progress;
    const Mesh mesh = readMesh(put("a.stl", "solid a\n facet normal 0,0 0,0 1,0\n  outer loop\n"
                                            "   vertex 0,000000e+00 0,000000e+00 0,250000e+00\n"
                                            "   vertex 1,500000e+00 0,000000e+00 0,250000e+00\n"
                                            "   vertex 0,000000e+00 1,500000e+01 0,250000e+00\n"
                                            "  endloop\n endfacet\nendsolid a\n"),
                               &progress);
    ASSERT_EQ(mesh.positions.size(), 3u);
    EXPECT_LT((mesh.world(2) - Vec3d(0, 15, 0.25)).norm(), 1e-6);
    ASSERT_FALSE(progress.notes().empty());
    EXPECT_NE(progress.notes()[0].find("decimal commas"), std::string::npos);
    put("a.xyz", "1 0 0\n2 0 0\n");
    const PointInput set = read("a.conf", "bmesh a.xyz 0,5 -1,25 30 0 0 0 1,0\n");
    EXPECT_LT((set.cloud.world(0) - Vec3d(1.5, -1.25, 30)).norm(), 1e-6);
}

TEST_F(DecimalCommas, AreRefusedWhereACommaMayPartNumbers)
{
    for (const char* format : {"%.6f", "%.1f", "%.4e"}) expectRefused("a.csv", rows(",", format));
    expectRefused("a.csv", "1,5, 2,5, 3,5\n2,5, 2,5, 3,5\n");
    expectRefused("a.xyz", "1,5 2.5 3,5\n");
    expectRefused("a.xyz", "0,5 ,25 1,5\n");
    expectRefused("a.obj", rows(",", "%.6f", "v "));
    // More numbers than in the rows that came before.
    std::string late;
    for (int i = 0; i < 3000; ++i)
        late += concat(std::to_string(i), ",", std::to_string(i), ",7\n");
    expectRefused("late.csv", late + "0,5,1,5,2,25\n");
    expectRefused("late.csv", late + "0,5,1\n0,5\n");
}

TEST_F(DecimalCommas, SeparatorsOfThousandsAreRefused)
{
    expectRefused("a.xyz", "1,234 5,678 910\n12 3,456 7,890\n");
    expectRefused("a.csv", "1,234;5,678;910\n"); // with both marks: see digit_groups_test
    expectRefused("a.csv", "\"1,234.5\",\"5,678.25\",\"910\"\n");
    // Where every number has as many digits behind a comma, it is a decimal one.
    EXPECT_EQ(read("b.xyz", "1,234 5,678 9,101\n2,125 3,456 7,890\n").cloud.size(), 2u);
}

TEST_F(DecimalCommas, SeparatorsStayWhatTheyAre)
{
    const auto first = [&](const std::string& text, const std::string& name = "a.csv") {
        const PointInput input = read(name, text);
        EXPECT_TRUE(input.notes.empty()) << text;
        return input.cloud.world(0);
    };
    const Vec3d expected(1, 25, 3);
    for (const char* text :
         {"1,25,3\n4,5,7\n", "1, 25, 3\n4,5, 6\n", "1 ,25 ,3\n4 ,5 ,6\n", "1,25,3\n-4,5,-6\n",
          "1,25,3,0,0,1\n4,5,6,0,1,0\n", "1,25,3,10,20,30\n4,5,6,7,8,9\n", " 1,25,  3\n12, 5,120\n",
          "1.0,25.0,3.0\n4.5,5,6\n", "1.0,25.0,3.0 10 20 30\n4,5,6 1 2 3\n", "1.,25,3.\n4,5,6\n",
          "1,25,3,\n4,5,6,\n", "x,y,z\n1,25,3\n4,5,6\n"}) {
        SCOPED_TRACE(text);
        EXPECT_LT((first(text) - expected).norm(), 1e-6);
    }
    EXPECT_LT((first("o Part 1,5\nv 1,25,3\nv 4.5,5,6\n", "a.obj") - expected).norm(), 1e-6);
    EXPECT_LT((first("1 25 3 # 1,5 2,5 3,5\n4.5 5 6\n", "a.xyz") - expected).norm(), 1e-6);
}

// The first comma of a large file stands in its last row.
TEST_F(DecimalCommas, AreFoundWhereTheyComeLate)
{
    const std::string blanks(500, ' '); // more than is read at once
    std::string text;
    for (int i = 0; i < 20000; ++i)
        text += concat(std::to_string(i % 100), " ", std::to_string(i / 100), blanks, "7\n");
    const PointInput input = read("late.xyz", text + "0,5 1,5 2,25\n");
    ASSERT_EQ(input.cloud.size(), 20001u);
    EXPECT_LT((input.cloud.world(20000) - Vec3d(0.5, 1.5, 2.25)).norm(), 1e-6);
}

TEST_F(DecimalCommas, OfTheCasesAreRead)
{
    MPUVDB_CASE(ball, "T04-decimal-comma.xyz");
    MPUVDB_CASE(solid, "T04-decimal-comma.stl");
    Interrupter progress;
    const PointInput input = readPoints({ball}, BadPoints::Drop, {}, {}, &progress);
    EXPECT_EQ(input.cloud.size(), 1500u);
    for (std::size_t i = 0; i < input.cloud.size(); ++i)
        EXPECT_NEAR(input.cloud.world(i).norm(), 1, 2e-6);
    const Mesh mesh = readMesh(solid, &progress);
    EXPECT_EQ(mesh.positions.size(), 4u);
    EXPECT_LT((mesh.frame - Vec3d::Constant(0.75)).norm(), 1e-6);
}

} // namespace
} // namespace mpuvdb::test
