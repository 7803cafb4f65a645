#include "files/atomic_file.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <gtest/gtest.h>
#include <openvdb/io/Archive.h>
#include <openvdb/io/File.h>
#include <openvdb/io/Stream.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <sstream>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;
using openvdb::FloatGrid;

LevelSet sphere(const std::string& name = "surface", float radius = 1)
{
    const auto grid =
        openvdb::tools::createLevelSetSphere<FloatGrid>(radius, openvdb::Vec3f(0.5f, 0, -3), 0.1f);
    grid->setName(name);
    return LevelSet(grid);
}

void save(const fs::path& file, const LevelSet& levelSet,
          const std::map<std::string, std::string>& metadata = {})
{
    Interrupter progress;
    writeLevelSet(file, levelSet, metadata, {}, &progress);
}

std::string bytesOf(const fs::path& file)
{
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

void write(const fs::path& file, const std::string& bytes)
{
    std::ofstream(file, std::ios::binary) << bytes;
}

/// Grids read with an interrupter have to be those read without.
void expectSameWithProgress(const fs::path& file)
{
    Interrupter progress;
    const openvdb::GridPtrVec usual = readGrids(file), other = readGrids(file, 0, &progress);
    ASSERT_EQ(usual.size(), other.size()) << file;
    for (std::size_t n = 0; n < usual.size(); ++n) {
        EXPECT_EQ(usual[n]->getName(), other[n]->getName()) << file;
        EXPECT_EQ(usual[n]->type(), other[n]->type()) << file;
        EXPECT_EQ(usual[n]->saveFloatAsHalf(), other[n]->saveFloatAsHalf()) << file;
        EXPECT_EQ(usual[n]->transform(), other[n]->transform()) << file;
        EXPECT_EQ(usual[n]->metaCount(), other[n]->metaCount()) << file;
        EXPECT_EQ(usual[n]->activeVoxelCount(), other[n]->activeVoxelCount()) << file;
        EXPECT_EQ(usual[n]->memUsage(), other[n]->memUsage()) << file;
    }
}

/// A folder of its own for every test.
class VdbFile : public ::testing::Test
{
protected:
    void SetUp() override
    {
        std::string name = (fs::temp_directory_path() / "mpuvdb-XXXXXX").string();
        ASSERT_TRUE(::mkdtemp(name.data()));
        mFolder = name;
    }
    void TearDown() override { fs::remove_all(mFolder); }

    std::vector<std::string> names() const
    {
        std::vector<std::string> found;
        for (const auto& entry : fs::directory_iterator(mFolder))
            found.push_back(entry.path().filename().string());
        std::sort(found.begin(), found.end());
        return found;
    }
    /// Expects InputError or IoError with a text.
    template <typename Exception>
    void expectRefused(const fs::path& file, const std::string& text, const std::string& name = {})
    {
        try {
            readLevelSet(file, name);
            ADD_FAILURE() << "accepted";
        } catch (const Exception& e) {
            EXPECT_NE(std::string(e.what()).find(text), std::string::npos) << e.what();
            EXPECT_NE(std::string(e.what()).find(file.string()), std::string::npos) << e.what();
        }
    }

    fs::path mFolder;
};

using Names = std::vector<std::string>;

TEST_F(VdbFile, ComesBackAsItWas)
{
    const fs::path file = mFolder / "a.vdb";
    const LevelSet written = sphere();
    const std::size_t items = written.grid().metaCount();
    save(file, written, {{"mpuvdb:tolerance", "0.001"}, {"mpuvdb:inputs", "scan.ply"}});
    EXPECT_EQ(written.grid().metaCount(), items);
    EXPECT_EQ(names(), Names{"a.vdb"});

    const LevelSet read = readLevelSet(file);
    const FloatGrid &a = written.grid(), &b = read.grid();
    EXPECT_EQ(b.getName(), "surface");
    EXPECT_EQ(b.background(), a.background());
    EXPECT_EQ(b.transform(), a.transform());
    EXPECT_TRUE(a.tree().hasSameTopology(b.tree()));
    for (auto v = a.cbeginValueAll(); v; ++v)
        ASSERT_EQ(b.tree().getValue(v.getCoord()), *v) << v.getCoord();
    EXPECT_EQ(b.metaValue<std::string>("mpuvdb:tolerance"), "0.001");
    EXPECT_EQ(b.metaValue<std::string>("mpuvdb:inputs"), "scan.ply");
    EXPECT_EQ(b.metaValue<openvdb::Int64>("file_voxel_count"),
              openvdb::Int64(a.activeVoxelCount()));
    EXPECT_TRUE(b["file_bbox_min"] && b["file_bbox_max"] && b["file_compression"]);
    Interrupter progress;
    EXPECT_TRUE(check(b, kGradientTolerance, openvdb::CoordBBox::inf(), &progress).sound());
}

TEST_F(VdbFile, HoldsGridsBesideTheLevelSet)
{
    const LevelSet surface = sphere();
    const auto coverage = FloatGrid::create(0);
    coverage->setTransform(surface.grid().transform().copy());
    coverage->setName("coverage");
    coverage->tree().setValue(openvdb::Coord(1, 2, 3), 0.25f);
    Interrupter progress;
    const fs::path file = mFolder / "a.vdb";
    writeLevelSet(file, surface, {{"mpuvdb:tolerance", "0.001"}}, {coverage}, &progress);

    EXPECT_EQ(readLevelSet(file).grid().getName(), "surface");
    const FloatGrid::Ptr read = readCoverage(file);
    EXPECT_EQ(read->getName(), "coverage");
    EXPECT_EQ(read->background(), 0);
    EXPECT_EQ(read->transform(), coverage->transform());
    EXPECT_EQ(read->activeVoxelCount(), 1u);
    EXPECT_EQ(read->tree().getValue(openvdb::Coord(1, 2, 3)), 0.25f);
    EXPECT_FALSE((*read)["mpuvdb:tolerance"]);
    ASSERT_EQ(readGrids(file).size(), 2u);

    // Other programs give several grids one name; they pass through.
    writeLevelSet(mFolder / "twice.vdb", surface, {}, {coverage, coverage->deepCopy()}, &progress);
    EXPECT_EQ(readGrids(mFolder / "twice.vdb").size(), 3u);

    // What a grid takes counts, whichever it is.
    EXPECT_TRUE(readCoverage(file, 1 << 30));
    EXPECT_THROW(readCoverage(file, 1000), LimitError);
    EXPECT_TRUE(readAttributeGrids(file, {"coverage"}, 1 << 30)[0]);
    EXPECT_THROW(readAttributeGrids(file, {"coverage"}, 1000), LimitError);

    save(mFolder / "b.vdb", surface);
    try {
        readCoverage(mFolder / "b.vdb");
        ADD_FAILURE() << "accepted";
    } catch (const InputError& e) {
        for (const char* said : {"b.vdb", "'coverage'", "'surface'", "--coverage"})
            EXPECT_NE(std::string(e.what()).find(said), std::string::npos) << e.what();
    }
}

TEST_F(VdbFile, OfTheSameGridHasTheSameBytes)
{
    save(mFolder / "a.vdb", sphere());
    save(mFolder / "b.vdb", sphere());
    save(mFolder / "c.vdb", sphere("surface", 1.01f));
    const std::string a = bytesOf(mFolder / "a.vdb");
    EXPECT_EQ(a, bytesOf(mFolder / "b.vdb"));
    EXPECT_NE(a.substr(21, 36), bytesOf(mFolder / "c.vdb").substr(21, 36));
    EXPECT_EQ(a[8], char(224));
}

/// The bytes of a file without its version and its identifier.
std::string withoutHead(std::string bytes)
{
    return bytes.replace(8, 4, 4, '0').replace(21, 36, 36, '0');
}

/// The bytes of @a grids as OpenVDB's own archive writes them onto a stream.
std::string writtenByOpenVdb(const openvdb::GridCPtrVec& grids)
{
    struct Archive : openvdb::io::Archive {
        void writeTo(std::ostream& out, const openvdb::GridCPtrVec& all) const
        {
            write(out, all, /*seekable=*/true, {});
        }
    } archive;
    archive.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK | openvdb::io::COMPRESS_BLOSC);
    std::ostringstream out;
    archive.writeTo(out, grids);
    return out.str();
}

