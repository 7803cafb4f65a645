// mpuvdb particles: what it makes, what it says, and how it refuses.
#include "command_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>

namespace mpuvdb::test
{
namespace
{

using nlohmann::json;

/// A block of n x n x n particles a unit apart; each row of text ends with @a more.
std::string block(int n, const std::string& more = {})
{
    std::string text;
    for (int x = 0; x < n; ++x)
        for (int y = 0; y < n; ++y)
            for (int z = 0; z < n; ++z)
                text += std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) +
                        more + "\n";
    return text;
}

std::string ply(int n, const std::vector<std::string>& properties, const std::string& more)
{
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(n * n * n) + "\n";
    for (const char* const axis : {"x", "y", "z"})
        text += std::string("property float ") + axis + "\n";
    for (const std::string& name : properties) text += "property float " + name + "\n";
    return text + "end_header\n" + block(n, more);
}

class ParticlesVerb : public ::testing::Test
{
protected:
    Ended command(std::vector<std::string> words, int status = 0, const std::string& input = {})
    {
        words.insert(words.begin(), {"mpuvdb", "particles"});
        const Ended ended = run(folder, words, input);
        EXPECT_EQ(ended.status, status) << ended.err;
        return ended;
    }
    TemporaryFolder folder;
};

TEST_F(ParticlesVerb, WritesSurfaceVelocitiesAndMesh)
{
    writeFile(folder / "block.ply", ply(8, {"pscale", "vx", "vy", "vz", "age"}, " 0.62 1 2 3 7"));
    const Ended ended = command({"block.ply", "-o", "block.vdb", "--mesh", "block.obj",
                                 "--attributes", "age", "--report", "report.json"});
    EXPECT_NE(ended.err.find("age was left out, as .obj"), std::string::npos) << ended.err;
    const json report = json::parse(readFile(folder / "report.json"));
    EXPECT_EQ(report["input"]["particles"], 512);
    EXPECT_NEAR(report["settings"]["voxel_size"].get<double>(), 0.31, 1e-6);
    EXPECT_TRUE(report["check"]["sound"].get<bool>());
    const Ended info = run(folder, {"mpuvdb", "info", "block.vdb", "--json"});
    const json described = json::parse(info.out);
    std::vector<std::string> names;
    for (const json& grid : described["files"][0]["grids"]) names.push_back(grid["name"]);
    EXPECT_EQ(names, (std::vector<std::string>{"age", "surface", "v"}));
    EXPECT_EQ(folder.names(),
              (std::vector<std::string>{"block.obj", "block.ply", "block.vdb", "report.json"}));
}

TEST_F(ParticlesVerb, ReadsStandardInputAndWritesTheSameBytesWithAnyThreads)
{
    const std::string text = block(6);
    command({"-", "-o", "one.vdb", "--threads", "1"}, 0, text);
    command({"-", "-o", "two.vdb", "--threads", "3"}, 0, text);
    EXPECT_TRUE(readFile(folder / "one.vdb") == readFile(folder / "two.vdb"));
}

TEST_F(ParticlesVerb, SpheresOfTouchingParticles)
{
    writeFile(folder / "block.xyz", block(6));
    command({"block.xyz", "-o", "balls.vdb", "--surface", "spheres", "--radius", "0.7",
             "--voxel-size", "0.1"});
}

TEST_F(ParticlesVerb, RefusesWhatItCannotUse)
{
    writeFile(folder / "bad.ply", ply(2, {"pscale"}, " 0"));
    EXPECT_NE(command({"bad.ply", "-o", "a.vdb"}, 3).err.find("--radius"), std::string::npos);
    writeFile(folder / "block.xyz", block(6));
    command({"block.xyz", "-o", "a.vdb", "--radius", "-1"}, 2);
    command({"block.xyz", "-o", "a.vdb", "--radius", "2vx"}, 2);
    command({"block.xyz", "-o", "a.vdb", "--surface", "lumpy"}, 2);
    command({"block.xyz", "-o", "a.vdb", "--attributes", "temperature"}, 3);
    command({"block.xyz", "-o", "a.vdb", "--voxel-size", "0.00001"}, 5);
    command({"missing.ply", "-o", "a.vdb"}, 3);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"bad.ply", "block.xyz"}));
}

TEST_F(ParticlesVerb, ReconstructNamesItWherePointsFillASolid)
{
    std::string ball;
    for (int x = -9; x <= 9; ++x)
        for (int y = -9; y <= 9; ++y)
            for (int z = -9; z <= 9; ++z)
                if (x * x + y * y + z * z < 81)
                    ball += std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) +
                            "\n";
    writeFile(folder / "ball.xyz", ball);
    const Ended ended = run(folder, {"mpuvdb", "reconstruct", "ball.xyz", "-o", "ball.vdb"});
    EXPECT_EQ(ended.status, 4);
    EXPECT_NE(ended.err.find("mpuvdb particles"), std::string::npos) << ended.err;
    command({"ball.xyz", "-o", "solid.vdb"});
}

} // namespace
} // namespace mpuvdb::test
