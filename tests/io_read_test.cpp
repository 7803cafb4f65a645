// Every dialect, written here and compared exactly.
#include "io_fixture.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb::test
{
namespace
{

using Rgb = PointCloud::Rgb;

void expectWorld(const PointCloud& cloud, std::size_t i, const Vec3d& expected)
{
    ASSERT_LT(i, cloud.size());
    EXPECT_LT((cloud.world(i) - expected).norm(), 1e-6) << cloud.world(i).transpose();
}

TEST_F(IoTest, EverySampleGivesItsPoints)
{
    for (const Sample& sample : samples()) {
        SCOPED_TRACE(sample.name);
        const PointInput input = read(sample.name, sample.bytes);
        EXPECT_EQ(input.cloud.size(), sample.points);
        for (const Vec3f& n : input.cloud.normals) EXPECT_NEAR(n.norm(), 1, 1e-6);
    }
}

// The same tetrahedron, with normals from its faces that point away from its middle.
TEST_F(IoTest, MeshesGiveOutwardNormals)
{
    for (const Sample& sample : samples()) {
        if (sample.name.find("mesh.") == std::string::npos && sample.name != "ascii.ply" &&
            sample.name != "little.ply" && sample.name != "big.ply" &&
            sample.name.find(".stl") == std::string::npos)
            continue;
        SCOPED_TRACE(sample.name);
        const PointCloud cloud = read(sample.name, sample.bytes).cloud;
        ASSERT_TRUE(cloud.hasNormals());
        for (std::size_t i = 0; i < cloud.size(); ++i)
            EXPECT_GT(cloud.normals[i].cast<double>().dot(cloud.world(i) - Vec3d::Constant(0.25)),
                      0);
    }
}

TEST_F(IoTest, ColorsOfEveryFormat)
{
    for (const Sample& sample : samples())
        for (const char* name : {"counted.pts", "named.csv", "rays.ptx", "ascii.pcd", "binary.pcd",
                                 "packed.pcd", "color.las", "new.las"}) {
            if (sample.name != name) continue;
            SCOPED_TRACE(name);
            const PointCloud cloud = read(sample.name, sample.bytes).cloud;
            ASSERT_EQ(cloud.colors.size(), cloud.size());
            for (const Rgb& rgb : cloud.colors) EXPECT_EQ(rgb, (Rgb{10, 20, 30}));
        }
}

TEST_F(IoTest, PlyScalarTypesInBothByteOrders)
{
    for (const bool big : {false, true}) {
        std::string s =
            concat("ply\r\nformat binary_", big ? "big" : "little",
                   "_endian 1.0\r\ncomment c\r\nelement camera 1\r\n"
                   "property list uint8 float32 view\r\nelement vertex 2\r\n"
                   "property uint8 flag\r\nproperty int16 z\r\nproperty float64 x\r\n"
                   "property int64 y\r\nproperty uint16 red\r\nproperty int green\r\n"
                   "property double blue\r\nproperty float32 quality\r\nend_header\r\n");
        s += concat(std::string(1, 2), bytesOf(1.f, big), bytesOf(2.f, big));
        for (int i = 1; i <= 2; ++i)
            s += concat(std::string(1, 9), bytesOf(std::int16_t(-3 * i), big),
                        bytesOf(5e6 + 0.25 * i, big), bytesOf(std::int64_t(7 * i), big),
                        bytesOf(std::uint16_t(257 * 200), big), bytesOf(257 * 51, big),
                        bytesOf(257.0, big), bytesOf(2.f * float(i), big));
        const PointCloud cloud = read("types.ply", s).cloud;
        ASSERT_EQ(cloud.size(), 2u);
        expectWorld(cloud, 0, Vec3d(5e6 + 0.25, 7, -3));
        expectWorld(cloud, 1, Vec3d(5e6 + 0.5, 14, -6));
        EXPECT_EQ(cloud.colors[0], (Rgb{200, 51, 1}));
        EXPECT_EQ(cloud.confidence, (std::vector<float>{0.5f, 1.f}));
    }
}

/// Two points in PLY, whose colors are of one type: the second one's as large as colors are.
template <class T>
std::string coloredPly(const char* type, double largest)
{
    std::string s =
        concat("ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"
               "property float y\nproperty float z\n");
    for (const char* const name : {"red", "green", "blue"})
        s += concat("property ", type, " ", name, "\n");
    s += "end_header\n";
    for (const double share : {0.2, 1.0}) {
        s += concat(bytesOf(1.f), bytesOf(float(share)), bytesOf(0.f));
        for (const double part : {1.0, 0.5, 0.0}) s += bytesOf(T(part * share * largest));
    }
    return s;
}

TEST_F(IoTest, ColorsOfAnyTypeAndScale)
{
    const std::pair<const char*, std::string> files[] = {
        {"uchar", coloredPly<std::uint8_t>("uchar", 255)},
        {"short", coloredPly<std::int16_t>("short", 255)},
        {"ushort, bytes", coloredPly<std::uint16_t>("ushort", 255)},
        {"ushort", coloredPly<std::uint16_t>("ushort", 65535)},
        {"int, bytes", coloredPly<std::int32_t>("int", 255)},
        {"uint", coloredPly<std::uint32_t>("uint", 65535)},
        {"float, bytes", coloredPly<float>("float", 255)},
        {"float", coloredPly<float>("float", 1)},
        {"float, 16 bits", coloredPly<float>("float", 65535)},
        {"double, bytes", coloredPly<double>("double", 255)},
        {"double", coloredPly<double>("double", 1)},
    };
    for (const auto& [name, bytes] : files) {
        SCOPED_TRACE(name);
        const PointCloud cloud = read("colors.ply", bytes).cloud;
        ASSERT_EQ(cloud.colors.size(), 2u);
        const Rgb expected[2] = {{51, 26, 0}, {255, 128, 0}};
        for (std::size_t i = 0; i < 2; ++i)
            for (std::size_t c = 0; c < 3; ++c)
                EXPECT_NEAR(int(cloud.colors[i][c]), int(expected[i][c]), 1) << i << " " << c;
    }
    // A byte is a byte, however dark.
    const PointCloud dark = read("dark.ply", coloredPly<std::uint8_t>("uchar", 1)).cloud;
    EXPECT_EQ(dark.colors[1], (Rgb{1, 0, 0}));
}

TEST_F(IoTest, ColorsOfTextOnAnyScale)
{
    const auto colors = [&](const std::string& name, const std::string& text) {
        return read(name, text).cloud.colors;
    };
    const std::vector<Rgb> expected = {{51, 102, 255}, {0, 0, 0}};
    EXPECT_EQ(colors("cc.txt", "//X Y Z Rf Gf Bf\n0 0 0 0.2 0.4 1\n1 2 3 0 0 0\n"), expected);
    EXPECT_EQ(colors("named.csv", "x,y,z,r,g,b\n0,0,0,51,102,255\n1,2,3,0,0,0\n"), expected);
    EXPECT_EQ(colors("wide.csv", "x,y,z,r,g,b\n0,0,0,13107,26214,65535\n1,2,3,0,0,0\n"), expected);
    EXPECT_EQ(colors("v.obj", "v 0 0 0 0.2 0.4 1\nv 1 2 3 0 0 0\n"), expected);
    EXPECT_EQ(colors("bytes.obj", "v 0 0 0 51 102 255\nv 1 2 3 0 0 0\n"), expected);
    EXPECT_EQ(colors("c.off", "COFF\n2 0 0\n0 0 0 0.2 0.4 1 1\n1 2 3 0 0 0 1\n"), expected);
    EXPECT_EQ(colors("b.off", "COFF\n2 0 0\n0 0 0 51 102 255 255\n1 2 3 0 0 0 255\n"), expected);
}

TEST_F(IoTest, ScalarsThatThereAreAreListed)
{
    using Names = std::vector<std::string>;
    const std::string header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                               "property float y\nproperty float z\nproperty float quality\n"
                               "property list uchar int l\n";
    const auto named = [&](const std::string& name, const std::string& bytes) {
        return read(name, bytes).scalarNames;
    };
    const std::string ply = header + "property float curvature\nproperty int label\nend_header\n"
                                     "1 2 3 1 0 0.5 7\n";
    EXPECT_EQ(named("a.ply", ply), (Names{"curvature", "label"}));
    EXPECT_EQ(named("a.csv", "x,y,z,GPS time,nx,ny,nz,Class\n1,2,3,4,0,0,1,ground\n"),
              (Names{"GPS time", "Class"}));
    EXPECT_EQ(named("a.xyz", "1 2 3 4\n5 6 7 8\n"), Names{});
    EXPECT_EQ(named("a.pcd", "VERSION .7\nFIELDS x y z intensity _ ring\nSIZE 4 4 4 4 1 2\n"
                             "TYPE F F F F U U\nCOUNT 1 1 1 1 4 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
                             "DATA ascii\n1 2 3 4 0 0 0 0 5\n"),
              (Names{"intensity", "ring"}));
    // Of several files, what all have; and what is not there is answered with what is.
    Interrupter progress;
    const auto other = put("b.ply", header + "property int label\nend_header\n5 2 3 1 0 7\n");
    EXPECT_EQ(readPoints({path("a.ply"), other}, BadPoints::Drop, {}, {}, &progress).scalarNames,
              Names{"label"});
    try {
        readPoints({path("a.ply"), other}, BadPoints::Drop, {}, {"curvature"}, &progress);
        ADD_FAILURE();
    } catch (const InputError& e) {
        EXPECT_NE(
            std::string(e.what()).find("b.ply: has no 'curvature' at its points, but 'label'"),
            std::string::npos)
            << e.what();
    }
}

TEST_F(IoTest, ColumnsOfTextBesideNamedOnes)
{
    const std::string rows[] = {
        "Easting,Northing,Elevation,Class\n1,2,3,ground\n4,5,6,high vegetation\n7,8,9,\n",
        "Name;Easting (m);Northing (m);Elevation (m)\n\"a; b\";1;2;3\nP 2;4;5;6\n;7;8;9\n",
        "id\tx\ty\tz\tnote\np1\t1\t2\t3\t\np2\t4\t5\t6\t17 m off\np3\t7\t8\t9\tx\n",
        "\"x\",\"y\",\"z\",\"label\"\n\"1\",\"2\",\"3\",\"a, "
        "b\"\n\"4\",\"5\",\"6\",\"\"\n7,8,9,c\n"};
    for (const std::string& text : rows) {
        SCOPED_TRACE(text);
        const PointCloud cloud = read("named.csv", text).cloud;
        ASSERT_EQ(cloud.size(), 3u);
        for (int i = 0; i < 3; ++i)
            expectWorld(cloud, std::size_t(i), Vec3d(3 * i + 1, 3 * i + 2, 3 * i + 3));
    }
    // A field that is missing does not pull the next one into its place.
    EXPECT_NE(error("gap.csv", "x,y,z,w\n1,2,3,4\n5,,7,8\n").find("has nothing in column 2"),
              std::string::npos);
    EXPECT_NE(error("word.csv", "x,y,z,w\n1,2,3,4\n5,six,7,8\n").find("line 3"), std::string::npos);
    EXPECT_NE(error("short.csv", "x,y,z,w\n1,2,3,4\n5,6,7\n").find("has 3 fields"),
              std::string::npos);
    EXPECT_NE(error("long.csv", "x,y,z,w\n1,2,3,4\n5,6,7,8,9\n").find("more fields"),
              std::string::npos);
}

// Every value in quotes, as programs for tables write them, or some.
TEST_F(IoTest, ColumnsOfTextMayStandInQuotes)
{
    for (const char* const separator : {",", ";", "\t", " ", ", "})
        for (const char* const header : {"", "# made by me\n", "\"x\",\"y\",\"z\"\n", "2\n"}) {
            std::string all = header, some = header;
            for (int i = 0; i < 2; ++i) {
                const std::string x = std::to_string(i), quoted = "\"" + x + ".5\"";
                all += concat(quoted, separator, "\"-2.5e1\"", separator, "\" 3.25 \"\r\n");
                some += concat(x, ".5", separator, "\"-25\"", separator, "3.25\n");
            }
            for (const std::string& text : {all, some}) {
                SCOPED_TRACE(text);
                const PointCloud cloud = read("quoted.csv", text).cloud;
                ASSERT_EQ(cloud.size(), 2u);
                for (std::size_t i = 0; i < 2; ++i)
                    expectWorld(cloud, i, Vec3d(double(i) + 0.5, -25, 3.25));
            }
        }
    const PointCloud colored = read("c.csv", "\"0.5\",\"1\",\"2\",\"10\",\"20\",\"30\"\n"
                                             "\"1.5\",\"1\",\"2\",\"40\",\"50\",\"60\"\n")
                                   .cloud;
    EXPECT_EQ(colored.colors.at(1), (Rgb{40, 50, 60}));
    // What is missing, is several numbers, or has one quote only is no number.
    for (const char* const second : {"\"\"", "\"1 500\"", "\"1,5,3\"", "\"1.5", "\"a\"", "1\"5"})
        EXPECT_NE(error("bad.csv", concat("\"1.5\",\"2.5\",\"3.5\",\"7\"\n\"1.5\",", second,
                                          ",\"3.5\",\"7\"\n"))
                      .find("line 2"),
                  std::string::npos)
            << second;
}

TEST_F(IoTest, PlyListsInsideVerticesAreSkipped)
{
    const std::string properties =
        "element vertex 2\nproperty float x\nproperty list uchar short l\n"
        "property float y\nproperty float z\nend_header\n";
    const PointCloud text =
        read("a.ply", "ply\nformat ascii 1.0\n" + properties + "1 2 8 9 2 3\n\n4 0 5 6\n").cloud;
    std::string s = "ply\nformat binary_little_endian 1.0\n" + properties;
    s += concat(bytesOf(1.f), std::string(1, 2), bytesOf(std::int16_t(8)), bytesOf(std::int16_t(9)),
                bytesOf(2.f), bytesOf(3.f), bytesOf(4.f), std::string(1, 0), bytesOf(5.f),
                bytesOf(6.f));
    for (const PointCloud& cloud : {text, read("b.ply", s).cloud}) {
        expectWorld(cloud, 0, Vec3d(1, 2, 3));
        expectWorld(cloud, 1, Vec3d(4, 5, 6));
    }
}

TEST_F(IoTest, PlyFacesMayComeFirstAndLinesMayEndInCr)
{
    std::string s =
        "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
        "property uchar flag\nelement vertex 4\nproperty double x\nproperty double y\n"
        "property double z\nend_header\n3 0 1 2 7\n0 0 0\n1 0 0\n0 1 0\n9 9 9\n";
    for (const char* lineEnd : {"\n", "\r\n", "\r"}) {
        std::string text;
        for (const char c : s) text += c == '\n' ? std::string(lineEnd) : std::string(1, c);
        const PointInput input = read("a.ply", text);
        ASSERT_EQ(input.cloud.size(), 3u);
        EXPECT_EQ(input.dropped.at("unreferenced vertex"), 1u);
        for (const Vec3f& n : input.cloud.normals) EXPECT_EQ(n, Vec3f::UnitZ());
    }
}

// A strip turns every other triangle over; a zero area or a separator gives none.
TEST_F(IoTest, StripsKeepTheirOrientation)
{
    const PointCloud cloud =
        read("s.ply",
             "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
             "property float z\nelement tristrips 1\nproperty list int int vertex_indices\n"
             "end_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n"
             "8 0 1 2 3 -1 2 3 4\n")
            .cloud;
    EXPECT_EQ(cloud.size(), 5u);
    for (const Vec3f& n : cloud.normals) EXPECT_EQ(n, Vec3f::UnitZ());
}

TEST_F(IoTest, ColumnsAreToldApart)
{
    const auto cloud = [&](const std::string& text) { return read("a.xyz", text).cloud; };
    EXPECT_FALSE(cloud("0 0 0 17\n1 2 3 18\n").hasNormals());
    EXPECT_TRUE(cloud("0 0 0 0 1 0\n1 2 3 1 0 0\n").hasNormals());
    EXPECT_TRUE(cloud("0;0;0;-0.5;3;0.25\n1;2;3;1;7;-2\n").hasNormals()) << "not normalized";
    EXPECT_EQ(cloud("0,0,0,255,128,0\n1,2,3,1,2,3\n").colors[1], (Rgb{1, 2, 3}));
    EXPECT_EQ(cloud("0 0 0 0.2 0.4 1\n1 2 3 0 0 0\n").colors[0], (Rgb{51, 102, 255}));
    const PointCloud both = cloud("0\t0\t0\t10\t20\t30\t0\t0\t1\n1\t2\t3\t40\t50\t60\t0\t1\t0\n");
    EXPECT_EQ(both.colors[1], (Rgb{40, 50, 60}));
    EXPECT_EQ(both.normals[1], Vec3f::UnitY());
    const PointCloud swapped = cloud("// c\n0 0 0 0 0 1 10 20 30 # here\r\n\n1 2 3 0 1 0 40 50 60");
    EXPECT_EQ(swapped.colors[1], (Rgb{40, 50, 60}));
    EXPECT_EQ(swapped.normals[1], Vec3f::UnitY());
    EXPECT_EQ(cloud("//X Y Z Nx Ny Nz\n0 0 0 5 0 0\n1 2 3 0 2 0\n").normals[0], Vec3f::UnitX());
}

TEST_F(IoTest, OffMayHaveItsCountsOnTheFirstLine)
{
    for (const char* head : {"OFF 3 1 0\n", "OFF3 1 0\n", "OFF # c\n3 1 0\n", "COFF\n3 1 0\n"}) {
        const bool colors = head[0] == 'C';
        const std::string color = colors ? " 10 20 30 255\n" : "\n";
        const PointCloud cloud =
            read("a.off", concat(head, "0 0 0", color, "1 0 0", color, "0 1 0", color, "3 0 1 2\n"))
                .cloud;
        EXPECT_EQ(cloud.size(), 3u) << head;
        EXPECT_EQ(cloud.normals.at(0), Vec3f::UnitZ());
        if (colors) {
            EXPECT_EQ(cloud.colors.at(2), (Rgb{10, 20, 30}));
        }
    }
}

TEST_F(IoTest, TextMayBeginWithAByteOrderMark)
{
    EXPECT_EQ(read("bom.csv", "\xef\xbb\xbfx,y,z\r\n1,2,3\r\n4,5,6\r\n").cloud.size(), 2u);
    EXPECT_EQ(read("bom.xyz", "\xef\xbb\xbf"
                              "1 2 3\n4 5 6\n")
                  .cloud.size(),
              2u);
}

TEST_F(IoTest, ClassicPwnHasNormalsAfterThePoints)
{
    const PointCloud cloud = read("a.pwn", "2\n0 0 0\n1 2 3\n0 0 2\n0 1 0\n").cloud;
    ASSERT_EQ(cloud.size(), 2u);
    EXPECT_EQ(cloud.normals[0], Vec3f::UnitZ());
    EXPECT_EQ(cloud.normals[1], Vec3f::UnitY());
    // Where the format has none there, the header counts too few.
    const PointInput more = read("a.xyz", "2\n0 0 0\n1 2 3\n0 0 2\n0 1 0\n");
    EXPECT_EQ(more.cloud.size(), 4u);
    EXPECT_EQ(more.notes.size(), 1u);
}

TEST_F(IoTest, NumbersOfFortranAndMissingOnes)
{
    const PointCloud cloud = read("a.txt", "1.5D+01 -2.5d-1 .5D0\n15 1.d0 1D0\n").cloud;
    expectWorld(cloud, 0, Vec3d(15, -0.25, 0.5));
    expectWorld(cloud, 1, Vec3d(15, 1, 1));
    EXPECT_NE(error("b.txt", "1 2 D3\n").find("line 1"), std::string::npos);
    for (const char* mark : {"-", "NA", "n/a", "NULL", "None"}) {
        const PointInput input = read("c.txt", concat("1 2 3\n4 5 ", mark, "\n7 8 9\n"));
        EXPECT_EQ(input.cloud.size(), 2u) << mark;
        EXPECT_EQ(input.dropped.at("not finite"), 1u);
    }
    EXPECT_NE(error("d.txt", "1 2 3\n4 5 six\n").find("line 2"), std::string::npos);
}

TEST_F(IoTest, NumbersAreRoundedCorrectly)
{
    const PointCloud cloud = read("a.xyz", "+1.5e1 -2.5E-1 .5\n15.000000000000000000000000 -1e-400 "
                                           "0.1e1\n15 1 1\n")
                                 .cloud;
    expectWorld(cloud, 0, Vec3d(15, -0.25, 0.5));
    expectWorld(cloud, 1, Vec3d(15, 0, 1));
}

TEST_F(IoTest, PtxPlacesItsScansAndLooksAtTheScanner)
{
    std::string two;
    for (const Sample& sample : samples())
        if (sample.name == "rays.ptx") two = sample.bytes + sample.bytes;
    two.replace(two.rfind("100 0 0 1"), 9, "0 100 0 1");
    const PointCloud cloud = read("two.ptx", two).cloud;
    ASSERT_EQ(cloud.size(), 18u);
    expectWorld(cloud, 0, Vec3d(99, -1, -5));
    expectWorld(cloud, 9, Vec3d(-1, 99, -5));
    for (const Vec3f& n : cloud.normals) EXPECT_GT(n.z(), 0.99);
    EXPECT_EQ(*std::max_element(cloud.confidence.begin(), cloud.confidence.end()), 1);
}

TEST_F(IoTest, ObjFacesGoOnAfterABackslash)
{
    const std::string vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    const auto triangles = [&](const std::string& faces) {
        Interrupter progress;
        return readMesh(put("a.obj", vertices + faces), &progress).triangles;
    };
    const auto whole = triangles("f 1/1 2/2 3/3 4/4\nf -4 -3 -2\n");
    ASSERT_EQ(whole.size(), 3u);
    EXPECT_EQ(triangles("f 1/1 2/2 \\\n3/3\\\r\n 4/4\nf -4 \\\n-3 -2\n"), whole);
    EXPECT_EQ(triangles("7 8 9\nf 1/1 2/2 3/3 4/4\nf -4 -3 -2 \\\n"),
              whole); // nothing to go on from
    EXPECT_NE(error("b.obj", vertices + "f 1 2 \\\nx 3\n").find("line 6"), std::string::npos);
    // More than is read at once.
    std::string many, broken;
    for (int n = 0; n < 400000; ++n) {
        const std::string last = std::to_string(n % 2 + 3);
        many += "f 1 2 " + last + "\n";
        broken += "f 1 2 \\\n" + last + "\n";
    }
    EXPECT_EQ(triangles(broken), triangles(many));
}

TEST_F(IoTest, PcdWithRowsIsSeenFromItsViewpoint)
{
    const auto pcd = [](const char* fields, const char* rows, const char* viewpoint) {
        return concat("VERSION .7\nFIELDS ", fields, "\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n", rows,
                      viewpoint,
                      "POINTS 4\nDATA ascii\n0 0 5 0 0 1\n1 0 5 0 0 1\n0 1 5 0 0 1\n"
                      "nan nan nan 0 0 1\n");
    };
    const char* const bare = "x y z a b c";
    const char* const oriented = "x y z normal_x normal_y normal_z";
    const char *const picture = "WIDTH 2\nHEIGHT 2\n", *const list = "WIDTH 4\nHEIGHT 1\n";
    const PointCloud seen = read("a.pcd", pcd(bare, picture, "VIEWPOINT 1 -2 0.5 0 1 0 0\n")).cloud;
    ASSERT_EQ(seen.viewpoints.size(), 1u);
    EXPECT_EQ(seen.viewpoints[0].place, Vec3d(1, -2, 0.5));
    EXPECT_FALSE(seen.viewpoints[0].distant);
    EXPECT_EQ(seen.seenFrom, std::vector<std::uint32_t>(3, 0));
    // The format's default.
    EXPECT_EQ(read("b.pcd", pcd(bare, picture, "")).cloud.viewpoints.at(0).place, Vec3d(0, 0, 0));
    // A list may have been put together, normals say more, and the user knows better.
    EXPECT_TRUE(read("c.pcd", pcd(bare, list, "VIEWPOINT 1 2 3 1 0 0 0\n")).cloud.seenFrom.empty());
    EXPECT_TRUE(read("d.pcd", pcd(oriented, picture, "")).cloud.seenFrom.empty());
    Interrupter progress;
    EXPECT_EQ(readPoints({path("a.pcd")}, BadPoints::Drop, {Vec3d(0, 0, 9)}, {}, &progress)
                  .cloud.viewpoints.at(0)
                  .place,
              Vec3d(0, 0, 9));
    EXPECT_THROW(read("e.pcd", pcd(bare, picture, "VIEWPOINT 1 2\n")), InputError);
}

TEST_F(IoTest, RangeGridsLeaveOutJumpsAndFadeTowardsTheBorder)
{
    const int n = 30;
    std::string vertices, grid;
    for (int r = 0; r < n; ++r)
        for (int c = 0; c < n; ++c) {
            const double z = c < n / 2 ? 0.1 * c : 40; // a slope, a jump, a face-on plane
            vertices +=
                concat(std::to_string(c), " ", std::to_string(r), " ", std::to_string(z), "\n");
            grid += concat("1 ", std::to_string(r * n + c), "\n");
        }
    const PointCloud cloud =
        read("g.ply",
             "ply\nformat ascii 1.0\nobj_info num_cols 30\nobj_info num_rows 30\n"
             "element vertex 900\nproperty float x\nproperty float y\nproperty float z\n"
             "element range_grid 900\nproperty list uchar int vertex_indices\nend_header\n" +
                 vertices + grid)
            .cloud;
    ASSERT_EQ(cloud.size(), 900u);
    const auto at = [&](int c, int r) { return std::size_t(r * n + c); };
    const Vec3f slope = Vec3f(-0.1f, 0, 1).normalized();
    EXPECT_LT((cloud.normals[at(14, 9)] - slope).norm(), 1e-5);
    EXPECT_LT((cloud.normals[at(15, 9)] - Vec3f::UnitZ()).norm(), 1e-6);
    EXPECT_FLOAT_EQ(cloud.confidence[at(22, 15)], 1);
    EXPECT_NEAR(cloud.confidence[at(7, 15)], slope.z(), 1e-6);
    for (int step = 0; step < 5; ++step) {
        EXPECT_NEAR(cloud.confidence[at(15 + step, 15)], 0.2 * (step + 1), 1e-6);
        EXPECT_NEAR(cloud.confidence[at(14 - step, 15)], 0.2 * (step + 1) * slope.z(), 1e-6);
        EXPECT_NEAR(cloud.confidence[at(22, step)], 0.2 * (step + 1), 1e-6);
    }
}

TEST_F(IoTest, ScanSetsAreTransformedByTheInverseRotation)
{
    put("a.xyz", "1 0 0 1 0 0\n2 0 0 0 1 0\n");
    const double s = std::sqrt(0.5); // a quarter turn about z, of which the inverse is meant
    const PointInput input =
        read("set.conf", concat("# c\ncamera 0 0 0 0 0 0 1\nmesh cylinder 0 0 0 0 0 0 1\n"
                                "bmesh a.xyz 10 20 30 0 0 ",
                                std::to_string(s), " ", std::to_string(s), "\n"));
    expectWorld(input.cloud, 0, Vec3d(10, 19, 30));
    expectWorld(input.cloud, 1, Vec3d(10, 18, 30));
    EXPECT_LT((input.cloud.normals[0] + Vec3f::UnitY()).norm(), 1e-6);
    ASSERT_EQ(input.notes.size(), 1u);
    EXPECT_NE(input.notes[0].find("cylinder"), std::string::npos);
    Interrupter progress;
    EXPECT_THROW(readPoints({put("b.conf", "bmesh none.ply 0 0 0 0 0 0 1\n")}, BadPoints::Drop, {},
                            {}, &progress),
                 IoError);
}

TEST_F(IoTest, InputsJoin)
{
    Interrupter progress;
    const auto a = put("a.xyz", "0 0 0 0 0 1\n1 0 0 0 0 1\n"),
               b = put("b.xyz", "5 5 5 1 0 0\n7 5 5 1 0 0\n");
    const auto c = put("c.xyz", "8 8 8\n9 9 9\n");
    const PointInput ab = readPoints({a, b}, BadPoints::Drop, {}, {}, &progress);
    EXPECT_EQ(ab.cloud.normals.size(), 4u);
    expectWorld(ab.cloud, 2, Vec3d(5, 5, 5));
    const PointInput ac = readPoints({a, c}, BadPoints::Drop, {}, {}, &progress);
    EXPECT_EQ(ac.cloud.size(), 4u);
    EXPECT_FALSE(ac.cloud.hasNormals());
    ASSERT_EQ(ac.notes.size(), 1u);
    EXPECT_NE(ac.notes[0].find("c.xyz"), std::string::npos);
}

TEST_F(IoTest, BadPointsAreCountedByReason)
{
    const std::string s =
        "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\n"
        "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
        "property float confidence\nend_header\n0 0 0 0 0 1 4\nnan 0 0 0 0 1 1\n"
        "1 0 0 0 0 0 1\n1 0 0 nan 0 0 1\n1e20 0 0 0 0 1 1\n2 0 0 0 0 3 0\n"
        "3 0 0 0 0 3 2\n3 0 0 0 0 3 2\n3 0 0 0 0 -3 2\n";
    const PointInput input = read("bad.ply", s);
    const std::map<std::string, std::uint64_t> expected = {
        {"not finite", 1}, {"zero normal", 1},     {"normal not finite", 1},
        {"too far", 1},    {"zero confidence", 1}, {"duplicate", 1}};
    EXPECT_EQ(input.dropped, expected);
    EXPECT_EQ(input.cloud.confidence, (std::vector<float>{1, 0.5f, 0.5f}));
    EXPECT_NE(error("bad.ply", s, BadPoints::Fail).find("bad.ply: vertex 1: not finite (1 of 9"),
              std::string::npos);
}

TEST_F(IoTest, AFarPointDoesNotCostTheOthersTheirPrecision)
{
    std::string s;
    for (int i = 0; i < 1000; ++i)
        s += concat(std::to_string(i % 10), " ", std::to_string(i / 10 % 10), " ",
                    std::to_string(i / 100), ".125\n");
    const PointInput input = read("far.xyz", s + "1e12 0 0\n0 -1e9 0\n");
    EXPECT_EQ(input.dropped.at("too far"), 2u);
    EXPECT_EQ(input.cloud.size(), 1000u);
    expectWorld(input.cloud, 1, Vec3d(1, 0, 0.125));
}

TEST_F(IoTest, EmptyAttributesAreIgnored)
{
    const PointInput input = read(
        "zero.ply", "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                    "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
                    "property float quality\nend_header\n0 0 0 0 0 0 0\n1 0 0 0 0 0 0\n");
    EXPECT_EQ(input.cloud.size(), 2u);
    EXPECT_FALSE(input.cloud.hasNormals());
    EXPECT_TRUE(input.cloud.confidence.empty());
    EXPECT_EQ(input.notes.size(), 2u);
}

// Half of the points twice, enough of them that hashing works in several parts.
TEST_F(IoTest, CopiesAreLeftOutWhateverTheirOrder)
{
    std::vector<std::string> lines;
    for (int i = 0; i < 40000; ++i)
        for (int copy = 0; copy < 1 + i % 2; ++copy)
            lines.push_back(
                concat(std::to_string(i % 199), " ", std::to_string(i / 199), " 0.5\n"));
    for (int pass = 0; pass < 2; ++pass) {
        std::string s;
        for (const std::string& line : lines) s += line;
        const PointInput input = read("twice.xyz", s);
        EXPECT_EQ(input.cloud.size(), 40000u);
        EXPECT_EQ(input.dropped.at("duplicate"), 20000u);
        std::reverse(lines.begin(), lines.end());
    }
}

TEST_F(IoTest, PointsSurviveARoundTrip)
{
    PointCloud cloud;
    cloud.frame = Vec3d(500000.125, -4e6, 17);
    for (int i = 0; i < 5000; ++i) {
        cloud.positions.emplace_back(float(i % 17) - 8, float(i % 29) - 14, 0.01f * float(i) - 25);
        cloud.normals.push_back(Vec3f(1, float(i % 7), -2).normalized());
        cloud.confidence.push_back(float(i % 8 + 1) / 8);
        cloud.colors.push_back({std::uint8_t(i), std::uint8_t(i / 3), 1});
    }
    for (const char* name : {"a.ply", "a.xyz"}) {
        Interrupter progress;
        writePoints(path(name), cloud, &progress);
        const PointCloud back = readPoints({path(name)}, BadPoints::Fail, {}, {}, &progress).cloud;
        ASSERT_EQ(back.size(), cloud.size());
        const bool ply = std::string(name) == "a.ply";
        if (ply) {
            EXPECT_EQ(back.confidence, cloud.confidence);
            EXPECT_EQ(back.colors, cloud.colors);
        }
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            ASSERT_LT((back.world(i) - cloud.world(i)).norm(), 5e-6);
            ASSERT_LT((back.normals[i] - cloud.normals[i]).norm(), 2e-7);
        }
    }
    Interrupter progress;
    EXPECT_THROW(writePoints(path("a.las"), cloud, &progress), UsageError);
}

TEST_F(IoTest, MeshesSurviveARoundTrip)
{
    Mesh mesh;
    for (const double far : {0.0, 3e6}) {
        mesh.frame = Vec3d::Constant(far);
        mesh.positions = {Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0), Vec3f(0, 0, 1.0625f)};
        mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
        for (const char* name : {"m.ply", "m.obj", "m.stl"}) {
            if (far > 0 && std::string(name) == "m.stl") continue; // floats only
            Interrupter progress;
            writeMesh(path(name), mesh, {}, &progress);
            const PointCloud back =
                readPoints({path(name)}, BadPoints::Fail, {}, {}, &progress).cloud;
            ASSERT_EQ(back.size(), 4u) << name;
            Box3d box;
            for (std::size_t i = 0; i < 4; ++i) box.extend(back.world(i));
            EXPECT_LT((box.max() - mesh.frame - Vec3d(1, 1, 1.0625)).norm(), 1e-6) << name;
            EXPECT_GT(back.normals[0].cwiseAbs().maxCoeff(), 0.5);
        }
    }
    Interrupter progress;
    EXPECT_THROW(writeMesh(path("m.xyz"), mesh, {}, &progress), UsageError);
}

} // namespace
} // namespace mpuvdb::test