// Leaves are compressed on all threads: several rounds of them here, and the last one is not full.
TEST_F(VdbFile, HasTheBytesThatOpenVdbWrites)
{
    openvdb::initialize();
    const FloatGrid::Ptr large =
        openvdb::tools::createLevelSetSphere<FloatGrid>(16, openvdb::Vec3f(0.5f, 0, -3), 0.1f);
    large->setName("large");
    large->setGridClass(openvdb::GRID_LEVEL_SET);
    ASSERT_GT(large->tree().leafCount(), 4096u);
    const FloatGrid::Ptr half = large->deepCopy();
    half->setName("half");
    half->setSaveFloatAsHalf(true);
    const auto colors = openvdb::Vec3SGrid::create(openvdb::Vec3f(0, 0.5f, 1));
    colors->setName("Cd");
    for (int i = 0; i < 100; ++i)
        colors->tree().setValue(openvdb::Coord(i, 3 * i, -i), openvdb::Vec3f(float(i), 0, 1));
    const openvdb::GridCPtrVec grids = {large, half, colors, FloatGrid::create(2)};
    Interrupter progress;
    writeGrids(mFolder / "a.vdb", grids, &progress);
    EXPECT_TRUE(withoutHead(bytesOf(mFolder / "a.vdb")) == withoutHead(writtenByOpenVdb(grids)));
}

