// The pages keep their word: commands that they tell their readers to type run, links lead
// somewhere.
#include "command_process.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <sstream>

namespace mpuvdb::test
{
namespace
{

const std::filesystem::path kSource = MPUVDB_SOURCE_DIR;

/// A page without its code, and its blocks of code.
struct Page {
    struct Block {
        std::string language, code;
    };
    std::string text; ///< lines outside of blocks
    std::vector<Block> blocks;

    explicit Page(const std::string& name)
    {
        std::istringstream lines(readFile(kSource / name));
        bool inside = false;
        for (std::string line; std::getline(lines, line);) {
            if (line.rfind("```", 0) == 0) {
                if (!inside) blocks.push_back({line.substr(3), {}});
                inside = !inside;
            } else if (inside) {
                blocks.back().code += line + "\n";
            } else {
                text += line + "\n";
            }
        }
    }
};

/// README.md and what docs/ holds, relative to the sources.
std::vector<std::string> pages()
{
    std::vector<std::string> found{"README.md"};
    for (const auto& entry : std::filesystem::directory_iterator(kSource / "docs"))
        if (entry.path().extension() == ".md")
            found.push_back("docs/" + entry.path().filename().string());
    std::sort(found.begin(), found.end());
    return found;
}

/// The pages that have commands.
std::vector<std::string> pagesOfCommands()
{
    std::vector<std::string> found;
    for (const std::string& name : pages()) {
        const Page page(name);
        if (std::any_of(page.blocks.begin(), page.blocks.end(),
                        [](const Page::Block& b) { return b.language == "sh"; }))
            found.push_back(name);
    }
    return found;
}

class PageCommands : public testing::TestWithParam<std::string>
{
};

TEST_P(PageCommands, RunInOrder)
{
    const TemporaryFolder folder;
    const std::string path = std::filesystem::path(MPUVDB_COMMAND).parent_path();
    for (const Page::Block& block : Page(GetParam()).blocks) {
        if (block.language != "sh") continue;
        const Ended ended = run(
            folder, {"bash", "-euo", "pipefail", "-c", "PATH=" + path + ":$PATH\n" + block.code});
        ASSERT_EQ(ended.status, 0) << block.code << ended.err;
    }
}

INSTANTIATE_TEST_SUITE_P(Readme, PageCommands, testing::ValuesIn(pagesOfCommands()),
                         [](const testing::TestParamInfo<std::string>& page) {
                             std::string name = std::filesystem::path(page.param).stem().string();
                             std::replace(name.begin(), name.end(), '-', '_');
                             return name;
                         });

TEST(Readme, PagesShowEveryVerb)
{
    std::string all;
    for (const std::string& name : pages())
        for (const Page::Block& block : Page(name).blocks)
            if (block.language == "sh") all += block.code;
    const TemporaryFolder folder;
    std::istringstream help(run(folder, {"mpuvdb", "--help"}).out);
    std::string line, verb;
    while (std::getline(help, line) && line != "Verbs:") {
    }
    int verbs = 0;
    while (std::getline(help, line) && std::istringstream(line) >> verb) {
        ++verbs;
        EXPECT_NE(all.find("mpuvdb " + verb + " "), std::string::npos) << verb;
    }
    EXPECT_GE(verbs, 20);
}

// Blocks of other languages would be run by nobody: text is output, console what changes a machine.
TEST(Readme, BlocksAreOfLanguagesThatTestsRun)
{
    const std::set<std::string> known{"sh", "python", "cpp", "cmake", "text", "console"};
    for (const std::string& name : pages())
        for (const Page::Block& block : Page(name).blocks)
            EXPECT_EQ(known.count(block.language), 1) << name << ": " << block.code;
}

TEST(Readme, IsShort)
{
    std::istringstream lines(readFile(kSource / "README.md"));
    int count = 0;
    for (std::string line; std::getline(lines, line); ++count) {
        const auto characters = std::count_if(line.begin(), line.end(), [](char c) {
            return (static_cast<unsigned char>(c) & 0xc0) != 0x80; // else UTF-8 goes on
        });
        EXPECT_LE(characters, 160) << line;
    }
    EXPECT_LE(count, 150);
}

} // namespace
} // namespace mpuvdb::test
