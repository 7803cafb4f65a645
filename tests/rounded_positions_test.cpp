// Positions rounded far above the points' spacing are said, and what only looks like them is not.
#include "case_files.h"
#include "io_fixture.h"

#include <fmt/format.h>

#include <cmath>
#include <random>

namespace mpuvdb::test
{
namespace
{

using Points = std::vector<Vec3d>;

Points ball(double radius, std::size_t count, const Vec3d& center = Vec3d::Zero())
{
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    Points points(count);
    for (Vec3d& p : points)
        p = center + radius * Vec3d(normal(random), normal(random), normal(random)).normalized();
    return points;
}

Points rounded(Points points, const Vec3d& steps)
{
    for (Vec3d& p : points)
        for (int a = 0; a < 3; ++a)
            if (steps[a] > 0) p[a] = std::round(p[a] / steps[a]) * steps[a];
    return points;
}

std::string text(const Points& points, const std::string& format = "{} {} {}\n")
{
    std::string all;
    for (const Vec3d& p : points) all += fmt::format(fmt::runtime(format), p.x(), p.y(), p.z());
    return all;
}

std::string floatPly(const Points& points)
{
    std::string s = fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
                                "property float x\nproperty float y\nproperty float z\n"
                                "end_header\n",
                                points.size());
    for (const Vec3d& p : points)
        for (int a = 0; a < 3; ++a) s += bytesOf(float(p[a]));
    return s;
}

std::string lasOfScale(const Points& points, double scale)
{
    std::string s(227, '\0');
    const auto set = [&](std::size_t at, const std::string& bytes) {
        s.replace(at, bytes.size(), bytes);
    };
    set(0, "LASF");
    s[24] = 1;
    s[25] = 2;
    set(94, bytesOf(std::uint16_t(227)));
    set(96, bytesOf(std::uint32_t(227)));
    set(105, bytesOf(std::uint16_t(20)));
    set(107, bytesOf(std::uint32_t(points.size())));
    for (int a = 0; a < 3; ++a) set(131 + 8 * std::size_t(a), bytesOf(scale));
    for (const Vec3d& p : points) {
        for (int a = 0; a < 3; ++a) s += bytesOf(std::int32_t(std::lround(p[a] / scale)));
        s += std::string(8, '\0');
    }
    return s;
}

class RoundedPositions : public IoTest
{
protected:
    void expectSaid(const std::string& name, const std::string& bytes,
                    const std::vector<std::string>& texts)
    {
        const PointInput input = read(name, bytes);
        ASSERT_EQ(input.warnings.size(), 1u) << name;
        for (const std::string& said : texts)
            EXPECT_NE(input.warnings[0].find(said), std::string::npos) << input.warnings[0];
    }
    void expectQuiet(const char* what, const Points& points)
    {
        for (const std::string& warning : read("a.xyz", text(points)).warnings)
            ADD_FAILURE() << what << ": " << warning;
    }
};

TEST_F(RoundedPositions, OfTheCaseAreSaid)
{
    MPUVDB_CASE(file, "T25-utm-in-float32.ply");
    Interrupter progress;
    const PointInput input = readPoints({file}, BadPoints::Drop, {}, {}, &progress);
    ASSERT_EQ(input.warnings.size(), 1u);
    for (const char* said :
         {"0.03125 in x and 0.25 in y", "floats of 32 bits", "subtract an offset"})
        EXPECT_NE(input.warnings[0].find(said), std::string::npos) << input.warnings[0];
}

// The kind, in other formats and of other causes.
TEST_F(RoundedPositions, AreSaidWhateverTheyCameAs)
{
    const Points far = ball(4, 20000, {412345.678, 5412345.678, 210.5});
    expectSaid("utm.ply", floatPly(far), {"utm.ply: ", "0.5 in y", "subtract an offset"});
    const Points large = ball(20, 60000, {7, 3, 1});
    expectSaid("whole.xyz", text(large, "{:.0f} {:.0f} {:.0f}\n"),
               {"1 in x and 1 in y and 1 in z", "more decimals"});
    expectSaid("tenths.csv", "x,y,z\n" + text(ball(1, 40000), "{:.1f},{:.1f},{:.1f}\n"),
               {"0.1 in x and 0.1 in y and 0.1 in z", "more decimals"});
    expectSaid("whole.las", lasOfScale(large, 1),
               {"1 in x and 1 in y and 1 in z", "smaller scale"});
    // More points than are looked at closely.
    const Points many = ball(50, 300000);
    expectSaid("many.las", lasOfScale(many, 1), {"1 in x and 1 in y and 1 in z"});
    EXPECT_TRUE(read("many.las", lasOfScale(many, 0.001)).warnings.empty());
    // One axis, two axes.
    expectSaid("z.xyz", text(rounded(ball(1, 20000), {0, 0, 0.25})), {"0.25 in z"});
    expectSaid("xy.xyz", text(rounded(ball(1, 20000), {0.1, 0.1, 0})), {"0.1 in x and 0.1 in y"});
    const Points terrain = [] {
        std::mt19937 random(2);
        std::uniform_real_distribution<double> uniform(0, 50);
        Points points(60000);
        for (Vec3d& p : points) {
            p = {uniform(random), uniform(random), 0};
            p.z() = 2 * std::sin(p.x() / 5) + std::cos(p.y() / 7);
        }
        return points;
    }();
    expectSaid("terrain.las", lasOfScale(terrain, 1), {"1 in x and 1 in y and 1 in z"});
    expectSaid("terrain.xyz", text(rounded(terrain, {1, 1, 0})), {"1 in x and 1 in y"});
}

// Floats give themselves away also where layers are lines: on gentle ground, on walls.
TEST_F(RoundedPositions, OfFloatsAreSaidOnFlatSurfaces)
{
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(0, 1);
    Points ground, house;
    for (int i = 0; i < 40000; ++i) {
        const double x = 20 * uniform(random), y = 20 * uniform(random);
        ground.emplace_back(412345 + x, 5412345 + y, 210 + 0.2 * std::sin(x / 3));
        Vec3d p(uniform(random), uniform(random), uniform(random));
        p[i % 2] = i / 2 % 2;
        house.push_back(Vec3d(412345, 5412345, 210) + p.cwiseProduct(Vec3d(10, 8, 6)));
    }
    expectSaid("ground.ply", floatPly(ground), {"0.5 in y", "subtract an offset"});
    expectSaid("house.ply", floatPly(house), {"0.5 in y", "subtract an offset"});
    EXPECT_TRUE(read("exact.xyz", text(ground)).warnings.empty());
}

TEST_F(RoundedPositions, OfArraysAreSaid)
{
    std::vector<Vec3f> positions;
    for (const Vec3d& p : ball(4, 20000, {412345.678, 5412345.678, 210.5}))
        positions.push_back(p.cast<float>());
    const PointInput input = importPoints(positions);
    ASSERT_EQ(input.warnings.size(), 1u);
    EXPECT_NE(input.warnings[0].find("0.5 in y"), std::string::npos) << input.warnings[0];
}

TEST_F(RoundedPositions, AreNotWhatIsRoundedBelowTheSpacing)
{
    for (const double step : {0.001, 0.01, 0.02}) // the spacing is 0.025
        expectQuiet("a ball", rounded(ball(1, 20000), Vec3d::Constant(step)));
    const Points far = ball(4, 20000, {412345.678, 412345.678, 210.5});
    EXPECT_TRUE(read("utm.ply", floatPly(far)).warnings.empty());
}

TEST_F(RoundedPositions, AreNotVoxelsAndRasters)
{
    Points solid, skin, slices, raster;
    for (int x = -20; x <= 20; ++x)
        for (int y = -20; y <= 20; ++y) {
            raster.emplace_back(x, y, 5 * std::sin(x / 7.0) + std::cos(y / 3.0));
            for (int z = -20; z <= 20; ++z) {
                const double r = Vec3d(x, y, z).norm();
                if (r <= 20) solid.emplace_back(x, y, z);
                if (r <= 20 && r > 19) skin.emplace_back(x, y, z);
                if (Vec3d(x, y, 8 * z).norm() <= 60) slices.emplace_back(x, y, 8 * z);
            }
        }
    expectQuiet("voxels of a solid", solid);
    expectQuiet("voxels of a surface", skin);
    expectQuiet("voxels of a tomograph, eight times as high as wide", slices);
    expectQuiet("a raster", raster);
}

TEST_F(RoundedPositions, AreNotSlicesAndLines)
{
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(0, 1);
    for (const double apart : {3.0, 10.0, 80.0})
        for (const bool regular : {true, false}) {
            Points contours, lines;
            const int layers = 12;
            const double step = 2.0 / layers, along = step / apart;
            for (int layer = 1; layer < layers; ++layer) {
                const double z = -1 + layer * step, r = std::sqrt(1 - z * z);
                const int count = int(2 * M_PI * r / along);
                for (int i = 0; i < count; ++i) {
                    const double angle = 2 * M_PI * (regular ? double(i) / count : uniform(random));
                    contours.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
                }
                for (int i = 0; i < int(2 / along); ++i) {
                    const double x = regular ? i * along : 2 * uniform(random);
                    lines.emplace_back(x, layer * step, 0.3 * std::sin(3 * x) * std::cos(2 * z));
                }
            }
            expectQuiet("contours", contours);
            expectQuiet("lines of a survey", lines);
        }
}

TEST_F(RoundedPositions, AreNotFacesInPlanes)
{
    std::mt19937 random(4);
    std::uniform_real_distribution<double> uniform(0, 1);
    Points boxes, plates, regular;
    for (int i = 0; i < 30000; ++i) { // faces of boxes whose corners are whole
        const int axis = i % 3, box = i / 6 % 4;
        Vec3d p(uniform(random), uniform(random), uniform(random));
        p[axis] = i / 3 % 2;
        boxes.push_back(p + Vec3d(box, 2 * box, 3 * box));
    }
    for (int i = 0; i < 20000; ++i) // a plate's faces
        plates.emplace_back(uniform(random), uniform(random), 0.1 * (i % 2));
    for (int x = 0; x <= 40; ++x)
        for (int y = 0; y <= 40; ++y)
            for (int side = 0; side < 2; ++side) {
                regular.emplace_back(x, y, 40 * side);
                regular.emplace_back(40 * side, x, y);
                regular.emplace_back(x, 40 * side, y);
            }
    expectQuiet("boxes", boxes);
    expectQuiet("a plate", plates);
    expectQuiet("a box's raster", regular);
}

TEST_F(RoundedPositions, AreNotInRealScans)
{
    const char* const folder = std::getenv("MPUVDB_DATA_DIR");
    if (!folder) GTEST_SKIP() << "MPUVDB_DATA_DIR is not set";
    std::size_t files = 0;
    for (const char* sub : {"bunny", "berger", "dragon_stand", "clouds", "cad"})
        for (const auto& entry :
             std::filesystem::directory_iterator(std::filesystem::path(folder) / sub)) {
            const std::string extension = entry.path().extension().string();
            if (extension.empty() || extension == ".conf") continue;
            Interrupter progress;
            for (const std::string& warning :
                 readPoints({entry.path()}, BadPoints::Drop, {}, {}, &progress).warnings)
                ADD_FAILURE() << warning;
            ++files;
        }
    EXPECT_GT(files, 40u);
}

} // namespace
} // namespace mpuvdb::test
