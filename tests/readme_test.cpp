// Every command that the README tells its readers to type does what it should.
#include "command_process.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

namespace mpuvdb::test
{
namespace
{

/// The contents of the blocks fenced as "sh".
std::vector<std::string> shellBlocks(const std::string& markdown)
{
    std::vector<std::string> blocks;
    std::istringstream lines(markdown);
    bool inside = false;
    for (std::string line; std::getline(lines, line);) {
        if (line == "```sh")
            blocks.emplace_back();
        else if (inside && line != "```")
            blocks.back() += line + "\n";
        inside = line == "```sh" || (inside && line != "```");
    }
    return blocks;
}

TEST(Readme, CommandsRunInOrder)
{
    const std::string readme = readFile(MPUVDB_README);
    const std::vector<std::string> blocks = shellBlocks(readme);
    ASSERT_FALSE(blocks.empty());
    std::string all;
    const TemporaryFolder folder;
    const std::string path = std::filesystem::path(MPUVDB_COMMAND).parent_path();
    for (const std::string& block : blocks) {
        const Ended ended =
            run(folder, {"bash", "-euo", "pipefail", "-c", "PATH=" + path + ":$PATH\n" + block});
        EXPECT_EQ(ended.status, 0) << block << ended.err;
        all += block;
    }
    for (const char* verb :
         {"reconstruct", "voxelize",   "mesh",   "union", "intersection", "difference", "offset",
          "shell",       "smooth",     "morph",  "twist", "transform",    "resample",   "fog",
          "isosurface",  "components", "sample", "info",  "check",        "render"})
        EXPECT_NE(all.find(std::string("mpuvdb ") + verb), std::string::npos) << verb;
}

} // namespace
} // namespace mpuvdb::test
