#include "render/digits.h"
#include "render/histogram.h"
#include "render/picture.h"
#include "solid_level_set.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <png.h>
#include <tbb/global_control.h>

#include <cmath>
#include <fstream>
#include <set>
#include <stdlib.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;
using openvdb::FloatGrid;

LevelSet sphere(const openvdb::Vec3d& at = openvdb::Vec3d(0), float halfWidth = 3)
{
    const auto grid =
        openvdb::tools::createLevelSetSphere<FloatGrid>(1, openvdb::Vec3f(0), 0.05f, halfWidth);
    grid->transform().postTranslate(at);
    return LevelSet(grid);
}

struct Picture {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;

    const std::uint8_t* pixel(int x, int y) const { return &rgb[3 * (std::size_t(y) * width + x)]; }
    bool isGray(int x, int y) const
    {
        return pixel(x, y)[0] == pixel(x, y)[1] && pixel(x, y)[1] == pixel(x, y)[2];
    }
};

Picture load(const fs::path& file)
{
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    Picture picture;
    EXPECT_TRUE(png_image_begin_read_from_file(&image, file.c_str())) << image.message;
    EXPECT_EQ(image.format, png_uint_32(PNG_FORMAT_RGB));
    picture.width = int(image.width);
    picture.height = int(image.height);
    picture.rgb.resize(PNG_IMAGE_SIZE(image));
    EXPECT_TRUE(png_image_finish_read(&image, nullptr, picture.rgb.data(), 0, nullptr));
    return picture;
}

class PictureFile : public ::testing::Test
{
protected:
    void SetUp() override
    {
        std::string name = (fs::temp_directory_path() / "mpuvdb-XXXXXX").string();
        ASSERT_TRUE(::mkdtemp(name.data()));
        mFolder = name;
    }
    void TearDown() override { fs::remove_all(mFolder); }

    Picture pictureOf(const LevelSet& levelSet, const PictureSettings& settings)
    {
        Interrupter progress;
        writePicture(mFolder / "a.png", levelSet, settings, &progress);
        return load(mFolder / "a.png");
    }

    fs::path mFolder;
};

PictureSettings small()
{
    PictureSettings settings;
    settings.width = 160;
    settings.height = 120;
    return settings;
}

TEST_F(PictureFile, ShowsARoundLitSphereBeforeTheBackground)
{
    for (const float halfWidth : {2.f, 3.f, 8.f}) {
        const Picture picture = pictureOf(sphere(openvdb::Vec3d(0), halfWidth), small());
        ASSERT_EQ(picture.width, 160);
        ASSERT_EQ(picture.height, 120);
        // The background is gray, the sphere is tinted by its lights.
        EXPECT_TRUE(picture.isGray(0, 0));
        EXPECT_TRUE(picture.isGray(159, 119));
        EXPECT_GT(picture.pixel(0, 0)[0], picture.pixel(0, 119)[0]);
        // Some of its pixels may happen to be gray, so that only the outermost ones count.
        int left = 0, right = 159, top = 0, bottom = 119;
        while (left < right && picture.isGray(left, 60)) ++left;
        while (right > left && picture.isGray(right, 60)) --right;
        while (top < bottom && picture.isGray(80, top)) ++top;
        while (bottom > top && picture.isGray(80, bottom)) --bottom;
        const int columns = right - left, rows = bottom - top;
        EXPECT_NEAR(columns, rows, 3);
        EXPECT_GT(rows, 80);
        EXPECT_LT(rows, 116);
        // The key light comes from the upper left.
        EXPECT_GT(picture.pixel(60, 40)[0], picture.pixel(100, 80)[0] + 30);
    }
}

TEST_F(PictureFile, DependsNeitherOnPlaceNorThreads)
{
    const Picture near = pictureOf(sphere(), small());
    EXPECT_EQ(pictureOf(sphere(openvdb::Vec3d(5e6, -5e6, 5e6)), small()).rgb, near.rgb);
    for (const std::size_t threads : {1, 2, 8}) {
        tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        EXPECT_EQ(pictureOf(sphere(), small()).rgb, near.rgb);
    }
}

/// What stands upright on the ground of either world looks the same.
TEST_F(PictureFile, UpIsYOrZ)
{
    const auto cap = [](bool isZUp) {
        const auto at =
            isZUp ? openvdb::Vec3f(0.6f, -0.3f, 0.9f) : openvdb::Vec3f(0.6f, 0.9f, 0.3f);
        const auto part = openvdb::tools::createLevelSetSphere<FloatGrid>(0.4f, at, 0.05f, 3);
        const auto whole =
            openvdb::tools::createLevelSetSphere<FloatGrid>(1, openvdb::Vec3f(0), 0.05f, 3);
        openvdb::tools::csgUnion(*whole, *part);
        return LevelSet(whole);
    };
    PictureSettings yUp = small(), zUp = small();
    zUp.up = UpAxis::Z;
    const Picture y = pictureOf(cap(false), yUp), z = pictureOf(cap(true), zUp),
                  lying = pictureOf(cap(true), yUp);
    const auto difference = [](const Picture& a, const Picture& b) {
        double sum = 0;
        for (std::size_t n = 0; n < a.rgb.size(); ++n) sum += std::abs(double(a.rgb[n]) - b.rgb[n]);
        return sum / double(a.rgb.size());
    };
    // The lattice is another one from there: normals and edges differ a little.
    EXPECT_LT(4 * difference(y, z), difference(y, lying));
}

