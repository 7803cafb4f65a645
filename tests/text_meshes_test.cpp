// Meshes of text as programs vary them.
#include "io_fixture.h"

namespace mpuvdb::test
{
namespace
{

using TextMeshes = IoTest;

// Texts of STL begin with more than "solid", and binary ones with whatever a program wrote.
TEST_F(TextMeshes, StlIsTextByItsCharacters)
{
    std::string solid, binary = std::string(80, ' ') + bytesOf(std::uint32_t(1));
    for (const Sample& sample : samples())
        if (sample.name == "text.stl") solid = sample.bytes;
    ASSERT_EQ(solid.substr(0, 5), "solid");
    std::string indented = "  " + solid;
    for (std::size_t at = 0; (at = indented.find('\n', at)) + 1 < indented.size(); ++at)
        indented.insert(at + 1, "\t ");
    for (const std::string& text :
         {solid, "\xef\xbb\xbf" + solid, "\n" + solid, "\r\n\r\n" + solid, indented,
          "# exported by a program\n" + solid, concat("// ", std::string(300, 'c'), "\n", solid),
          "\xef\xbb\xbf\n # K\xc3\xb6rper\n" + solid, solid.substr(solid.find('\n') + 1),
          solid + "\n# the end\n", "SOLID" + solid.substr(5)}) {
        SCOPED_TRACE(text.substr(0, 40));
        const PointInput input = read("a.stl", text);
        EXPECT_EQ(input.cloud.size(), 4u);
        EXPECT_TRUE(input.cloud.hasNormals());
    }
    for (int i = 0; i < 12; ++i) binary += bytesOf(i == 3 || i == 7 ? 1.f : 0.f);
    binary += std::string(2, '\0');
    for (const char* head : {"solid a", "\n", "# a", "\xef\xbb\xbf", "facet"}) {
        SCOPED_TRACE(head);
        std::string bytes = binary;
        bytes.replace(0, std::strlen(head), head);
        EXPECT_EQ(read("b.stl", bytes).cloud.size(), 3u);
        EXPECT_NE(error("c.stl", bytes.substr(0, 120)).find("truncated"), std::string::npos);
    }
}

TEST_F(TextMeshes, CallsOfOtherFilesAreSaid)
{
    const std::string part = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    const auto notes = [&](const std::string& text) {
        const PointInput input = read("a.obj", text);
        std::string all;
        for (const std::string& note : input.notes) all += note + "\n";
        return all;
    };
    EXPECT_NE(notes(part + "call other.obj\n").find("line 5 calls 'other.obj'"), std::string::npos);
    EXPECT_NE(notes("# a set\ncall a.obj\n" + part + "call \"b.obj\" 7\n")
                  .find("line 2 calls 'a.obj', '\"b.obj\"'"),
              std::string::npos);
    EXPECT_EQ(notes("# call me\no call\n" + part).find("calls"), std::string::npos);
    Interrupter progress;
    readMesh(put("m.obj", part + "call other.obj\n"), &progress);
    ASSERT_FALSE(progress.notes().empty());
    EXPECT_NE(progress.notes()[0].find("'other.obj'"), std::string::npos);
}

} // namespace
} // namespace mpuvdb::test
