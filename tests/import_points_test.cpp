// Points from memory, and what is done to them before the fit.
#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>

#include <limits>

namespace mpuvdb
{
namespace
{

PointCloud sphere(std::uint64_t points)
{
    ScanSettings settings;
    settings.points = points;
    Interrupter progress;
    return scan(*parseSolid("sphere(1)"), settings, &progress);
}

PointArrays arraysOf(const PointCloud& cloud)
{
    PointArrays arrays;
    for (std::size_t i = 0; i < cloud.size(); ++i) arrays.positions.push_back(cloud.world(i));
    arrays.normals = cloud.normals;
    return arrays;
}

TEST(ImportPoints, AreThoseGiven)
{
    const PointCloud cloud = sphere(500);
    PointArrays arrays = arraysOf(cloud);
    for (Vec3f& n : arrays.normals) n *= 3;
    arrays.confidence.assign(cloud.size(), 5);
    Interrupter progress;
    const PointInput input = importPoints(std::move(arrays), "mine", BadPoints::Fail, &progress);
    ASSERT_EQ(input.cloud.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_LT((input.cloud.world(i) - cloud.world(i)).norm(), 1e-6);
        EXPECT_LT((input.cloud.normals[i] - cloud.normals[i]).norm(), 1e-6);
        EXPECT_EQ(input.cloud.confidence[i], 1);
    }
    EXPECT_TRUE(input.dropped.empty());
}

TEST(ImportPoints, LeavesOutWhatCannotBeUsed)
{
    const PointCloud cloud = sphere(500);
    PointArrays arrays = arraysOf(cloud);
    arrays.positions[3].x() = std::numeric_limits<double>::quiet_NaN();
    arrays.normals[5].setZero();
    arrays.positions.push_back(arrays.positions[0]);
    arrays.normals.push_back(arrays.normals[0]);
    const PointArrays same = arrays;
    Interrupter progress;
    const PointInput input = importPoints(std::move(arrays), "mine", BadPoints::Drop, &progress);
    EXPECT_EQ(input.cloud.size(), cloud.size() - 2);
    const std::map<std::string, std::uint64_t> dropped = {
        {"not finite", 1}, {"zero normal", 1}, {"duplicate", 1}};
    EXPECT_EQ(input.dropped, dropped);
    EXPECT_THROW(importPoints(PointArrays(same), "mine", BadPoints::Fail, &progress), InputError);
}

TEST(ImportPoints, WantsOneNormalForEach)
{
    PointArrays arrays = arraysOf(sphere(500));
    arrays.normals.pop_back();
    Interrupter progress;
    EXPECT_THROW(importPoints(std::move(arrays), "mine", BadPoints::Drop, &progress), UsageError);
    EXPECT_THROW(importPoints({}, "mine", BadPoints::Drop, &progress), InputError);
}

TEST(ImportPoints, KnowsTheViewpoint)
{
    PointArrays arrays = arraysOf(sphere(500));
    arrays.viewpoint = Vec3d(0, 0, 5);
    Interrupter progress;
    const PointCloud cloud =
        importPoints(std::move(arrays), "mine", BadPoints::Drop, &progress).cloud;
    ASSERT_EQ(cloud.seenFrom.size(), cloud.size());
    EXPECT_EQ(cloud.viewpoints.at(cloud.seenFrom[0]).place, Vec3d(0, 0, 5));
}

TEST(Clean, SaysWhatItDid)
{
    PointCloud cloud = sphere(5000);
    for (std::size_t i = 0; i < cloud.size(); i += 40) cloud.normals[i] *= -1;
    cloud.positions[7] *= 4;
    Interrupter progress;
    const CleanReport report = clean(cloud, {}, &progress);
    EXPECT_EQ(report.outliers, 1u);
    EXPECT_NEAR(double(report.flipped), double(cloud.size()) / 40, 2);
    EXPECT_TRUE(report.hadNormals);
    EXPECT_FALSE(report.estimateNeighbors);
    EXPECT_FALSE(report.inward);
    for (std::size_t i = 0; i < cloud.size(); ++i)
        EXPECT_GT(cloud.normals[i].dot(cloud.world(i).cast<float>()), 0);
}

TEST(Clean, DoesWhatItIsTold)
{
    PointCloud cloud = sphere(5000);
    const std::size_t count = cloud.size();
    cloud.positions[7] *= 4;
    cloud.normals[3] *= -1;
    CleanSettings settings;
    settings.dropOutliers = false;
    settings.normals = NormalsFrom::Keep;
    settings.flipNormals = true;
    Interrupter progress;
    const PointCloud before = cloud;
    CleanReport report = clean(cloud, settings, &progress);
    EXPECT_EQ(cloud.size(), count);
    for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(cloud.normals[i], -before.normals[i]);
    EXPECT_EQ(report.outliers + report.flipped, 0u);

    settings.flipNormals = false;
    EXPECT_TRUE(clean(cloud, settings, &progress).inward);
    settings.normals = NormalsFrom::Estimate;
    report = clean(cloud, settings, &progress);
    EXPECT_TRUE(report.estimateNeighbors);
    EXPECT_EQ(report.statistics.normalNoise, 0);
    EXPECT_FALSE(report.inward);
}

} // namespace
} // namespace mpuvdb