TEST_F(VdbFile, GivesTheLevelSetThatIsMeant)
{
    openvdb::initialize();
    const fs::path file = mFolder / "a.vdb";
    const auto fog = FloatGrid::create(0);
    fog->setName("density");
    fog->setGridClass(openvdb::GRID_FOG_VOLUME);
    fog->tree().setValue(openvdb::Coord(1, 2, 3), 1);
    const auto store = [&](const openvdb::GridCPtrVec& grids) {
        openvdb::io::File(file.string()).write(grids);
    };
    store({fog, sphere("rock").gridPtr()});
    EXPECT_EQ(readLevelSet(file).grid().getName(), "rock");
    EXPECT_EQ(readGrids(file).size(), 2u);
    expectRefused<InputError>(file, "'rock' (level set, float)", "stone");
    expectRefused<InputError>(file, "no float level set called 'density'", "density");
    store({sphere("rock").gridPtr(), sphere("stone", 2).gridPtr()});
    expectRefused<InputError>(file, "several level sets: rock, stone");
    EXPECT_EQ(readLevelSet(file, "stone").grid().getName(), "stone");
    store({sphere("rock").gridPtr(), sphere("surface", 2).gridPtr()});
    EXPECT_EQ(readLevelSet(file).grid().getName(), "surface");
    store({fog});
    expectRefused<InputError>(file, "has no float level set");
    const auto broken = sphere("rock").grid().deepCopy();
    broken->tree().setValue(openvdb::Coord(15, 0, -30), std::numeric_limits<float>::quiet_NaN());
    store({broken});
    expectRefused<InputError>(file, "'rock': 1 values are not finite (first at voxel 15, 0, -30)");
    EXPECT_EQ(readGrids(file).size(), 1u) << "what is wrong with it is for check() to tell";
    store({});
    expectRefused<InputError>(file, "no grid at all");
    EXPECT_TRUE(readGrids(file).empty());
}

TEST_F(VdbFile, CanBeStoppedWhileItIsRead)
{
    openvdb::initialize();
    const fs::path file = mFolder / "a.vdb", streamed = mFolder / "b.vdb";
    const FloatGrid::Ptr grid = sphere().grid().deepCopy(), half = sphere().grid().deepCopy();
    half->setSaveFloatAsHalf(true);
    const FloatGrid::Ptr instance = grid->copy(); // of the same tree
    instance->setName("instance");
    const openvdb::GridCPtrVec grids{grid, half, instance, openvdb::Vec3SGrid::create()};
    openvdb::io::File(file.string()).write(grids);
    expectSameWithProgress(file);
    {
        std::ofstream out(streamed, std::ios::binary);
        openvdb::io::Stream(out).write(grids); // tells no places of its grids
    }
    expectSameWithProgress(streamed);

    Interrupter stopped;
    stopped.stop();
    EXPECT_THROW(readGrids(file, 0, &stopped), Interrupted);
    EXPECT_THROW(readLevelSet(file, "instance", 0, Validation::Distances, &stopped), Interrupted);
}

