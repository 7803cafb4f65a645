// A job's result as a folder: tiles together are the whole, coarser levels are level sets of their
// own, and hosts open them.
#include "farm_fixture.h"
#include "program_output.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <nlohmann/json.hpp>
#include <openvdb/tools/Composite.h>

#include <cmath>
#include <regex>
#include <set>

namespace mpuvdb::test
{
namespace
{

using Json = nlohmann::json;

class TileFolderTest : public JobFixture
{
protected:
    Json indexOf(const fs::path& folder) const
    {
        return Json::parse(bytesOf(folder / "index.json"));
    }

    /// A job's folder of tiles, and the file of all beside it.
    fs::path merged(const PointCloud& cloud, const ReconstructOptions& options,
                    int tileVoxels = 128) const
    {
        const Job job(done(cloud, options, tileVoxels), kBuild);
        job.merge(at("whole.vdb"));
        const JobResult result = job.mergeToFolder(at("city"));
        EXPECT_TRUE(result.faults.empty()) << result.faults.front();
        return at("city");
    }
};

openvdb::FloatGrid::Ptr levelSetOf(const fs::path& file)
{
    return openvdb::gridPtrCast<openvdb::FloatGrid>(readGrids(file).front());
}

/// All active voxels of two grids, and signs at random places in a box that is somewhat larger.
void expectSame(const openvdb::FloatGrid& made, const openvdb::FloatGrid& whole)
{
    EXPECT_EQ(made.activeVoxelCount(), whole.activeVoxelCount());
    const auto at = made.getConstAccessor(), there = whole.getConstAccessor();
    std::size_t differ = 0;
    for (auto voxel = whole.cbeginValueOn(); voxel; ++voxel)
        differ += !at.isValueOn(voxel.getCoord()) || at.getValue(voxel.getCoord()) != *voxel;
    EXPECT_EQ(differ, 0u);
    openvdb::CoordBBox box = whole.evalActiveVoxelBoundingBox();
    box.expand(20);
    Random random(46);
    for (int n = 0; n < 100000; ++n) {
        openvdb::Coord place = box.min();
        for (int axis = 0; axis < 3; ++axis)
            place[axis] += int(random.below(std::size_t(box.dim()[axis])));
        differ += (at.getValue(place) < 0) != (there.getValue(place) < 0);
    }
    EXPECT_EQ(differ, 0u) << "signs";
}

/// A block with cubes of 128 voxels that are within it, on both sides of a node of the tree.
TEST_F(TileFolderTest, TheUnionOfTheTilesIsTheWhole)
{
    const fs::path city = merged(
        randomScan("translate(box(1.5, 1.5, 2.8), 0.64, 0.64, 40.96)", 12000), voxelSize(0.01));
    const Json index = indexOf(city);
    EXPECT_GE(index["tiles"].size(), 27u);
    std::vector<int> within; // of boxes in the lower and in the upper node
    openvdb::FloatGrid::Ptr together;
    for (const Json& tile : index["tiles"]) {
        for (const Json& box : tile["inside"]) within.push_back(box[2].get<int>() >> 12);
        const auto next = levelSetOf(city / tile["file"].get<std::string>());
        if (together)
            openvdb::tools::csgUnion(*together, *next);
        else
            together = next;
    }
    std::sort(within.begin(), within.end());
    EXPECT_EQ(within, (std::vector<int>{0, 1}));
    expectSame(*together, *levelSetOf(at("whole.vdb")));
}

TEST_F(TileFolderTest, EachTileHasItsVoxelsOfAllGridsAndALeafMore)
{
    const PointCloud cloud = coloredTorus(scanSettings(30000));
    ReconstructOptions options = voxelSize(0.012);
    options.coverage = true;
    options.attributes = {kColorName};
    const fs::path city = merged(cloud, options);
    const openvdb::GridPtrVec whole = readGrids(at("whole.vdb"));
    ASSERT_EQ(whole.size(), 3u);
    std::vector<std::uint64_t> counts(whole.size());
    const auto compare = [&](const auto& made, const auto& of, const openvdb::CoordBBox& box,
                             std::uint64_t& count) {
        const auto there = of.getConstAccessor();
        openvdb::CoordBBox wider = box;
        wider.expand(8);
        for (auto voxel = made.cbeginValueOn(); voxel; ++voxel) {
            count += box.isInside(voxel.getCoord());
            ASSERT_TRUE(wider.isInside(voxel.getCoord()));
            ASSERT_TRUE(there.isValueOn(voxel.getCoord()));
            ASSERT_EQ(*voxel, there.getValue(voxel.getCoord()));
        }
    };
    const Json index = indexOf(city);
    for (const Json& tile : index["tiles"]) {
        const auto b = tile["box"].get<std::array<int, 6>>();
        const openvdb::CoordBBox box({b[0], b[1], b[2]}, {b[3], b[4], b[5]});
        const openvdb::GridPtrVec grids = readGrids(city / tile["file"].get<std::string>());
        ASSERT_EQ(grids.size(), whole.size());
        for (std::size_t n = 0; n < grids.size(); ++n) {
            EXPECT_EQ(grids[n]->getName(), whole[n]->getName());
            EXPECT_EQ(grids[n]->transform(), whole[n]->transform());
            if (const auto of = openvdb::gridPtrCast<openvdb::FloatGrid>(whole[n]))
                compare(*openvdb::gridPtrCast<openvdb::FloatGrid>(grids[n]), *of, box, counts[n]);
            else
                compare(*openvdb::gridPtrCast<openvdb::Vec3SGrid>(grids[n]),
                        *openvdb::gridPtrCast<openvdb::Vec3SGrid>(whole[n]), box, counts[n]);
        }
    }
    for (std::size_t n = 0; n < whole.size(); ++n)
        EXPECT_EQ(counts[n], whole[n]->activeVoxelCount());
}

/// Distances from the analytic surface, both ways, in voxels of the level.
TEST_F(TileFolderTest, CoarserLevelsAreLevelSetsHalfAVoxelFromTheSurface)
{
    const fs::path city = merged(randomScan("torus(1, 0.45)", 60000), voxelSize(0.008));
    const auto distance = [](const Vec3d& p) {
        return std::hypot(std::hypot(p[0], p[1]) - 1, p[2]) - 0.45;
    };
    const Json index = indexOf(city);
    ASSERT_EQ(index["levels"].size(), 2u);
    double h = 0.008;
    for (const Json& level : index["levels"]) {
        h *= 4;
        EXPECT_DOUBLE_EQ(level["voxel_size"].get<double>(), h);
        const LevelSet coarse = readLevelSet(city / level["file"].get<std::string>());
        EXPECT_DOUBLE_EQ(coarse.voxelSize(), h);
        EXPECT_NEAR(coarse.halfWidth(), 3, 1e-6);
        const CheckReport checked = check(coarse.grid());
        EXPECT_TRUE(checked.sound()) << checked.findings.front().what;
        const Mesh mesh = extractMesh(coarse);
        ASSERT_FALSE(mesh.positions.empty());
        double largest = 0;
        for (std::size_t n = 0; n < mesh.positions.size(); ++n)
            largest = std::max(largest, std::abs(distance(mesh.world(n))));
        EXPECT_LT(largest, 0.5 * h);
        const FieldPtr field = makeGridField(coarse);
        for (int u = 0; u < 60; ++u)
            for (int v = 0; v < 30; ++v) {
                const double a = u * M_PI / 30, b = v * M_PI / 15;
                const Vec3d p((1 + 0.45 * std::cos(b)) * std::cos(a),
                              (1 + 0.45 * std::cos(b)) * std::sin(a), 0.45 * std::sin(b));
                EXPECT_LT(std::abs(field->evaluate(p).value), 0.5 * h);
            }
    }
}

TEST_F(TileFolderTest, CoarserLevelsDoNotDependOnTheTiles)
{
    ScanSettings scan = scanSettings(12000);
    scan.noise = 0.004;
    // A side is two voxels from the border of a coarser level's small part: the one beyond has its
    // band alone.
    const PointCloud cloud =
        scanOf("translate(difference(box(2, 1.5, 1), cylinder(0.4, 3)), 1.54, 0, 0)", scan);
    const fs::path small = merged(cloud, voxelSize(0.01));
    const std::string four = bytesOf(small / "coarse_4.vdb"),
                      sixteen = bytesOf(small / "coarse_16.vdb");
    EXPECT_GE(indexOf(small)["tiles"].size(), 8u);
    fs::remove_all(at("job"));
    const fs::path large = merged(cloud, voxelSize(0.01), 1024);
    EXPECT_LE(indexOf(large)["tiles"].size(), 8u);
    EXPECT_TRUE(bytesOf(large / "coarse_4.vdb") == four);
    EXPECT_TRUE(bytesOf(large / "coarse_16.vdb") == sixteen);
}

TEST_F(TileFolderTest, TheIndexAndTheLayerSayWhatIsThere)
{
    const fs::path city = merged(randomScan("torus(1, 0.4)", 20000), voxelSize(0.015));
    const Json index = indexOf(city);
    const openvdb::FloatGrid::Ptr whole = levelSetOf(at("whole.vdb"));
    std::uint64_t voxels = 0;
    std::set<std::string> files;
    for (const char* list : {"tiles", "levels"})
        for (const Json& item : index[list]) {
            const std::string name = item["file"];
            files.insert(name);
            EXPECT_EQ(item["bytes"], fs::file_size(city / name));
            EXPECT_EQ(item["hash"].get<std::string>().size(), 32u);
        }
    for (const Json& tile : index["tiles"]) {
        voxels += tile["active_voxels"].get<std::uint64_t>();
        const auto box = tile["box"].get<std::array<int, 6>>();
        for (int axis = 0; axis < 3; ++axis) {
            const double o = index["origin"][std::size_t(axis)], h = index["voxel_size"];
            EXPECT_DOUBLE_EQ(tile["world"][std::size_t(axis)].get<double>(),
                             o + h * (box[std::size_t(axis)] - 0.5));
            EXPECT_DOUBLE_EQ(tile["world"][std::size_t(axis + 3)].get<double>(),
                             o + h * (box[std::size_t(axis + 3)] + 0.5));
        }
    }
    EXPECT_EQ(voxels, whole->activeVoxelCount());
    // A layer: a volume for each tile, the coarser one as their proxy, fields that are there.
    const std::string text = bytesOf(city / "volume.usda");
    EXPECT_EQ(text.rfind("#usda 1.0\n", 0), 0u);
    const auto count = [&](const std::string& pattern) {
        const std::regex regex(pattern);
        return std::size_t(std::distance(std::sregex_iterator(text.begin(), text.end(), regex),
                                         std::sregex_iterator()));
    };
    EXPECT_EQ(count("def Volume \"tile_[0-9]{5}\""), index["tiles"].size());
    EXPECT_EQ(count("def Volume \"coarse_4\""), 1u);
    EXPECT_EQ(count("purpose = \"render\""), index["tiles"].size());
    EXPECT_EQ(count("purpose = \"proxy\""), 1u);
    EXPECT_EQ(count("rel field:surface = </volume/(tile_[0-9]{5}|coarse_4)/surface>"),
              index["tiles"].size() + 1);
    EXPECT_EQ(count("float3\\[\\] extent = "), index["tiles"].size() + 1);
    EXPECT_EQ(std::count(text.begin(), text.end(), '{'), std::count(text.begin(), text.end(), '}'));
    const std::regex asset("asset filePath = @\\./([^@]*)@");
    for (auto found = std::sregex_iterator(text.begin(), text.end(), asset);
         found != std::sregex_iterator(); ++found)
        EXPECT_EQ(files.count((*found)[1]), 1u) << (*found)[1];
}

TEST_F(TileFolderTest, AFolderIsReplacedAsAWhole)
{
    const fs::path folder = done(randomScan("torus(1, 0.4)", 20000), voxelSize(0.015));
    const Job job(folder, kBuild);
    job.mergeToFolder(at("city"));
    const auto content = [&] {
        std::map<std::string, std::string> files;
        for (const auto& entry : fs::recursive_directory_iterator(at("city")))
            if (entry.is_regular_file()) files[entry.path().string()] = bytesOf(entry.path());
        return files;
    };
    const auto before = content();
    job.mergeToFolder(at("city/"));
    EXPECT_TRUE(content() == before);
    // What somebody else put there is not ours to remove.
    std::ofstream(at("city/notes.txt")) << "mine";
    EXPECT_THROW(job.mergeToFolder(at("city")), UsageError);
    fs::remove(at("city/notes.txt"));
    // A stop on the way changes nothing, wherever it comes.
    for (const char* stage : {"tiles", "coarse"}) {
        Interrupter stopping({}, nullptr);
        Interrupter* stop = &stopping;
        Interrupter stopped(
            [&](const std::string& now, double) {
                if (now == stage) stop->stop();
            },
            [&] { return stop->stopped(); });
        EXPECT_THROW(job.mergeToFolder(at("city"), {}, &stopped), Interrupted) << stage;
        EXPECT_TRUE(content() == before);
        EXPECT_EQ(std::distance(fs::directory_iterator(at("")), fs::directory_iterator()), 2);
    }
    // Damaged results are refused before anything is written.
    fs::resize_file(folder / "tiles" / "00000.bin", 100);
    EXPECT_THROW(job.mergeToFolder(at("other")), InputError);
    EXPECT_FALSE(fs::exists(at("other")));
}

/// Prints what Blender has of each file: its grids, and the vertices of their surface.
constexpr const char* kBlenderScript = R"(
import bpy, json, sys
for file in sys.argv[sys.argv.index("--") + 1:]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.object.volume_import(filepath=file)
    volume = [o for o in bpy.data.objects if o.type == "VOLUME"][0]
    volume.data.grids.load()
    names = [g.name for g in volume.data.grids]
    mesh = bpy.data.objects.new("mesh", bpy.data.meshes.new("mesh"))
    bpy.context.scene.collection.objects.link(mesh)
    modifier = mesh.modifiers.new("surface", "VOLUME_TO_MESH")
    modifier.object = volume
    modifier.grid_name = "surface"
    modifier.threshold = 0.0
    made = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    print("VOLUME", json.dumps({"file": file, "grids": names, "vertices": len(made.vertices)}))
)";

TEST_F(TileFolderTest, BlenderOpensATileAndACoarserLevel)
{
    if (outputOf("blender --version").rfind("Blender", 0) != 0)
        GTEST_SKIP() << "there is no Blender (apt-get install blender)";
    const fs::path city = merged(randomScan("torus(1, 0.4)", 20000), voxelSize(0.015));
    std::ofstream(at("read.py")) << kBlenderScript;
    const std::string tile = indexOf(city)["tiles"][0]["file"];
    std::istringstream output(outputOf(fmt::format(
        "blender --background --factory-startup --python '{}' -- '{}' '{}'", at("read.py").string(),
        (city / tile).string(), (city / "coarse_4.vdb").string())));
    int volumes = 0;
    for (std::string line; std::getline(output, line);) {
        if (line.rfind("VOLUME ", 0) != 0) continue;
        ++volumes;
        const Json found = Json::parse(line.substr(7));
        EXPECT_EQ(found["grids"], Json({"surface"}));
        EXPECT_GT(found["vertices"], 500);
    }
    EXPECT_EQ(volumes, 2);
}

} // namespace
} // namespace mpuvdb::test
