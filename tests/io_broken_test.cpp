// Broken files of every kind end in an error that says so, never in a crash.
#include "io_fixture.h"

#include <random>

namespace mpuvdb::test
{
namespace
{

// Reads whatever it is. @return whether it gave points; anything thrown must be an Error.
bool readsOrFails(const std::filesystem::path& file)
{
    Interrupter progress;
    try {
        const PointInput input = readPoints({file}, BadPoints::Drop, {}, {}, &progress);
        for (const Vec3f& p : input.cloud.positions) EXPECT_TRUE(p.allFinite());
        for (const Vec3f& n : input.cloud.normals) EXPECT_NEAR(n.norm(), 1, 1e-5);
        for (const float c : input.cloud.confidence) EXPECT_TRUE(c > 0 && c <= 1);
        return true;
    } catch (const Error& e) {
        EXPECT_GT(std::strlen(e.what()), 10u);
        return false;
    }
}

TEST_F(IoTest, TruncatedAtEveryByte)
{
    for (const Sample& sample : samples()) {
        SCOPED_TRACE(sample.name);
        for (std::size_t bytes = 0; bytes < sample.bytes.size(); ++bytes)
            readsOrFails(put(sample.name, sample.bytes.substr(0, bytes)));
        // Formats that say how many points they hold notice that its end is missing.
        const bool counts = sample.name.find(".xyz") == std::string::npos &&
                            sample.name != "tagged.pts" && sample.name != "named.csv" &&
                            sample.name.find(".obj") == std::string::npos;
        if (counts) {
            const std::size_t most = sample.bytes.size() * 9 / 10;
            EXPECT_FALSE(readsOrFails(put(sample.name, sample.bytes.substr(0, most))));
        }
    }
}

TEST_F(IoTest, AbsurdCountsAreRefusedWithoutTakingMemory)
{
    for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"})
        EXPECT_NE(error("a.ply", concat("ply\nformat ", format,
                                        " 1.0\nelement vertex 999999999999\nproperty float x\n"
                                        "property float y\nproperty float z\nend_header\n0 0 0\n"))
                      .find("999999999999"),
                  std::string::npos);
    EXPECT_NE(error("l.ply", concat("ply\nformat binary_little_endian 1.0\nelement face 1\n"
                                    "property list uint int vertex_indices\nelement vertex 1\n"
                                    "property float x\nproperty float y\nproperty float z\n"
                                    "end_header\n",
                                    bytesOf(0xfffffff0u), std::string(40, ' ')))
                  .find("4294967280"),
              std::string::npos);
    error("a.off", "OFF\n999999999999 1 0\n0 0 0\n");
    error("a.pts", "999999999999\n0 0 0\n1 1 1\n");
    error("a.ptx",
          "99999999999\n99999999999\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n"
          "0 0 0 1\n1 1 1 1\n");
    error("a.pcd", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 999999999\nHEIGHT "
                   "999999999\nDATA binary\n0123456789ab");
    error("b.pcd", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 99999999\nDATA "
                   "binary_compressed\n0123456789ab");
    error("a.stl", std::string(80, ' ') + "\xff\xff\xff\x7f" + std::string(60, ' '));
}

TEST_F(IoTest, TheMessageSaysWhere)
{
    const std::string head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                             "property float y\nproperty float z\nend_header\n";
    EXPECT_NE(
        error("t.ply", head + "0 0 0\n0 abc 0\n0 0 0\n").find("vertex 1 (line 9): y is 'abc'"),
        std::string::npos);
    EXPECT_NE(error("t.ply", head + "0 0 0\n0 0\n0 0 0\n").find("vertex 1 (line 9): z is missing"),
              std::string::npos);
    EXPECT_NE(error("t.ply", head + "0 0 0 5\n0 0 0\n0 0 0\n").find("more values"),
              std::string::npos);
    EXPECT_NE(error("t.xyz", "0 0 0\n1 2 3\n\n4 x 6\n").find("line 4"), std::string::npos);
    EXPECT_NE(error("t.xyz", "0 0 0 0 0 1\n1 2 3 0 0 1\n4 5\n").find("line 3"), std::string::npos);
    EXPECT_NE(error("t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n").find("line 4"),
              std::string::npos);
    EXPECT_NE(error("t.obj", "v 0 0 0\nv 1 z 0\n").find("line 2"), std::string::npos);
    EXPECT_NE(error("t.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n").find("line 6"),
              std::string::npos);
    EXPECT_NE(error("t.conf", "bmesh a.ply 0 0 0\n").find("line 1"), std::string::npos);
}

TEST_F(IoTest, FilesThatAreNoPoints)
{
    for (const char* name :
         {"e.ply", "e.xyz", "e.obj", "e.off", "e.stl", "e.pcd", "e.las", "e.ptx", "e.conf"}) {
        SCOPED_TRACE(name);
        EXPECT_FALSE(readsOrFails(put(name, "")));
        EXPECT_FALSE(readsOrFails(put(name, std::string(3000, '\0'))));
        EXPECT_FALSE(readsOrFails(put(name, "\n\n  \n")));
        EXPECT_FALSE(readsOrFails(put(name, "hello world\n")));
    }
    EXPECT_NE(error("a.docx", "0 0 0\n").find("no kind that can be read"), std::string::npos);
    EXPECT_NE(error("a.laz", "0 0 0\n").find("pdal"), std::string::npos);
    error("v.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
                   "property float z\nend_header\n");
    Interrupter progress;
    EXPECT_THROW(readPoints({path("missing.ply")}, BadPoints::Drop, {}, {}, &progress), IoError);
    std::filesystem::create_directories(path("folder.ply"));
    EXPECT_THROW(readPoints({path("folder.ply")}, BadPoints::Drop, {}, {}, &progress), IoError);
    EXPECT_THROW(readPoints({}, BadPoints::Drop, {}, {}, &progress), UsageError);
}

TEST_F(IoTest, AStopEndsTheReading)
{
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(readPoints({put("a.xyz", "0 0 0\n1 1 1\n")}, BadPoints::Drop, {}, {}, &progress),
                 Interrupted);
    EXPECT_THROW(writePoints(path("b.ply"), PointCloud(), &progress), Interrupted);
    EXPECT_FALSE(std::filesystem::exists(path("b.ply")));
}

// Bits flipped, bytes overwritten, pieces cut out, doubled and swapped with another file's.
std::string mutate(std::string bytes, const std::vector<Sample>& all, std::mt19937& random)
{
    const auto below = [&](std::size_t n) {
        return std::size_t(random()) % std::max<std::size_t>(n, 1);
    };
    const char* const words[] = {"-1", "nan", "1e999", "99999999999999999999", "0", "\n",
                                 " ",  "inf", "-"};
    for (std::size_t edits = 1 + below(4); edits > 0; --edits) {
        const std::size_t at = below(bytes.size()), length = 1 + below(12);
        switch (below(6)) {
        case 0:
            bytes[at] = char(bytes[at] ^ (1 << below(8)));
            break;
        case 1:
            bytes[at] = char(random());
            break;
        case 2:
            bytes.erase(at, length);
            break;
        case 3:
            bytes.insert(at, bytes.substr(below(bytes.size()), length));
            break;
        case 4:
            bytes.replace(at, length, words[below(9)]);
            break;
        default: {
            const std::string& other = all[below(all.size())].bytes;
            bytes.insert(at, other.substr(below(other.size()), 4 * length));
        }
        }
        if (bytes.empty()) bytes = "x";
    }
    return bytes;
}

TEST_F(IoTest, MutantsEndInPointsOrAnError)
{
    const std::uint32_t seed = 20240607;
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    const std::vector<Sample> all = samples();
    std::size_t read = 0;
    for (int round = 0; round < 150; ++round)
        for (const Sample& sample : all)
            read += readsOrFails(put(sample.name, mutate(sample.bytes, all, random)));
    EXPECT_GT(read, 100u); // mutants that still get past the first checks
}

/// What stands where a file was meant to be, whatever its name says.
TEST_F(IoTest, StandInsAreNamed)
{
    std::string wide;
    for (const char c : std::string("1 2 3\n4 5 6\n7 8 9\n")) wide += {c, '\0'};
    const std::pair<std::string, const char*> files[] = {
        {"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n", "git lfs pull"},
        {"\n <!DOCTYPE HTML>\n<html><body>Sign in</body></html>\n", "web page"},
        {"\xef\xbb\xbf<html>\n</html>", "web page"},
        {"<?xml version=\"1.0\"?><Error><Code>AccessDenied</Code></Error>", "XML"},
        {"ASTM-E57" + std::string(40, '\0'), "pdal translate in.e57"},
        {"PK\x03\x04" + std::string(40, '\0'), "ZIP"},
        {"\x1f\x8b\x08" + std::string(40, 'x'), "gunzip"},
        {"\xff\xfe" + wide, "UTF-16"},
        {wide, "UTF-16"},
        {std::string(1, '\0') + wide, "UTF-16"},
    };
    for (const auto& [bytes, says] : files) {
        SCOPED_TRACE(says);
        for (const char* const name : {"a.ply", "a.txt", "a.las", "a.e57"})
            EXPECT_NE(error(name, bytes).find(says), std::string::npos) << name;
        Interrupter progress;
        try {
            readLevelSet(put("a.vdb", bytes), "", 0, Validation::SignsOnly, &progress);
            ADD_FAILURE();
        } catch (const InputError& e) {
            EXPECT_NE(std::string(e.what()).find(says), std::string::npos) << e.what();
        }
    }
}

} // namespace
} // namespace mpuvdb::test