TEST_F(VdbFile, OfOtherProgramsCanBeRead)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set";
    for (const auto& entry : fs::directory_iterator(fs::path(folder) / "vdb")) {
        EXPECT_FALSE(readGrids(entry.path()).empty()) << entry.path();
        expectSameWithProgress(entry.path());
    }
    const fs::path sphereFile = fs::path(folder) / "vdb" / "sphere.vdb";
    EXPECT_EQ(readLevelSet(sphereFile).grid().activeVoxelCount(), 270638u);
}

/// The file @a from with another version of the format.
void setVersion(const fs::path& from, const fs::path& to, std::uint32_t version)
{
    std::string bytes = bytesOf(from);
    bytes.replace(8, sizeof version, reinterpret_cast<const char*>(&version), sizeof version);
    write(to, bytes);
}

/// All that is in @a grids, as text and bytes; but for points, which cannot be written alone.
std::string contentOf(const openvdb::GridPtrVec& grids)
{
    std::ostringstream out;
    for (const auto& grid : grids) {
        grid->print(out, 3);
        if (grid->valueType().rfind("ptdataidx", 0) != 0) grid->baseTree().writeBuffers(out);
    }
    return out.str();
}

/// A grid of whole numbers, whose bits are those of the values of @a tree. Made by OpenVDB's
/// library: compiling the class here would take longer than all of this file.
openvdb::GridBase::Ptr wholeNumbers(const openvdb::FloatTree& tree)
{
    std::stringstream bits;
    openvdb::io::setCurrentVersion(bits);
    tree.writeTopology(bits);
    tree.writeBuffers(bits);
    const openvdb::GridBase::Ptr grid = openvdb::GridBase::createGrid("Tree_int32_5_4_3");
    grid->baseTree().readTopology(bits);
    grid->baseTree().readBuffers(bits);
    EXPECT_EQ(grid->activeVoxelCount(), tree.activeVoxelCount());
    return grid;
}

// OpenVDB 13 writes 225 whatever the grids are; nothing but its half grids differs.
TEST_F(VdbFile, OfFormat225IsReadAsTheOneOf224)
{
    openvdb::initialize();
    const FloatGrid::Ptr grid = sphere().grid().deepCopy(), half = grid->deepCopy();
    half->setSaveFloatAsHalf(true);
    const openvdb::GridBase::Ptr counts = wholeNumbers(grid->tree());
    const auto mask = openvdb::MaskGrid::create();
    mask->tree().setValueOn(openvdb::Coord(5, 6, 7));
    const auto colors = openvdb::Vec3SGrid::create(openvdb::Vec3f(0, 0.5f, 1));
    colors->tree().setValue(openvdb::Coord(7, 8, 9), openvdb::Vec3f(1, 2, 3));
    const openvdb::GridCPtrVec grids{grid, half, counts, mask, colors};
    const fs::path known = mFolder / "224.vdb", newer = mFolder / "225.vdb";
    openvdb::io::File(known.string()).write(grids);
    setVersion(known, newer, 225);
    testing::internal::CaptureStderr();
    testing::internal::CaptureStdout();
    EXPECT_TRUE(contentOf(readGrids(known)) == contentOf(readGrids(newer)));
    expectSameWithProgress(newer);
    {
        std::ofstream out(known, std::ios::binary);
        openvdb::io::Stream(out).write(grids); // tells no places of its grids
    }
    setVersion(known, newer, 225);
    EXPECT_TRUE(contentOf(readGrids(known)) == contentOf(readGrids(newer)));
    EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "OpenVDB warns of it";
}

