// Meshes on the command line: formats, attributes, and what info says of them.
#include "command_process.h"

#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

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

    /// The largest difference of the attribute height, on the mesh of a level set, from what it is
    /// to be at a vertex.
    template <typename F>
    double farthestHeight(const std::string& levelSet, const F& heightAt)
    {
        command({"mesh", levelSet, "-o", "heights.ply", "--attributes", "height"});
        const std::string bytes = readFile(folder / "heights.ply");
        std::istringstream head(bytes.substr(0, bytes.find("end_header")));
        std::size_t vertices = 0;
        std::vector<std::string> names; // of the vertices' numbers, all of them floats
        for (std::string line; std::getline(head, line);) {
            std::istringstream words(line);
            std::string first, second, third;
            words >> first >> second >> third;
            if (first == "element" && second == "vertex") vertices = std::stoul(third);
            if (first == "property" && second == "float") names.push_back(third);
        }
        const auto slot = [&](const char* name) {
            return std::size_t(std::find(names.begin(), names.end(), name) - names.begin());
        };
        EXPECT_GT(vertices, 500u) << levelSet;
        EXPECT_LT(slot("height"), names.size()) << levelSet;
        double farthest = 0;
        std::vector<float> numbers(names.size());
        const char* from = bytes.data() + bytes.find("end_header\n") + 11;
        for (std::size_t n = 0; n < vertices; ++n, from += numbers.size() * sizeof(float)) {
            std::memcpy(numbers.data(), from, numbers.size() * sizeof(float));
            const std::array<double, 3> at = {numbers[slot("x")], numbers[slot("y")],
                                              numbers[slot("z")]};
            farthest = std::max(farthest, std::abs(numbers[slot("height")] - heightAt(at)));
        }
        return farthest;
    }

    TemporaryFolder folder;
};

/// Each place has the attributes of where it was, or of what was nearest to it.
TEST_F(MeshVerbs, AttributesFollowTheSurface)
{
    using Place = std::array<double, 3>;
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "40", "--coverage",
             "--attributes", "Cd,height"});
    // Among the voxels' trilinear means and the points' own weights.
    constexpr double kNear = 12; // millimeters: a quarter of a voxel
    const auto up = [](const Place& p) { return 1000 * p[2]; };
    const auto radial = [](const Place& p) {
        return 1000 * p[2] / std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    };
    EXPECT_LT(farthestHeight("ball.vdb", up), kNear);
    const struct {
        std::vector<std::string> verb;
        std::function<double(const Place&)> height;
    } cases[] = {
        {{"transform", "--rotate", "90,0,0"}, [](const Place& p) { return -1000 * p[1]; }},
        {{"transform", "--scale", "2", "--with-voxels"}, [](const Place& p) { return 500 * p[2]; }},
        {{"transform", "--scale", "1,1,-1", "--translate", "0,0,5"},
         [](const Place& p) { return 1000 * (5 - p[2]); }},
        {{"twist", "--degrees-per-unit", "60"}, up},
        {{"taper", "--end-factor", "0.5"}, up},
        {{"offset", "--distance", "0.4"}, radial},
        {{"offset", "--distance=-0.4"}, radial},
        {{"shell", "--thickness", "0.3"}, radial},
        {{"smooth"}, radial},
        {{"clip", "--box", "-2", "-2", "-2", "2", "2", "0.8"}, radial},
        {{"resample", "--voxel-size", "0.07"}, up}};
    for (const auto& each : cases) {
        std::vector<std::string> words = {each.verb[0], "ball.vdb", "-o", "made.vdb"};
        words.insert(words.end(), each.verb.begin() + 1, each.verb.end());
        command(words);
        EXPECT_LT(farthestHeight("made.vdb", each.height), 2 * kNear)
            << each.verb[0] << ' ' << each.verb.back();
        std::set<std::string> names;
        for (const json& grid : gridsOf("made.vdb")) names.insert(grid["name"]);
        EXPECT_EQ(names, (std::set<std::string>{"Cd", "coverage", "height", "surface"}));
        // All of it was seen: nothing is trimmed.
        const json whole = json::parse(command({"info", "heights.ply", "--json"}).out);
        command({"mesh", "made.vdb", "-o", "open.ply", "--holes", "open"});
        const json open = json::parse(command({"info", "open.ply", "--json"}).out);
        const auto areaOf = [](const json& of) {
            return of["files"][0]["mesh"]["area"].get<double>();
        };
        EXPECT_GT(areaOf(open), 0.99 * areaOf(whole)) << each.verb[0] << ' ' << each.verb.back();
    }
}

