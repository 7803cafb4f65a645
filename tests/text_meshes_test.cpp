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

} // namespace
} // namespace mpuvdb::test
