// Normals of contours and scan lines, whose nearest neighbors lie on one line.
#include "case_files.h"
#include "contour_stacks.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/reconstruct.h>

#include <gtest/gtest.h>
#include <openvdb/tools/LevelSetMeasure.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

using test::BentTube;
using test::contourStack;
using test::stackDirections;

/// Shares of estimated normals: of those that look to the other side, and of those more than 20
/// degrees off.
struct Wrong {
    double side = 0, angle = 0;
};

Wrong wrongOf(PointCloud cloud)
{
    const std::vector<Vec3f> truth = std::exchange(cloud.normals, {});
    Interrupter progress;
    const EstimatedNormals used = estimateNormals(cloud, {}, &progress);
    EXPECT_EQ(used.onLines, 0u);
    Wrong wrong;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const float cosine = truth[i].dot(cloud.normals[i]);
        wrong.side += (cosine < 0) / double(truth.size());
        wrong.angle += (std::abs(cosine) < std::cos(20 * M_PI / 180)) / double(truth.size());
    }
    return wrong;
}

TEST(ContourNormals, AreRightHoweverFarApartTheLinesAre)
{
    constexpr double kApart = 0.06;
    const std::vector<std::pair<std::string, std::shared_ptr<const Solid>>> solids{
        {"ball", parseSolid("sphere(1)")},
        {"torus", parseSolid("torus(1,0.4)")},
        {"bent tube", std::make_shared<BentTube>()}};
    for (const auto& [name, solid] : solids)
        for (const double ratio : {3, 5, 8})
            for (const Eigen::Matrix3d& axes : stackDirections()) {
                const Wrong wrong = wrongOf(contourStack(*solid, axes, kApart, kApart / ratio));
                EXPECT_LT(wrong.side, 0.002) << name << ' ' << ratio << ":1, along\n" << axes;
                EXPECT_LT(wrong.angle, 0.04) << name << ' ' << ratio << ":1, along\n" << axes;
            }
}

/// At a waist neighbors are bent both ways, and half of them lie exactly on a contour's own plane,
/// which is not the surface's.
TEST(ContourNormals, OfAVase)
{
    for (const auto& [rings, points] :
         {std::pair(20, 200), {15, 300}, {10, 200}, {10, 400}, {40, 100}})
        for (const double turn : {0.0, 0.3, 1.0, 1.7}) { // of each ring against the one below
            PointCloud cloud;
            for (int i = 0; i < rings; ++i)
                for (int k = 0; k < points; ++k) {
                    const double z = 3 * (i + 0.5) / rings, r = 1 + 0.3 * std::sin(3 * z),
                                 angle = 2 * M_PI * k / points + turn * i;
                    const Vec3d out(std::cos(angle), std::sin(angle), 0);
                    cloud.positions.push_back((r * out + Vec3d(0, 0, z)).cast<float>());
                    cloud.normals.push_back(
                        (out - Vec3d(0, 0, 0.9 * std::cos(3 * z))).normalized().cast<float>());
                }
            EXPECT_EQ(wrongOf(std::move(cloud)).side, 0) << rings << " rings, turn " << turn;
        }
}

TEST(ContourNormals, ScanLinesOverAField)
{
    const auto height = [](double x, double y) {
        return 0.15 * std::sin(3 * x) * std::cos(2 * y) + 0.3 * x;
    };
    for (const double ratio : {3, 8, 20}) {
        constexpr double kApart = 0.05, kStep = 1e-5;
        PointCloud cloud;
        for (double y = 0; y < 2; y += kApart)
            for (double x = 0; x < 2; x += kApart / ratio) {
                cloud.positions.push_back(Vec3d(x, y, height(x, y)).cast<float>());
                cloud.normals.push_back(Vec3d(height(x - kStep, y) - height(x + kStep, y),
                                              height(x, y - kStep) - height(x, y + kStep),
                                              2 * kStep)
                                            .normalized()
                                            .cast<float>());
            }
        const Wrong wrong = wrongOf(std::move(cloud));
        EXPECT_TRUE(wrong.side == 0 || wrong.side > 1 - 1e-9) << ratio; // which side is not known
        EXPECT_EQ(wrong.angle, 0) << ratio;
    }
}

double volumeOf(PointCloud cloud)
{
    return openvdb::tools::levelSetVolume(*reconstruct(std::move(cloud)).grid);
}

TEST(ContourNormals, GiveTheVolumeThatTrueOnesGive)
{
    for (const double ratio : {3, 8})
        for (const Eigen::Matrix3d& axes : stackDirections()) {
            PointCloud cloud = contourStack(BentTube(), axes, 0.06, 0.06 / ratio);
            const double with = volumeOf(cloud);
            cloud.normals.clear();
            EXPECT_NEAR(volumeOf(cloud), with, 0.05 * with) << ratio << ":1, along\n" << axes;
            EXPECT_NEAR(with, BentTube::volume(), 0.05 * with) << ratio << ":1, along\n" << axes;
        }
}

TEST(ContourNormals, OfTheCase)
{
    MPUVDB_CASE(file, "T09-contours-3to1.xyz");
    Interrupter progress;
    PointCloud cloud = readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud;
    EXPECT_NEAR(volumeOf(std::move(cloud)), 4 * M_PI / 3, 0.03);
}

/// Slices of a part, in millimeters and where the scanner's axes put it, as a file brings them.
TEST(ContourNormals, OfSlicesInAFile)
{
    constexpr double kScale = 120;
    PointCloud cloud = contourStack(BentTube(), stackDirections()[1], 0.06, 0.01);
    for (Vec3f& p : cloud.positions) p *= float(kScale);
    cloud.normals.clear();
    cloud.frame = Vec3d(-80, 340, 1205);
    const auto file = std::filesystem::path(testing::TempDir()) / "slices.ply";
    Interrupter progress;
    writePoints(file, cloud, &progress);
    const double volume = volumeOf(readPoints({file}, BadPoints::Drop, {}, {}, &progress).cloud);
    std::filesystem::remove(file);
    EXPECT_NEAR(volume / std::pow(kScale, 3), BentTube::volume(), 0.05 * BentTube::volume());
}

TEST(ContourNormals, LinesTooFarApartAreSaid)
{
    PointCloud lines, even;
    for (int line = 0; line < 8; ++line)
        for (int k = 0; k < 3000; ++k) {
            lines.positions.emplace_back(float(k), 2000 * float(line), 0.f);
            even.positions.emplace_back(float(k % 200), float(k / 200 + 15 * line), 0.f);
        }
    Interrupter progress;
    EXPECT_TRUE(clean(lines, {}, &progress).guessesNormals());
    const CleanReport report = clean(even, {}, &progress);
    EXPECT_EQ(report.onLines, 0);
    EXPECT_FALSE(report.guessesNormals());
}

} // namespace
} // namespace mpuvdb
