// Headers: what they name is taken, or refused where it is no position; prose is neither.
#include "case_files.h"
#include "io_fixture.h"

namespace mpuvdb::test
{
namespace
{

class ColumnNamesTest : public IoTest
{
protected:
    /// Rows of @a columns numbers, the last three of which are a position.
    static std::string rows(std::size_t columns, const std::string& separator)
    {
        std::string text;
        for (int i = 0; i < 9; ++i) {
            for (std::size_t c = 0; c + 3 < columns; ++c)
                text += concat(std::to_string(1000 * i + int(c)), separator);
            text += concat(std::to_string(i % 3), ".5", separator, std::to_string(i / 3), separator,
                           "7.25\n");
        }
        return text;
    }
    void expectRefused(const std::string& text, const std::string& listed, bool degrees = false)
    {
        SCOPED_TRACE(text.substr(0, text.find('\n')));
        const std::string message = error("a.txt", text);
        EXPECT_NE(message.find("names the columns"), std::string::npos) << message;
        EXPECT_NE(message.find("'" + listed + "'"), std::string::npos) << message;
        EXPECT_NE(message.find("x, y and z"), std::string::npos) << message;
        EXPECT_EQ(message.find("degrees") != std::string::npos, degrees) << message;
    }
    void expectPosition(const std::string& text, const Vec3d& first = Vec3d(0.5, 0, 7.25))
    {
        SCOPED_TRACE(text.substr(0, text.find('\n')));
        const PointCloud cloud = read("a.txt", text).cloud;
        ASSERT_EQ(cloud.size(), 9u);
        EXPECT_LT((cloud.world(0) - first).norm(), 1e-6);
    }
};

TEST_F(ColumnNamesTest, WithoutAPositionAreRefused)
{
    expectRefused("# ID TIME RANGE AZIMUTH\n" + rows(4, " "), "RANGE");
    expectRefused("#id;time;amplitude;range;phase\n" + rows(5, ";"), "phase");
    expectRefused("// shot_id, gps time, amplitude, range\n" + rows(4, ","), "gps time");
    expectRefused("% range azimuth elevation\n" + rows(3, " "), "azimuth");
    expectRefused("; time range intensity angle\n" + rows(4, "\t"), "intensity");
    expectRefused("\xef\xbb\xbf\"time\",\"range\",\"angle\"\n" + rows(3, ","), "range");
    expectRefused("foo\tbar\tquux\n" + rows(3, "\t"), "quux");
    expectRefused("X Y intensity range\n" + rows(4, " "), "intensity");
    expectRefused("# scanned by A\n# x y range intensity\n" + rows(4, " "), "range");
    expectRefused("# u v w\n" + rows(3, " "), "w");
}

TEST_F(ColumnNamesTest, OfDegreesAreRefusedWithTheCure)
{
    expectRefused("longitude,latitude,elevation\n" + rows(3, ","), "latitude", true);
    expectRefused("Lon;Lat;Height;Code\n" + rows(4, ";"), "Lat", true);
    expectRefused("# lat lon alt\n" + rows(3, " "), "lon", true);
    expectRefused("# LFID TIME LONGITUDE_LOW LATITUDE_LOW Z_LOW\n" + rows(5, " "), "TIME", true);
    expectRefused("x (deg)\ty (deg)\tz (m)\n" + rows(3, "\t"), "y (deg)", true);
    EXPECT_NE(error("a.csv", "lon,lat,h\n" + rows(3, ",")).find("reprojection"), std::string::npos);
    // Whoever has both, has lengths.
    expectPosition("lon lat x y z\n" + rows(5, " "));
}

TEST_F(ColumnNamesTest, OfPositionsAreFoundWhereTheyAre)
{
    expectPosition("id,x,y,z\n" + rows(4, ","));
    expectPosition(",x,y,z\n" + rows(4, ",")); // an index without a name
    expectPosition("//Original cloud index,Scalar field #1,X,Y,Z\n" + rows(5, ","));
    expectPosition("# x y z are what the last columns hold\n# time X(m) Y(m) Z(m)\n" +
                   rows(4, " "));
    expectPosition("Point;Easting;Northing;Elevation\n" + rows(4, ";"));
    expectPosition("\"Code\"\t\"E (m)\"\t\"N (m)\"\t\"H (m)\"\n" + rows(4, "\t"));
    expectPosition("% intensity x y z\n" + rows(4, " "));
    expectPosition("# intensity x y z\n# made by a scanner of mine\n" + rows(4, " "));
    EXPECT_NE(error("a.txt", "id x y z\n" + rows(5, " ")).find("names 4 columns"),
              std::string::npos);
    EXPECT_NE(error("a.csv", "x,y,z\n1,5,2,5,3,5\n1,5,3,5,3,5\n").find("decimal comma"),
              std::string::npos);
}

// With the height and the northing first, where names tell.
TEST_F(ColumnNamesTest, OfOtherLanguagesAreFound)
{
    expectPosition("Punkt;Rechtswert;Hochwert;H\xc3\xb6he\n" + rows(4, ";"));
    expectPosition("Nr\tOSTWERT (m)\tNORDWERT (m)\tH\xd6HE (m)\n" + rows(4, "\t")); // Latin-1
    expectPosition("Hochwert Rechtswert Hoehe\n0 0.5 7.25\n" + rows(3, " ").substr(11),
                   Vec3d(0.5, 0, 7.25));
    expectPosition("Est;Nord;Altitude\n" + rows(3, ";"));
    expectPosition("id,Este,Norte,Cota\n" + rows(4, ","));
    expectPosition("Est (m),Nord (m),Quota (m)\n" + rows(3, ","));
    expectPosition("# n Este Norte Elevaci\xc3\xb3n\n" + rows(4, " "));
    expectPosition("# Este Norte Elevacio\xcc\x81n\n" + rows(3, " ")); // a letter and its accent
    expectPosition("x;y;H\xc3\xb6he\n" + rows(3, ";"));
    // What is half a position in any language is none, nor is a length, or a degree.
    expectRefused("Rechtswert;H\xc3\xb6he;Code\n" + rows(3, ";"), "H\xc3\xb6he");
    expectRefused("L\xc3\xa4nge;Breite;H\xc3\xb6he\n" + rows(3, ";"), "L\xc3\xa4nge");
    expectRefused("Latitud,Longitud,Altura\n" + rows(3, ","), "Altura", true);
    expectRefused("Este Oeste Cota\n" + rows(3, " "), "Oeste");
}

TEST_F(ColumnNamesTest, OfColorsInOtherLanguagesAreFound)
{
    const auto colors = [&](const std::string& header) {
        SCOPED_TRACE(header);
        return read("a.csv", header + "\n1;2;3;10;20;30\n4;5;6;40;50;255\n").cloud.colors;
    };
    const std::vector<PointCloud::Rgb> expected = {{10, 20, 30}, {40, 50, 255}};
    for (const char* names :
         {"Rot;Gr\xc3\xbcn;Blau", "ROT;GR\xc3\x9cN;BLAU", "rot;gr\xfcn;blau", "Rot;Gruen;Blau",
          "rot;Grun;blau", "rot;gru\xcc\x88n;blau", "rouge;vert;bleu", "Rouge;Vert;Bleu",
          "rojo;verde;azul", "rosso;verde;blu", "rood;groen;blauw", "vermelho;verde;azul",
          "Red;Gr\xc3\xbcn;Blau", "Rot (0-255);Gr\xc3\xbcn (0-255);Blau (0-255)",
          "\"Rot\";\"Gr\xc3\xbcn\";\"Blau\""}) {
        EXPECT_EQ(colors(concat("x;y;z;", names)), expected);
        EXPECT_EQ(colors(concat("Rechtswert;Hochwert;H\xc3\xb6he;", names)), expected);
        EXPECT_EQ(colors(concat("# Est (m);Nord (m);Altitude (m);", names)), expected);
    }
    for (const char* names : {"rot;vert;speed", "rot x;rot y;rot z", "Rotation;Gr\xc3\xbcn;Blau"})
        EXPECT_TRUE(colors(concat("x;y;z;", names)).empty());
    // What is asked for by its name is no color.
    Interrupter progress;
    const auto file = put("s.csv", "x;y;z;Rot;Gr\xc3\xbcn;Blau\n1;2;3;10;20;30\n4;5;6;40;50;255\n");
    const PointInput input = readPoints({file}, BadPoints::Drop, {}, {"Rot"}, &progress);
    EXPECT_TRUE(input.cloud.colors.empty());
    EXPECT_EQ(input.cloud.scalars.at(0).values, (std::vector<float>{10, 40}));
}

TEST_F(ColumnNamesTest, OfVectorsComponentsAreFound)
{
    expectPosition("\"Points:0\",\"Points:1\",\"Points:2\"\n" + rows(3, ","));
    expectPosition("scalar,Points_Magnitude,Points_0,Points_1,Points_2\n" + rows(5, ","));
    expectPosition("id;P[x];P[y];P[z]\n" + rows(4, ";"));
    expectPosition("ptnum P.x P.y P.z\n" + rows(4, " "));
    expectPosition("Points:0,Points:1,Other:0,x,y,z\n" + rows(6, ",")); // usual names come first
    expectRefused("Points:0,Points:1,Normals:2\n" + rows(3, ","), "Normals:2");
    expectRefused("Points:0,P[y],Points:2\n" + rows(3, ","), "P[y]");
    const PointCloud cloud =
        read("a.csv", "Normals:0,Normals:1,Normals:2,Points:0,Points:1,Points:2,Cd[r],Cd[g],Cd[b]\n"
                      "0,0,1,1,2,3,0.2,0.4,1\n0,1,0,4,5,6,0,0,0\n")
            .cloud;
    ASSERT_EQ(cloud.size(), 2u);
    EXPECT_LT((cloud.world(1) - Vec3d(4, 5, 6)).norm(), 1e-6);
    ASSERT_TRUE(cloud.hasNormals());
    EXPECT_EQ(cloud.normals[0], Vec3f::UnitZ());
    EXPECT_EQ(cloud.colors.at(0), (PointCloud::Rgb{51, 102, 255}));
}

// Characters as they are, but for those that move or hide others.
TEST_F(ColumnNamesTest, AreShownAsTheyAreWritten)
{
    const auto shown = [&](const std::string& name) {
        const std::string message = error("a.csv", concat("time,range,", name, "\n1,2,3\n"));
        const std::size_t from = message.find("'range', ");
        return from == std::string::npos
                   ? message
                   : message.substr(from + 9, message.find(", but") - from - 9);
    };
    for (const char* name : {"H\xc3\xb6he", "\xe9\xab\x98\xe3\x81\x95", "\xf0\x9f\x93\x8f m", "~"})
        EXPECT_EQ(shown(concat("a", name)), concat("'a", name, "'"));
    EXPECT_EQ(shown("a\xf6k"), "'a?k'");                    // Latin-1
    EXPECT_EQ(shown("a\xc3"), "'a?'");                      // cut off
    EXPECT_EQ(shown("a\xc0\xafk"), "'a??k'");               // of more bytes than it needs
    EXPECT_EQ(shown("a\xed\xa0\x80k"), "'a???k'");          // half a pair of UTF-16
    EXPECT_EQ(shown("a\x1b[31mb\x7f"), "'a?[31mb?'");       // a terminal's commands
    EXPECT_EQ(shown("a\xc2\x9bk\xe2\x80\xaem"), "'a?k?m'"); // in one character, and backwards
    std::string many = "a", first = "'a";
    for (int i = 0; i < 60; ++i) many += "\xc3\xb6";
    for (int i = 0; i < 39; ++i) first += "\xc3\xb6";
    EXPECT_EQ(shown(many), first + "...'");
}

// The same number of words as of columns makes no header of a sentence.
TEST_F(ColumnNamesTest, AreNoneInProse)
{
    for (const char* prose :
         {"# exported by CloudCompare 2.13", "# 12 points from scanner A", "# made by me",
          "# Scan of bunny", "# Stanford bunny scan", "# Scanner B raw data",
          "# Terrain map near Zurich", "// created in the lab", "# http://example.org/x.zip", "#",
          "#---", "# Time of flight camera", "# bunny, scanned in May, by me",
          "# Column meanings: as usual.", "# VERSION 1.0 FINAL", "# Units: m", "# points"})
        for (const std::size_t columns : {3, 4, 5, 6}) {
            std::string text = prose + std::string("\n");
            for (int i = 0; i < 9; ++i) {
                text += concat(std::to_string(i % 3), ".5 ", std::to_string(i / 3), " 7.25");
                for (std::size_t c = 3; c < columns; ++c) text += " 1234.5";
                text += "\n";
            }
            expectPosition(text);
        }
}

// Comments of other marks than # and //, as they stand before names and rows, and between rows.
TEST_F(ColumnNamesTest, MayFollowCommentsOfAnyMark)
{
    for (const std::string mark : {";", ";;", "; ", " ;", "%", "!", "% ", "#"})
        for (const char* said :
             {"a", "a scan of mine", "made by me", "12 points", "2024-05-01", "p 1 2 3",
              "made by A; in meters", "x right, y ahead and z up", "---;---;---;"}) {
            const std::string comment = concat(mark, said, "\n");
            expectPosition(comment + rows(3, " "));
            expectPosition(concat(comment, mark, "\n", comment, comment, rows(3, ",")));
            expectPosition(comment + rows(3, ";"));
            expectPosition(concat(comment, "9\n", rows(3, " ")));
            expectPosition(concat(comment, "x;y;z\n", rows(3, ";")));
            const bool isName = mark[0] == '%' || mark[0] == '!'; // in the first column
            expectPosition(concat(comment, "id,x,y,z\n", isName ? "" : comment, rows(4, ",")));
            const std::string some = rows(4, "\t");
            const std::size_t half = some.find('\n') + 1;
            expectPosition(concat("id x y z\n", some.substr(0, half), comment, some.substr(half)));
        }
    // Names in a comment, before others.
    expectPosition("; intensity x y z\n; made by me\n" + rows(4, " "));
    expectPosition("% made by me\n% intensity x y z\n" + rows(4, " "));
    expectRefused("; made by me\n; time range intensity angle\n" + rows(4, " "), "intensity");
    // A ';' that separates fields, the first of which are empty.
    const auto count = [&](const std::string& text) { return read("b.csv", text).cloud.size(); };
    EXPECT_EQ(count(";x;y;z\np1;1;2;3\n;4;5;6\n"), 2u);
    EXPECT_EQ(count("name;x;y;z;note\n;1;2;3;a\n;4;5;6;b\n"), 2u);
    EXPECT_EQ(count("; made by me\nname;x;y;z;note\n;1;2;3;a\n;4;5;6;b\n"), 2u);
    EXPECT_EQ(count("name,x,y,z\n%a,1,2,3\n!b,4,5,6\n"), 2u);
    EXPECT_EQ(count(";1;2;3\n;4;5;6\n"), 2u);
    EXPECT_NE(error("c.csv", "1;2;3\n;b;6\n").find("line 2"), std::string::npos);
}

TEST_F(ColumnNamesTest, OfTheCasesAreRefusedOrTaken)
{
    MPUVDB_CASE(lvis, "T16-lvis-header.txt");
    MPUVDB_CASE(survey, "T17-easting-northing.csv");
    MPUVDB_CASE(compare, "T10-cloudcompare-commas.txt");
    Interrupter progress;
    try {
        readPoints({lvis}, BadPoints::Drop, {}, {}, &progress);
        ADD_FAILURE() << "shot number and time are no coordinates";
    } catch (const InputError& e) {
        EXPECT_NE(std::string(e.what()).find("'SHOTNUMBER'"), std::string::npos) << e.what();
        EXPECT_NE(std::string(e.what()).find("degrees"), std::string::npos) << e.what();
    }
    EXPECT_EQ(readPoints({survey}, BadPoints::Drop, {}, {}, &progress).cloud.size(), 1500u);
    EXPECT_TRUE(readPoints({compare}, BadPoints::Drop, {}, {}, &progress).cloud.hasNormals());
}

} // namespace
} // namespace mpuvdb::test
