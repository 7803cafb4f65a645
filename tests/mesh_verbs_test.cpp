// Meshes on the command line: formats, attributes, and what info says of them.
#include "command_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <set>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;

/// A unit sphere in a spiral, red above and blue below, with its height in millimeters.
std::string coloredSphere()
{
    constexpr int kPoints = 6000;
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(kPoints) +
                       "\nproperty float x\nproperty float y\nproperty float z\n"
                       "property float nx\nproperty float ny\nproperty float nz\n"
                       "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                       "property float height\nend_header\n";
    for (int i = 0; i < kPoints; ++i) {
        const double z = 1 - (2 * i + 1.0) / kPoints, r = std::sqrt(1 - z * z);
        const double turn = M_PI * (3 - std::sqrt(5.0)) * i;
        const std::string at = std::to_string(r * std::cos(turn)) + " " +
                               std::to_string(r * std::sin(turn)) + " " + std::to_string(z) + " ";
        text += at + at + (z > 0 ? "255 0 0 " : "0 0 255 ") + std::to_string(1000 * z) + "\n";
    }
    return text;
}

class MeshVerbs : public ::testing::Test
{
protected:
    MeshVerbs() { writeFile(folder / "ball.ply", coloredSphere()); }

    Ended command(std::vector<std::string> words, int status = 0)
    {
        words.insert(words.begin(), "mpuvdb");
        const Ended ended = run(folder, words);
        EXPECT_EQ(ended.status, status) << words[1] << "\n" << ended.err;
        return ended;
    }
    json gridsOf(const std::string& file)
    {
        return json::parse(command({"info", file, "--json"}).out)["files"][0]["grids"];
    }
    json glb(const std::string& file) const
    {
        const std::string bytes = readFile(folder / file);
        std::uint32_t length = 0;
        std::memcpy(&length, bytes.data() + 12, sizeof length);
        return json::parse(bytes.substr(20, length));
    }

    TemporaryFolder folder;
};

TEST_F(MeshVerbs, ColorsGoFromThePointsToTheGridAndTheMeshes)
{
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "40", "--mesh", "ball.glb",
             "--usd", "ball.usda", "--units", "cm", "--up", "z", "--attributes", "Cd,height"});
    std::set<std::string> names;
    for (const json& grid : gridsOf("ball.vdb")) names.insert(grid["name"]);
    EXPECT_EQ(names, (std::set<std::string>{"Cd", "height", "surface"}));
    const json direct = glb("ball.glb")["meshes"][0]["primitives"][0]["attributes"];
    EXPECT_TRUE(direct.contains("COLOR_0") && direct.contains("_height"));
    EXPECT_EQ(glb("ball.glb")["nodes"][0]["scale"][0], 0.01);
    const std::string layer = readFile(folder / "ball.usda");
    EXPECT_NE(layer.find("asset filePath = @./ball.vdb@"), std::string::npos);
    EXPECT_NE(layer.find("OpenVDBAsset \"height\""), std::string::npos);
    EXPECT_NE(layer.find("upAxis = \"Z\""), std::string::npos);

    // From the file: colors by themselves, scalars where they are named.
    command({"mesh", "ball.vdb", "-o", "again.glb"});
    const json again = glb("again.glb")["meshes"][0]["primitives"][0]["attributes"];
    EXPECT_TRUE(again.contains("COLOR_0") && !again.contains("_height"));
    command({"mesh", "ball.vdb", "-o", "high.ply", "--attributes", "height"});
    const std::string head = readFile(folder / "high.ply").substr(0, 300);
    EXPECT_NE(head.find("property float height"), std::string::npos);
    EXPECT_EQ(head.find("property uchar red"), std::string::npos);
}

TEST_F(MeshVerbs, ColorsCanBeLeftOutAndWhatIsMissingIsToldFirst)
{
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "30"});
    EXPECT_EQ(gridsOf("ball.vdb").size(), 2u);
    command(
        {"reconstruct", "ball.ply", "-o", "bare.vdb", "--voxels", "30", "--attributes", "none"});
    EXPECT_EQ(gridsOf("bare.vdb").size(), 1u);
    command({"reconstruct", "ball.ply", "-o", "no.vdb", "--attributes", "depth"}, 3);
    command({"reconstruct", "ball.ply", "-o", "no.vdb", "--attributes", "Cd,Cd"}, 2);
    const Ended missing = command({"mesh", "bare.vdb", "-o", "no.ply", "--attributes", "Cd"}, 3);
    EXPECT_NE(missing.err.find("grid 'Cd'"), std::string::npos) << missing.err;
    const auto names = folder.names();
    EXPECT_EQ(std::count_if(names.begin(), names.end(),
                            [](const std::string& name) { return name.rfind("no.", 0) == 0; }),
              0);
}