TEST_F(PictureFile, DoesNotDependOnTheVoxelsSize)
{
    constexpr float kScale = 1024; // a power of two rounds nothing
    const auto grid = openvdb::tools::createLevelSetSphere<FloatGrid>(kScale, openvdb::Vec3f(0),
                                                                      0.05f * kScale, 3);
    EXPECT_EQ(pictureOf(sphere(), small()).rgb, pictureOf(LevelSet(grid), small()).rgb);
}

TEST_F(PictureFile, ShowsNothingForNothing)
{
    const auto grid = FloatGrid::create(3);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    const Picture picture = pictureOf(LevelSet(grid), small());
    EXPECT_TRUE(picture.isGray(80, 60));
}

TEST_F(PictureFile, ShowsThinWallsWhole)
{
    // A turned plate of one voxel that fills the middle of the picture, in one color.
    const double h = 0.05;
    PictureSettings settings = small();
    settings.elevation = 90;
    settings.up = UpAxis::Z;
    const Picture picture = pictureOf(
        test::solidLevelSet(fmt::format("rotate(box(2,2,{}),1,2,0.5,12)", h), h), settings);
    for (int y = 40; y < 80; ++y)
        for (int x = 60; x < 100; ++x)
            EXPECT_NEAR(picture.pixel(x, y)[0], picture.pixel(80, 60)[0], 8) << x << " " << y;
}

TEST_F(PictureFile, CanBeTakenFromEverywhere)
{
    PictureSettings settings = small();
    settings.width = 16;
    for (const double elevation : {-90.0, 90.0})
        for (const double azimuth : {-360.0, 0.0, 135.0}) {
            settings.azimuth = azimuth;
            settings.elevation = elevation;
            const Picture picture = pictureOf(sphere(), settings);
            EXPECT_NE(picture.pixel(8, 60)[0], picture.pixel(0, 60)[0]); // the background
        }
}

TEST_F(PictureFile, RefusesNonsenseAndStops)
{
    Interrupter progress;
    PictureSettings settings = small();
    settings.width = 15;
    EXPECT_THROW(writePicture(mFolder / "b.png", sphere(), settings, &progress), UsageError);
    settings = small();
    settings.height = 8193;
    EXPECT_THROW(writePicture(mFolder / "b.png", sphere(), settings, &progress), UsageError);
    settings = small();
    settings.azimuth = std::nan("");
    EXPECT_THROW(writePicture(mFolder / "b.png", sphere(), settings, &progress), UsageError);
    EXPECT_THROW(writePicture(mFolder / "no" / "b.png", sphere(), small(), &progress), IoError);
    progress.stop();
    EXPECT_THROW(writePicture(mFolder / "b.png", sphere(), small(), &progress), Interrupted);
    EXPECT_TRUE(fs::is_empty(mFolder));
}

/// The dark pixels of a text, as rows of a picture.
std::set<std::pair<int, int>> pixelsOf(const std::string& text)
{
    std::set<std::pair<int, int>> pixels;
    drawDigits(text, [&](int column, int row) { pixels.emplace(column, row); });
    return pixels;
}

TEST(Digits, AreDifferentAndFitTheirSize)
{
    const std::string all = "0123456789-+.e";
    std::set<std::set<std::pair<int, int>>> found;
    for (const char c : all) {
        const auto pixels = pixelsOf(std::string(1, c));
        EXPECT_FALSE(pixels.empty()) << c;
        found.insert(pixels);
        for (const auto& [column, row] : pixels) {
            EXPECT_TRUE(column >= 0 && column < textWidth(std::string(1, c))) << c;
            EXPECT_TRUE(row >= 0 && row < kDigitHeight) << c;
        }
    }
    EXPECT_EQ(found.size(), all.size());
    EXPECT_EQ(pixelsOf("11").size(), 2 * pixelsOf("1").size());
    EXPECT_TRUE(pixelsOf(" ").empty());
}

TEST_F(PictureFile, HistogramsHaveNumbersAtTheirTicks)
{
    const fs::path file = mFolder / "h.png";
    std::vector<float> values;
    for (int n = -100; n <= 100; ++n) values.push_back(0.0025f * float(n));
    writeHistogram(file, values, 0.25);
    const Picture picture = load(file);
    ASSERT_EQ(picture.width, 800);
    ASSERT_EQ(picture.height, 400);
    // Below the ticks there are numbers alone.
    const auto dark = [&](int from, int to) {
        std::size_t count = 0;
        for (int y = picture.height - kDigitHeight * 2 - 4; y < picture.height; ++y)
            for (int x = from; x < to; ++x) count += picture.pixel(x, y)[0] < 128;
        return count;
    };
    const std::size_t pixel = 4; // of the picture, in one of the font
    EXPECT_EQ(dark(0, 100), pixel * pixelsOf("-0.25").size());
    EXPECT_EQ(dark(100, 350), pixel * pixelsOf("-0.125").size());
    EXPECT_EQ(dark(350, 450), pixel * pixelsOf("0").size());
    EXPECT_EQ(dark(450, 700), pixel * pixelsOf("0.125").size());
    EXPECT_EQ(dark(700, 800), pixel * pixelsOf("0.25").size());
    writeHistogram(file, values, 1.2345e-7); // long numbers stay in the picture
    EXPECT_EQ(load(file).width, 800);
}

} // namespace
} // namespace mpuvdb