TEST_F(VdbFile, OfFormat225IsReadByEveryReaderAndWrittenAs224)
{
    const fs::path known = mFolder / "224.vdb", newer = mFolder / "225.vdb";
    const auto coverage = FloatGrid::create(0);
    coverage->setName("coverage");
    Interrupter progress;
    writeLevelSet(known, sphere(), {}, {coverage}, &progress);
    setVersion(known, newer, 225);
    EXPECT_EQ(readLevelSet(newer).grid().getName(), "surface");
    EXPECT_EQ(readLevelSetFile(newer).others.size(), 1u);
    EXPECT_EQ(readFloatGridFile(newer, "surface").grid->getName(), "surface");
    EXPECT_TRUE(readCoverage(newer));
    EXPECT_TRUE(readAttributeGrids(newer, {"coverage"})[0]);
    const LevelSetFile read = readLevelSetFile(newer);
    writeLevelSet(mFolder / "again.vdb", read.levelSet, {}, read.others, &progress);
    const std::uint32_t written = 224;
    EXPECT_EQ(bytesOf(mFolder / "again.vdb").substr(8, 4),
              std::string(reinterpret_cast<const char*>(&written), 4));
    setVersion(known, mFolder / "226.vdb", 226);
    expectRefused<InputError>(mFolder / "226.vdb", "file format 226, and 222 to 225 can be read");
}

TEST_F(VdbFile, OfOtherProgramsIsReadAsFormat225)
{
    const char* folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set";
    for (const auto& entry : fs::directory_iterator(fs::path(folder) / "vdb")) {
        // From 223 on: 222 has another default of compression.
        if (bytesOf(entry.path())[8] < char(223)) continue;
        setVersion(entry.path(), mFolder / "225.vdb", 225);
        EXPECT_TRUE(contentOf(readGrids(entry.path())) ==
                    contentOf(readGrids(mFolder / "225.vdb")));
    }
}

// What OpenVDB 13 writes of a half grid, as far as any reader without such grids comes.
TEST_F(VdbFile, WithAHalfGridIsRefusedByItsName)
{
    openvdb::initialize();
    const FloatGrid::Ptr density = FloatGrid::create(0);
    density->setName("density");
    for (const bool hasPlaces : {true, false}) {
        const fs::path file = mFolder / (hasPlaces ? "places.vdb" : "stream.vdb");
        const openvdb::GridCPtrVec grids{sphere().gridPtr(), density};
        std::ofstream out(file, std::ios::binary);
        if (hasPlaces)
            out << writtenByOpenVdb(grids);
        else
            openvdb::io::Stream(out).write(grids);
        out.close();
        std::string bytes = bytesOf(file);
        const std::string was = "Tree_float_5_4_3";
        bytes.replace(bytes.rfind(was), was.size(), "Tree_half_5_4_3 ");
        write(file, bytes);
        setVersion(file, file, 225);
        expectRefused<InputError>(file, "grid 'density' is a half grid");
        expectRefused<InputError>(file, "Convert it to a grid of floats");
    }
}

TEST_F(VdbFile, IsRefusedWhereItIsNone)
{
    expectRefused<IoError>(mFolder / "missing.vdb", "No such file");
    write(mFolder / "empty.vdb", "");
    expectRefused<InputError>(mFolder / "empty.vdb", "not a .vdb file");
    write(mFolder / "text.vdb", "ply\nformat ascii 1.0\n");
    expectRefused<InputError>(mFolder / "text.vdb", "not a .vdb file");
    save(mFolder / "a.vdb", sphere());
    std::string bytes = bytesOf(mFolder / "a.vdb");
    bytes[8] = char(0xff);
    write(mFolder / "new.vdb", bytes);
    expectRefused<InputError>(mFolder / "new.vdb", "file format");
}

TEST_F(VdbFile, IsRefusedWhereverItIsCut)
{
    save(mFolder / "a.vdb", sphere());
    const std::string bytes = bytesOf(mFolder / "a.vdb");
    std::vector<std::size_t> cuts;
    for (std::size_t cut = 8; cut < 1200; cut += 7) cuts.push_back(cut);
    for (int i = 1; i < 60; ++i) cuts.push_back(bytes.size() * i / 60);
    for (std::size_t last = 1; last < 20; ++last) cuts.push_back(bytes.size() - last);
    for (const std::size_t cut : cuts) {
        write(mFolder / "cut.vdb", bytes.substr(0, cut));
        expectRefused<InputError>(mFolder / "cut.vdb", "Copy or write it again");
    }
}