TEST_F(MeshVerbs, InfoMeasuresMeshes)
{
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "50", "--mesh", "ball.off",
             "--report", "ball.json"});
    const auto meshOf = [&](const std::string& against) {
        const Ended ended = command({"info", "ball.off", "--json", "--against", against});
        return json::parse(ended.out)["files"][0]["mesh"];
    };
    const json mesh = meshOf("ball.ply");
    EXPECT_EQ(mesh["genus"], 0);
    EXPECT_EQ(mesh["components"], 1);
    EXPECT_EQ(mesh["boundary_edges"], 0);
    EXPECT_EQ(mesh["self_intersections"], 0);
    EXPECT_EQ(mesh["colors"], true);
    EXPECT_NEAR(mesh["area"].get<double>(), 4 * M_PI, 0.05);
    EXPECT_GT(mesh["first_percentile_angle"].get<double>(), 1);
    const json& to = mesh["against"]["distance_to_it"];
    const json& from = mesh["against"]["distance_from_it"];
    EXPECT_LT(from["max"].get<double>(), 0.004); // a tenth of a voxel
    EXPECT_LT(to["mean"].get<double>(), 0.03);   // half the spacing
    EXPECT_LT(meshOf("ball.vdb")["against"]["distance_to_it"]["max"].get<double>(), 1e-5);
    EXPECT_LT(meshOf("ball.off")["against"]["distance_from_it"]["rms"].get<double>(), 1e-9);
    const json report = json::parse(readFile(folder / "ball.json"))["mesh"];
    EXPECT_EQ(report["self_intersections"], 0);
    EXPECT_EQ(report["genus"], 0);
    command({"info", "ball.ply", "--against", "ball.off"}, 2);
}

TEST_F(MeshVerbs, MeasureWritesDistancesOfPoints)
{
    command({"sample", "sphere(1.1)", "-o", "larger.ply", "--points", "2000"});
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "50"});
    command({"measure", "ball.vdb", "--points", "larger.ply", "-o", "apart.ply", "--normals",
             "--report", "apart.json"});
    const json distances = json::parse(readFile(folder / "apart.json"))["distances"];
    EXPECT_EQ(distances["points"], 2000);
    EXPECT_EQ(distances["inside"], 0);
    // A fortieth of a voxel, which is a 25th.
    EXPECT_NEAR(distances["mean"].get<double>(), 0.1, 1e-3);
    EXPECT_NEAR(distances["rms"].get<double>(), 0.1, 1e-3);
    const json points = json::parse(command({"info", "apart.ply", "--json"}).out)["files"][0];
    EXPECT_EQ(points["scalars"], json::array({"distance"}));
    EXPECT_TRUE(points["normals"]);
    command({"measure", "ball.vdb", "--points", "larger.ply", "-o", "no.xyz"}, 2);
    command({"measure", "ball.vdb", "--points", "missing.ply", "-o", "no.ply"}, 3);
    EXPECT_FALSE(std::filesystem::exists(folder / "no.ply"));
}

TEST_F(MeshVerbs, AnalyzeWritesGridsThatMeshesTake)
{
    command(
        {"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "50", "--attributes", "none"});
    command({"analyze", "ball.vdb", "-o", "all.vdb"});
    std::set<std::string> names;
    for (const json& grid : gridsOf("all.vdb")) names.insert(grid["name"]);
    EXPECT_EQ(names, (std::set<std::string>{"surface", "normals", "curvature", "thickness"}));
    command({"analyze", "ball.vdb", "-o", "thin.vdb", "--quantities", "thickness"});
    EXPECT_EQ(gridsOf("thin.vdb").size(), 2u);
    command({"mesh", "all.vdb", "-o", "all.ply", "--attributes", "curvature,thickness"});
    const json mesh = json::parse(command({"info", "all.ply", "--json"}).out)["files"][0];
    EXPECT_EQ(mesh["scalars"].size(), 2u);
    command({"analyze", "ball.vdb", "-o", "no.vdb", "--quantities", "color"}, 2);
}

TEST_F(MeshVerbs, InfoMapsDeviations)
{
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "50", "--mesh", "ball.off"});
    command({"offset", "ball.vdb", "-o", "larger.vdb", "--distance", "0.05"});
    const Ended ended = command({"info", "ball.off", "--json", "--against", "larger.vdb", "--map",
                                 "map.ply", "--histogram", "map.png", "--range", "0.1"});
    const json deviation = json::parse(ended.out)["files"][0]["mesh"]["against"]["deviation"];
    EXPECT_EQ(deviation["range"], 0.1);
    EXPECT_EQ(deviation["signed"], true);
    EXPECT_NEAR(deviation["median_magnitude"].get<double>(), 0.05, 1e-3);
    const json map = json::parse(command({"info", "map.ply", "--json"}).out)["files"][0];
    EXPECT_EQ(map["scalars"], json::array({"deviation"}));
    EXPECT_TRUE(map["mesh"]["colors"]);
    EXPECT_EQ(readFile(folder / "map.png").substr(1, 3), "PNG");
    command({"info", "ball.off", "--map", "no.ply"}, 2);
    command({"info", "ball.off", "ball.off", "--against", "ball.ply", "--map", "no.ply"}, 2);
    command({"info", "ball.off", "--against", "ball.ply", "--map", "no.ply", "--range", "0"}, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "no.ply"));
}

} // namespace
} // namespace mpuvdb::test
