// Rows beyond those that a header counts are said, in every format that counts.
#include "case_files.h"
#include "io_fixture.h"

namespace mpuvdb::test
{
namespace
{

const char* const kSaid = "its header says ";

/// What @a notes say of surplus rows.
std::string surplusIn(const std::vector<std::string>& notes)
{
    std::string all;
    for (const std::string& note : notes)
        if (note.find(kSaid) != std::string::npos) all += note;
    return all;
}

/// Two rows more for a sample, and what does not come to a row.
struct Tail {
    std::string name, rows, less;
};

std::vector<Tail> tails()
{
    const auto bytes = [](std::size_t row) {
        return std::pair(std::string(2 * row, '\1'), std::string(row - 1, '\1'));
    };
    std::vector<Tail> all = {
        {"ascii.ply", "5 5 5\n6 6 6\n", "\n\n"},
        {"strips.ply", "5 5 5\n6 6 6", "\n \t\n"},
        {"grid.ply", "1 0\n1 0\n", "\r\n"},
        {"rays.ptx", "5 5 -5 0.5 1 2 3\n6 6 -5 0.5 1 2 3\n", "\n"},
        {"mesh.off", "5 5 5\n6 6 6\n", "# the end\n"},
        {"normals.off", "5 5 5 0 0 1\n6 6 6 0 0 1\n", "\n"},
        {"ascii.pcd", "5 5 5 660510\n6 6 6 660510\n", "\n"},
    };
    for (const auto& [name, row] :
         std::vector<std::pair<const char*, std::size_t>>{{"little.ply", 12},
                                                          {"big.ply", 12},
                                                          {"binary.stl", 50},
                                                          {"binary.pcd", 16},
                                                          {"plain.las", 20},
                                                          {"color.las", 26},
                                                          {"new.las", 36}}) {
        all.push_back({name, bytes(row).first, bytes(row).second});
        all.push_back({name, bytes(row).first, std::string(4096, '\0')}); // a block filled up
    }
    return all;
}

Sample sampleCalled(const std::string& name)
{
    for (const Sample& sample : samples())
        if (sample.name == name) return sample;
    ADD_FAILURE() << name;
    return {};
}

/// @a text with the first @a from as @a to.
std::string with(std::string text, const std::string& from, const std::string& to)
{
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

class Surplus : public IoTest
{
};

TEST_F(Surplus, IsSaidInEveryFormatThatCounts)
{
    for (const Tail& tail : tails()) {
        SCOPED_TRACE(tail.name);
        const Sample sample = sampleCalled(tail.name);
        const PointInput more = read(sample.name, sample.bytes + tail.rows);
        EXPECT_EQ(more.cloud.size(), sample.points);
        const std::string said = surplusIn(more.notes);
        EXPECT_NE(said.find("and 2 more rows follow"), std::string::npos) << said;
        EXPECT_NE(said.find(sample.name), std::string::npos) << said;
    }
}

TEST_F(Surplus, IsNotSaidOfTheEndsThatFilesHave)
{
    for (const Sample& sample : samples()) {
        SCOPED_TRACE(sample.name);
        EXPECT_EQ(surplusIn(read(sample.name, sample.bytes).notes), "");
    }
    for (const Tail& tail : tails()) {
        SCOPED_TRACE(tail.name);
        const Sample sample = sampleCalled(tail.name);
        const PointInput padded = read(sample.name, sample.bytes + tail.less);
        EXPECT_EQ(padded.cloud.size(), sample.points);
        EXPECT_EQ(surplusIn(padded.notes), "");
    }
}

// Columns are read to their end: nothing is lost, and the count is wrong all the same.
TEST_F(Surplus, OfColumnsIsReadAndSaid)
{
    const Sample sample = sampleCalled("counted.pts");
    const PointInput input = read(sample.name, sample.bytes + "5 5 5 0 1 2 3\n6 6 6 0 1 2 3\n");
    EXPECT_EQ(input.cloud.size(), 6u);
    EXPECT_NE(surplusIn(input.notes).find("4 points, and 6 are there"), std::string::npos);
    const PointInput none = read("a.xyz", "0\n0 0 0\n1 0 0\n0 1 0\n");
    EXPECT_NE(surplusIn(none.notes).find("0 points, and 3 are there"), std::string::npos);
}

TEST_F(Surplus, NamesWhatTheHeaderSays)
{
    const auto said = [&](const std::string& name) {
        for (const Tail& tail : tails())
            if (tail.name == name)
                return surplusIn(read(name, sampleCalled(name).bytes + tail.rows).notes);
        return std::string();
    };
    EXPECT_NE(said("ascii.ply").find("'element vertex 4', 'element face 4'"), std::string::npos);
    EXPECT_NE(said("mesh.off").find("4 vertices and 4 faces"), std::string::npos);
    EXPECT_NE(said("binary.stl").find("4 triangles"), std::string::npos);
    EXPECT_NE(said("rays.ptx").find("9 points (columns times rows)"), std::string::npos);
    for (const char* name : {"ascii.pcd", "binary.pcd", "new.las"})
        EXPECT_NE(said(name).find("4 points, and"), std::string::npos) << name;
}

TEST_F(Surplus, IsSaidOfMeshes)
{
    for (const char* name : {"ascii.ply", "little.ply", "mesh.off", "binary.stl"})
        for (const Tail& tail : tails()) {
            if (tail.name != name) continue;
            Interrupter progress, quiet;
            const std::string bytes = sampleCalled(name).bytes;
            EXPECT_EQ(readMesh(put(name, bytes + tail.rows), &progress).triangles.size(), 4u);
            EXPECT_NE(surplusIn(progress.notes()).find("2 more rows"), std::string::npos) << name;
            readMesh(put(name, bytes + tail.less), &quiet);
            EXPECT_EQ(surplusIn(quiet.notes()), "") << name;
        }
}

// A writer that was stopped, or never came back to the header.
TEST_F(Surplus, TellsWhyAHeaderOfNoneGivesNone)
{
    const std::string ply = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n"
                            "property float y\nproperty float z\nend_header\n0 0 0\n1 1 1\n";
    std::string stl = sampleCalled("binary.stl").bytes, las = sampleCalled("plain.las").bytes;
    stl.replace(80, 4, bytesOf(std::uint32_t(0)));
    las.replace(107, 4, bytesOf(std::uint32_t(0)));
    const std::string pcd =
        with(with(sampleCalled("binary.pcd").bytes, "WIDTH 4", "WIDTH 0"), "POINTS 4", "POINTS 0");
    EXPECT_NE(error("a.ply", ply).find("and 2 more rows"), std::string::npos);
    EXPECT_NE(error("a.off", "OFF\n0 0 0\n0 0 0\n1 1 1\n2 2 2\n").find("and 3 more rows"),
              std::string::npos);
    EXPECT_NE(error("a.stl", stl).find("and 4 more rows"), std::string::npos);
    EXPECT_NE(error("a.las", las).find("and 4 more rows"), std::string::npos);
    EXPECT_NE(error("a.pcd", pcd).find("and 4 more rows"), std::string::npos);
}

// What follows the points of LAS 1.3 and 1.4 by right.
TEST_F(Surplus, IsNotWaveformsOrExtendedRecords)
{
    const std::string behind(500, '\1');
    std::string las = sampleCalled("new.las").bytes;
    const auto end = bytesOf(std::uint64_t(las.size()));
    std::string records = las, waves = las;
    records.replace(235, 8, end).replace(243, 4, bytesOf(std::uint32_t(1)));
    waves.replace(227, 8, end);
    EXPECT_EQ(surplusIn(read("a.las", records + behind).notes), "");
    EXPECT_EQ(surplusIn(read("a.las", waves + behind).notes), "");
    EXPECT_NE(surplusIn(read("a.las", las + behind).notes), "");
}

TEST_F(Surplus, OfTheCaseIsSaid)
{
    MPUVDB_CASE(file, "T20-header-says-160.ply");
    Interrupter progress;
    const PointInput input = readPoints({file}, BadPoints::Drop, {}, {}, &progress);
    EXPECT_EQ(input.cloud.size(), 160u);
    EXPECT_NE(surplusIn(input.notes).find("'element vertex 160', and 1833 more rows follow"),
              std::string::npos);
}

} // namespace
} // namespace mpuvdb::test