TEST_F(MeshVerbs, WhatWasMeasuredOfAnotherSurfaceIsLeftOut)
{
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "30"});
    command({"analyze", "ball.vdb", "-o", "measured.vdb"});
    const Ended moved =
        command({"transform", "measured.vdb", "-o", "moved.vdb", "--scale", "2", "--with-voxels"});
    EXPECT_NE(moved.err.find("'thickness' is of the surface as it was"), std::string::npos);
    for (const json& grid : gridsOf("moved.vdb")) EXPECT_NE(grid["name"], "thickness");
}

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

TEST_F(MeshVerbs, MeasureTellsOfPointsThatItLeavesOut)
{
    command({"sample", "sphere(1.1)", "-o", "larger.xyz", "--points", "200"});
    command({"reconstruct", "ball.ply", "-o", "ball.vdb", "--voxels", "50"});
    writeFile(folder / "far.xyz", readFile(folder / "larger.xyz") + "1e5 0 0 1 0 0\n");
    const Ended ended = command(
        {"measure", "ball.vdb", "--points", "far.xyz", "-o", "far.ply", "--report", "far.json"});
    EXPECT_NE(ended.err.find("1 too far"), std::string::npos) << ended.err;
    EXPECT_EQ(json::parse(readFile(folder / "far.json"))["input"]["dropped"]["too far"], 1);
}

/// Faces on planes of voxels end the band exactly between voxels' distances.
TEST_F(MeshVerbs, ScalarsOfMeshesOnTheLatticeFollowThem)
{
    std::string text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\n"
                       "property float y\nproperty float z\nproperty float stress\n"
                       "element face 12\nproperty list uchar int vertex_indices\nend_header\n";
    for (int n = 0; n < 8; ++n)
        text += fmt::format("{} {} {} {}\n", n & 1, n >> 1 & 1, n >> 2, n >> 2);
    for (const char* const face : {"0 2 3", "0 3 1", "4 5 7", "4 7 6", "0 1 5", "0 5 4", "2 6 7",
                                   "2 7 3", "0 4 6", "0 6 2", "1 3 7", "1 7 5"})
        text += fmt::format("3 {}\n", face);
    writeFile(folder / "load.ply", text);
    command({"voxelize", "load.ply", "-o", "load.vdb", "--voxel-size", "0.05", "--attributes",
             "stress"});
    command({"transform", "load.vdb", "-o", "moved.vdb", "--translate", "0,0,5"});
    command({"mesh", "moved.vdb", "-o", "moved.ply", "--attributes", "stress"});
    const PointInput points = readPoints({folder / "moved.ply"}, BadPoints::Drop, {}, {"stress"});
    double largest = 0;
    for (std::size_t n = 0; n < points.cloud.size(); ++n)
        largest = std::max(largest, std::abs(double(points.cloud.scalars[0].values[n]) -
                                             (points.cloud.world(n).z() - 5)));
    EXPECT_LT(largest, 0.05); // a voxel
    // What a format has no place for is told.
    const Ended flat = command({"mesh", "moved.vdb", "-o", "moved.obj", "--attributes", "stress"});
    EXPECT_NE(flat.err.find("stress was left out, as .obj"), std::string::npos) << flat.err;
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
