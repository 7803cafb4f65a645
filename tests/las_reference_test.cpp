// LAS files of degrees are refused by their own description, in every form that it has.
#include "case_files.h"
#include "io_fixture.h"

namespace mpuvdb::test
{
namespace
{

struct Record {
    std::uint16_t id;
    std::string bytes;
};

using Numbers = std::vector<std::uint16_t>;

/// GeoTIFF keys whose values stand beside them.
Record keys(const std::vector<std::pair<int, int>>& values)
{
    Numbers numbers = {1, 1, 0, std::uint16_t(values.size())};
    for (const auto& [key, value] : values)
        numbers.insert(numbers.end(), {std::uint16_t(key), 0, 1, std::uint16_t(value)});
    std::string bytes;
    for (const std::uint16_t n : numbers) bytes += bytesOf(n);
    return {34735, bytes};
}

/// A file of four points with the records before them, or, in version 1.4, behind.
std::string las(const std::vector<Record>& records, int minor, bool behind, bool prefersText)
{
    std::string before, after;
    for (const Record& record : records) {
        std::string head =
            std::string(2, '\0') + "LASF_Projection" + std::string(1, '\0') + bytesOf(record.id);
        head += behind ? bytesOf(std::uint64_t(record.bytes.size()))
                       : bytesOf(std::uint16_t(record.bytes.size()));
        (behind ? after : before) += head + std::string(32, '\0') + record.bytes;
    }
    const std::size_t size = minor >= 4 ? 375 : 227;
    std::string s(size, '\0');
    const auto set = [&](std::size_t at, const std::string& bytes) {
        s.replace(at, bytes.size(), bytes);
    };
    set(0, "LASF");
    s[6] = char(prefersText ? 0x10 : 0);
    s[24] = 1;
    s[25] = char(minor);
    set(94, bytesOf(std::uint16_t(size)));
    set(96, bytesOf(std::uint32_t(size + before.size())));
    set(100, bytesOf(std::uint32_t(behind ? 0 : records.size())));
    set(105, bytesOf(std::uint16_t(20)));
    set(107, bytesOf(std::uint32_t(4)));
    for (int a = 0; a < 3; ++a) set(131 + 8 * a, bytesOf(0.01));
    if (minor >= 4) {
        set(235, bytesOf(std::uint64_t(size + before.size() + 80)));
        set(243, bytesOf(std::uint32_t(behind ? records.size() : 0)));
    }
    std::string points;
    for (int i = 0; i < 4; ++i)
        points += concat(bytesOf(std::int32_t(100 * i)), bytesOf(std::int32_t(i * i)),
                         bytesOf(std::int32_t(7)), std::string(8, '\0'));
    return s + before + points + after;
}

const char* const kWgs84 =
    "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]";

class LasReference : public IoTest
{
protected:
    void expectDegrees(const std::vector<Record>& records, bool prefersText = true)
    {
        for (const bool behind : {false, true}) {
            const std::string message = error("a.las", las(records, 4, behind, prefersText));
            EXPECT_NE(message.find("degrees"), std::string::npos) << message;
            EXPECT_NE(message.find("pdal translate"), std::string::npos) << message;
        }
        EXPECT_NE(error("b.las", las(records, 2, false, prefersText)).find("degrees"),
                  std::string::npos);
    }
    void expectLengths(const std::vector<Record>& records, bool prefersText = true)
    {
        for (const bool behind : {false, true})
            EXPECT_EQ(read("c.las", las(records, 4, behind, prefersText)).cloud.size(), 4u);
        EXPECT_EQ(read("d.las", las(records, 3, false, prefersText)).cloud.size(), 4u);
    }
    static Record text(const std::string& wkt) { return {2112, wkt + std::string(1, '\0')}; }
};

TEST_F(LasReference, OfDegreesInKeys)
{
    expectDegrees({keys({{1024, 2}, {2048, 4326}})}, false);
    expectDegrees({keys({{2048, 4269}, {4096, 5703}})}, false); // without a model
    expectLengths({keys({{1024, 1}, {2048, 4326}, {3072, 32633}})}, false);
    expectLengths({keys({{2048, 4326}, {3072, 32633}})}, false);
    expectLengths({keys({{1024, 3}, {2048, 4978}})}, false); // geocentric
    expectLengths({keys({{4096, 5703}})}, false);            // heights only
    expectLengths({{34735, std::string(3, '\1')}}, false);
    expectLengths({}, false);
}

TEST_F(LasReference, OfDegreesInWellKnownText)
{
    const std::string wgs84 = kWgs84;
    expectDegrees({text(wgs84)});
    expectDegrees(
        {text("COMPD_CS[\"both\"," + wgs84 + ",VERT_CS[\"EGM96\",VERT_DATUM[\"g\",2005]]]")});
    expectDegrees({text("GEOGCRS [ \"WGS 84\", DATUM[\"d\",ELLIPSOID[\"e\",6378137,298.2]],"
                        "CS[ellipsoidal,2],AXIS[\"lat\",north],AXIS[\"lon\",east]]")});
    expectDegrees({text("GEODCRS[\"WGS 84\",DATUM[\"d\",ELLIPSOID[\"e\",6378137,298.2]],"
                        "CS[ellipsoidal,3]]")});
    expectDegrees({text("COMPOUNDCRS[\"c\",GEOGCRS[\"WGS 84\"],VERTCRS[\"PROJCS[no]\"]]")});
    expectDegrees({text("BOUNDCRS[SOURCECRS[GEOGCRS[\"NAD83\"]],TARGETCRS[PROJCRS[\"x\"]]]")});
    expectDegrees({text("geogcs(\"WGS 84\")")});
}

TEST_F(LasReference, OfLengthsInWellKnownText)
{
    const std::string wgs84 = kWgs84;
    const std::string utm = "PROJCS[\"WGS 84 / UTM 33N\"," + wgs84 + ",PROJECTION[\"TM\"]]";
    expectLengths({text(utm)});
    expectLengths({text("COMPD_CS[\"both\"," + utm + ",VERT_CS[\"EGM96\"]]")});
    expectLengths({text("PROJCRS[\"u\",BASEGEOGCRS[\"WGS 84\"],CONVERSION[\"c\"]]")});
    expectLengths({text("BOUNDCRS[SOURCECRS[PROJCRS[\"u\"]],TARGETCRS[GEOGCRS[\"WGS 84\"]]]")});
    expectLengths({text("GEOCCS[\"WGS 84\",DATUM[\"d\"]]")});
    expectLengths({text("GEODCRS[\"WGS 84\",DATUM[\"d\"],CS[Cartesian,3]]")});
    expectLengths({text("LOCAL_CS[\"site, in GEOGCS[ of old\"]")});
    expectLengths({text("GEOGCS")});
    expectLengths({text("\"GEOGCS[")});
    expectLengths({text("")});
    // The header says which description counts.
    const Record degrees = keys({{1024, 2}, {2048, 4326}});
    expectLengths({degrees, text(utm)}, true);
    expectDegrees({degrees, text(utm)}, false);
}

TEST_F(LasReference, RecordsThatGoBeyondTheFile)
{
    std::string file = las({keys({{1024, 2}})}, 4, true, false);
    for (std::size_t at = 200; at < file.size(); at += 7) {
        std::string cut = file;
        cut[at] = char(0xff);
        put("a.las", cut);
        try {
            Interrupter progress;
            readPoints({path("a.las")}, BadPoints::Drop, {}, {}, &progress);
        } catch (const Error&) {
        }
    }
}

TEST_F(LasReference, OfTheCaseIsRefused)
{
    MPUVDB_CASE(degrees, "T13-degrees.las");
    MPUVDB_CASE(meters, "T14-classes.las");
    Interrupter progress;
    EXPECT_THROW(readPoints({degrees}, BadPoints::Drop, {}, {}, &progress), InputError);
    EXPECT_EQ(readPoints({meters}, BadPoints::Drop, {}, {}, &progress).cloud.size(), 3000u);
}

} // namespace
} // namespace mpuvdb::test
