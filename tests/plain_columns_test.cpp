// Columns without names: what their numbers can be, and what they cannot.
#include "io_fixture.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace mpuvdb::test
{
namespace
{

using PlainColumns = IoTest;

// Whole numbers that are no bytes, between black and white of 16 bits, with what stands beside
// them.
TEST_F(PlainColumns, ColorsOf16BitsAreToldFromNormals)
{
    const auto rows = [](const std::string& separator, bool intensity, bool normals, int largest) {
        std::string text;
        for (int i = 0; i < 60; ++i) {
            const auto add = [&](const std::string& value) { text += separator + value; };
            text += std::to_string(0.25 * (i % 8));
            add(std::to_string(i / 8));
            add("-1.5");
            if (intensity) add(std::to_string(i * 700));
            for (int c = 1; c <= 3; ++c) add(std::to_string(i * c % 6 * largest / 5));
            if (normals) text += concat(separator, "0", separator, "0", separator, "1");
            text += "\n";
        }
        return text;
    };
    for (const char* separator : {" ", ";", ",", "\t"})
        for (const bool intensity : {false, true})
            for (const bool normals : {false, true}) {
                SCOPED_TRACE(
                    concat(separator, intensity ? "intensity" : "", normals ? "normals" : ""));
                const PointCloud cloud =
                    read("a.xyz", rows(separator, intensity, normals, 65535)).cloud;
                EXPECT_EQ(cloud.hasNormals(), normals);
                ASSERT_EQ(cloud.colors.size(), 60u);
                EXPECT_EQ(cloud.colors[1], (PointCloud::Rgb{51, 102, 153}));
                EXPECT_EQ(cloud.colors[5], (PointCloud::Rgb{255, 204, 153}));
            }
    EXPECT_FALSE(read("dark.xyz", rows(" ", false, false, 1000)).cloud.hasNormals());
    // Larger numbers, negative ones and fractions are no colors.
    const auto both = [&](const std::string& triple) {
        return read("n.xyz", concat("0 0 0 ", triple, "\n1 2 3 300 0 0\n")).cloud;
    };
    EXPECT_TRUE(both("100000 2 3").hasNormals());
    EXPECT_TRUE(both("-300 0 0").hasNormals());
    EXPECT_TRUE(both("0 299.5 0").hasNormals());
    // A number that follows three others is no color's end.
    EXPECT_TRUE(
        read("s.xyz", "0 0 0 300 2 3 400 0.5\n1 2 3 400 5 6 700 0.5\n").cloud.colors.empty());
}

} // namespace
} // namespace mpuvdb::test
