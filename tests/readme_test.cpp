// The pages keep their word: commands that they tell their readers to type run, links lead
// somewhere.
#include "command_process.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <regex>
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

    /// Names of the headings in links, as forges make them.
    std::set<std::string> anchors() const
    {
        std::set<std::string> found;
        std::istringstream lines(text);
        for (std::string line; std::getline(lines, line);) {
            if (line.rfind('#', 0) != 0) continue;
            std::string anchor;
            for (const char c : line.substr(line.find_first_not_of("# "))) {
                if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_')
                    anchor += char(std::tolower(static_cast<unsigned char>(c)));
                else if (c == ' ')
                    anchor += '-';
            }
            found.insert(anchor);
        }
        return found;
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

TEST(Readme, LinksLeadSomewhere)
{
    std::vector<std::string> all = pages();
    all.insert(all.end(), {"CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md",
                           "houdini_free_examples/README.md"});
    const std::regex link(R"(\]\(([^)#\s]*)(#[^)\s]*)?\))");
    int links = 0;
    for (const std::string& name : all) {
        const std::string text = Page(name).text;
        for (std::sregex_iterator at(text.begin(), text.end(), link), end; at != end; ++at) {
            const std::string target = (*at)[1], anchor = (*at)[2];
            if (target.find("://") != std::string::npos) continue;
            ++links;
            const std::filesystem::path file =
                target.empty() ? std::filesystem::path(name)
                               : std::filesystem::path(name).parent_path() / target;
            ASSERT_TRUE(std::filesystem::exists(kSource / file)) << name << ": " << target;
            if (!anchor.empty()) {
                EXPECT_EQ(Page(file.string()).anchors().count(anchor.substr(1)), 1)
                    << name << ": " << target << anchor;
            }
        }
    }
    EXPECT_GT(links, 40);
}

} // namespace
} // namespace mpuvdb::test