/// Run @a work, which uses no threads (those of this process are not in the other), in a process of
/// its own. @return as waitpid's status.
template <typename Work>
int inChild(const Work& work)
{
    const pid_t child = ::fork();
    if (child == 0) {
        ::alarm(20);
        ::_exit(work());
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return status;
}

TEST_F(VdbFile, StaysAsItWasWhenAWriteFails)
{
    const fs::path file = mFolder / "a.txt";
    write(file, "old");
    const auto fail = [](const fs::path& temporary) {
        write(temporary, "half of the ne");
        throw InputError("no more");
    };
    EXPECT_THROW(writeAtomically(file, fail), InputError);
    EXPECT_EQ(bytesOf(file), "old");
    EXPECT_EQ(names(), Names{"a.txt"});

    Interrupter progress;
    progress.stop();
    EXPECT_THROW(writeLevelSet(file, sphere(), {}, {}, &progress), Interrupted);
    EXPECT_EQ(bytesOf(file), "old");
    EXPECT_EQ(names(), Names{"a.txt"});
}

TEST_F(VdbFile, StaysAsItWasWhenTheProcessIsKilled)
{
    const fs::path file = mFolder / "a.txt";
    write(file, "old");
    const int status = inChild([&] {
        writeAtomically(file, [](const fs::path& temporary) {
            write(temporary, "half of the ne");
            ::raise(SIGKILL);
        });
        return 0;
    });
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    EXPECT_EQ(bytesOf(file), "old");
    const Names left = names();
    ASSERT_EQ(left.size(), 2u);
    EXPECT_EQ(left[0].rfind(".a.txt.", 0), 0u) << left[0];
    EXPECT_EQ(left[0].substr(left[0].size() - 4), ".tmp");
}

TEST_F(VdbFile, IsRemovedByASignalHandler)
{
    const fs::path file = mFolder / "a.txt";
    write(file, "old");
    const int status = inChild([&] {
        ::signal(SIGTERM, [](int) {
            removeTemporaryFiles();
            ::_exit(130);
        });
        writeAtomically(file, [](const fs::path& temporary) {
            write(temporary, "half of the ne");
            ::raise(SIGTERM);
        });
        return 0;
    });
    ASSERT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 130);
    EXPECT_EQ(bytesOf(file), "old");
    EXPECT_EQ(names(), Names{"a.txt"});
}

TEST_F(VdbFile, IsWrittenThroughLinksWithUsualPermissions)
{
    fs::create_directory(mFolder / "sub");
    fs::create_symlink("sub/real.txt", mFolder / "link.txt");
    const mode_t before = ::umask(027);
    writeAtomically(mFolder / "link.txt", [](const fs::path& t) { write(t, "new"); });
    ::umask(before);
    EXPECT_TRUE(fs::is_symlink(mFolder / "link.txt"));
    EXPECT_EQ(bytesOf(mFolder / "sub" / "real.txt"), "new");
    EXPECT_EQ(fs::status(mFolder / "sub" / "real.txt").permissions(), fs::perms(0640));
    writeAtomically(mFolder / "link.txt", [](const fs::path& t) { write(t, "newer"); });
    EXPECT_EQ(bytesOf(mFolder / "sub" / "real.txt"), "newer");
    fs::create_symlink("loop.txt", mFolder / "loop.txt");
    EXPECT_THROW(writeAtomically(mFolder / "loop.txt", [](const fs::path&) {}), IoError);
}

TEST_F(VdbFile, CannotBeWrittenWhereNoFileCanBe)
{
    const auto never = [](const fs::path&) { ADD_FAILURE(); };
    EXPECT_THROW(writeAtomically(mFolder, never), IoError);
    EXPECT_THROW(writeAtomically(mFolder / "", never), IoError);
    EXPECT_THROW(writeAtomically(mFolder / "no" / "a.vdb", never), IoError);
    EXPECT_THROW(writeAtomically("/dev/null", never), IoError);
    ASSERT_EQ(::mkfifo((mFolder / "pipe").c_str(), 0600), 0);
    EXPECT_THROW(writeAtomically(mFolder / "pipe", never), IoError);
    EXPECT_EQ(names(), Names{"pipe"});
    const std::string longName(250, 'x');
    writeAtomically(mFolder / longName, [](const fs::path& t) { write(t, "new"); });
    EXPECT_EQ(bytesOf(mFolder / longName), "new");
}

} // namespace
} // namespace mpuvdb
