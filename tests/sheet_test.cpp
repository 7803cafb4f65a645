// Sheets fitted to noisy points: bias, variance, membership, and the means that they are fitted to.
#include "mpu/fit/sheet.h"
#include "mpu/octree/mean_pyramid.h"
#include "noisy_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mpuvdb
{
namespace
{

using test::append;
using test::normalDraw;
using test::Random;

constexpr std::uint64_t kSeed = 20261125;

Vec3d normalVector(Random& random)
{
    const double x = normalDraw(random), y = normalDraw(random), z = normalDraw(random);
    return {x, y, z};
}

PointNoise noiseOf(double sigma, double tau)
{
    PointNoise noise;
    noise.sigma = sigma;
    noise.tau = tau;
    noise.lever = sigma / tau;
    return noise;
}

/// Points of the top of the unit sphere, relative to it, thrown along the normals, or any way.
CellPoints thrownOffSphere(std::size_t count, double sigma, double tau, double reach, bool anyWay,
                           Random& random)
{
    PointBatch batch;
    while (batch.size() < count) {
        const Vec3d n = random.direction();
        const Vec3d off =
            anyWay ? Vec3d(sigma * normalVector(random)) : Vec3d(sigma * normalDraw(random) * n);
        const Vec3d p = n + off - Vec3d::UnitZ();
        if (n[2] < 0 || p.norm() >= reach + 5 * sigma) continue;
        append(batch, p, (n + tau * normalVector(random)).normalized());
    }
    CellPoints points;
    points.assign(batch, Vec3d::Zero(), reach + 5 * sigma);
    return points;
}

/// Mean height over the top of the sphere of sheets grown in @a trials samples, and its standard
/// error.
struct MeanHeight {
    double mean = 0, error = 0;
};

MeanHeight meanHeight(bool anyWay, double tangential, Random& random)
{
    constexpr double kSigma = 0.1, kTau = 0.1, kReach = 0.5;
    constexpr int kTrials = 300;
    PointNoise noise = noiseOf(kSigma, kTau);
    CellPoints scratch;
    double sum = 0, squares = 0;
    for (int trial = 0; trial < kTrials; ++trial) {
        const CellPoints points = thrownOffSphere(600, kSigma, kTau, kReach, anyWay, random);
        Sheet sheet = growSheet(points, planeSheet(Vec3d::Zero(), Vec3d::UnitZ()), 0.3 * kReach,
                                kReach, noise, scratch);
        sheet = overFeet(sheet, kReach, noise, scratch);
        noise.tangential = tangential;
        removeTangentialBias(sheet, noise);
        const double height = heightOver(sheet, Vec3d::Zero(), Vec3d::UnitZ());
        sum += height, squares += height * height;
    }
    const double mean = sum / kTrials;
    return {mean, std::sqrt((squares / kTrials - mean * mean) / kTrials)};
}

// Noise along the normals makes points sparse outside and dense inside: heights over a plane have a
// mean that is too low by twice the variance over the radius. Over their feet they have none.
TEST(Sheet, NoiseAlongNormalsMovesNoCurvedSheet)
{
    Random random(kSeed);
    const MeanHeight height = meanHeight(false, 0, random);
    const double unprojected = 2 * 0.1 * 0.1;
    EXPECT_LT(std::abs(height.mean), 0.3 * unprojected + 3 * height.error) << "seed " << kSeed;
}

// Tangential noise moves the mean of points outward by its variance over the radius of a sphere.
TEST(Sheet, TangentialNoiseMovesACurvedSheetUntilItIsKnown)
{
    Random random(kSeed);
    constexpr double kShift = 0.1 * 0.1;
    const MeanHeight biased = meanHeight(true, 0, random),
                     corrected = meanHeight(true, 0.1, random);
    EXPECT_NEAR(biased.mean, kShift, 0.35 * kShift + 3 * biased.error) << "seed " << kSeed;
    EXPECT_LT(std::abs(corrected.mean), 0.35 * kShift + 3 * corrected.error) << "seed " << kSeed;
}

// Squared turns of normals grow with curvature and tangential noise, and fall with the height over
// a convex sheet: the slope of the regression is the tangential variance.
TEST(Sheet, ResidualsTellTangentialNoiseFromThatOfNormals)
{
    Random random(kSeed);
    constexpr double kSigma = 0.1, kTau = 0.1, kReach = 0.6;
    const PointNoise noise = noiseOf(kSigma, 0.17);
    CellPoints scratch;
    for (const bool anyWay : {false, true}) {
        NoiseSums all;
        for (int trial = 0; trial < 100; ++trial) {
            const CellPoints points = thrownOffSphere(2000, kSigma, kTau, kReach, anyWay, random);
            Sheet sheet = growSheet(points, planeSheet(Vec3d::Zero(), Vec3d::UnitZ()), 0.3 * kReach,
                                    kReach, noise, scratch);
            sheet = overFeet(sheet, kReach, noise, scratch);
            all += residualsOf(points, sheet, kReach / 2, noise);
        }
        const double slope = (all.n * all.xy - all.x * all.y) / (all.n * all.xx - all.x * all.x);
        const double share = slope / (kSigma * kSigma);
        if (anyWay)
            EXPECT_GT(share, 0.5) << "seed " << kSeed;
        else
            EXPECT_LT(share, 0.25) << "seed " << kSeed;
        EXPECT_NEAR(std::sqrt(all.squares / all.count), kSigma, 0.15 * kSigma) << anyWay;
    }
}

// The variance of heights over many samples is that which each fit predicts.
TEST(Sheet, PredictsItsOwnVariance)
{
    Random random(kSeed);
    constexpr double kSigma = 0.05, kTau = 0.1;
    constexpr int kTrials = 400;
    const PointNoise noise = noiseOf(kSigma, kTau);
    CellPoints scratch;
    const Vec3d places[] = {Vec3d::Zero(), Vec3d(0.3, 0, 0)};
    double squares[2] = {}, predicted[2] = {};
    for (int trial = 0; trial < kTrials; ++trial) {
        PointBatch batch;
        for (int n = 0; n < 300; ++n)
            append(batch,
                   {random.uniform(-1, 1), random.uniform(-1, 1), kSigma * normalDraw(random)},
                   (Vec3d::UnitZ() + kTau * normalVector(random)).normalized());
        CellPoints points;
        points.assign(batch, Vec3d::Zero(), 1.5);
        const Sheet sheet =
            growSheet(points, planeSheet(Vec3d::Zero(), Vec3d::UnitZ()), 0.7, 0.7, noise, scratch);
        for (int k = 0; k < 2; ++k) {
            squares[k] += std::pow(heightOver(sheet, places[k], Vec3d::UnitZ()) / kSigma, 2);
            predicted[k] += sheet.variance(places[k]);
        }
    }
    // A variance of so many has a standard error of 7 %. Information is counted by the effective
    // number of points, which for a weight that falls to 0 is up to a third too low.
    for (int k = 0; k < 2; ++k) {
        EXPECT_LT(squares[k] / predicted[k], 1.2) << k;
        EXPECT_GT(squares[k] / predicted[k], 0.55) << k;
    }
}

TEST(Sheet, ExtrapolationIsAboutOneAmongPointsAndGrowsBeyond)
{
    Random random(kSeed);
    const PointNoise noise = noiseOf(0.01, 0.1);
    PointBatch batch;
    for (int n = 0; n < 2000; ++n) {
        const double x = random.uniform(-1, 1), y = random.uniform(-1, 1);
        append(batch, {x, y, 0.2 * x * x + 0.01 * normalDraw(random)},
               Vec3d(-0.4 * x, 0, 1).normalized());
    }
    CellPoints points, scratch;
    points.assign(batch, Vec3d::Zero(), 2);
    const Sheet sheet =
        growSheet(points, planeSheet(Vec3d::Zero(), Vec3d::UnitZ()), 0.2, 0.6, noise, scratch);
    EXPECT_LT(sheet.extrapolation(Vec3d::Zero()), 1.5);
    EXPECT_LT(sheet.extrapolation(Vec3d(0.3, 0, 0)), 3);
    EXPECT_GT(sheet.extrapolation(Vec3d(1.2, 0, 0)), 6);
}

/// Points on two faces of a convex edge along y whose normals differ by @a turn.
CellPoints edge(double turn, double sigma, double tau, Random& random)
{
    const Vec3d normals[] = {Vec3d::UnitZ(), Vec3d(std::sin(turn), 0, std::cos(turn))};
    PointBatch batch;
    for (int n = 0; n < 800; ++n) {
        const Vec3d& face = normals[n % 2];
        const Vec3d down = n % 2 ? Vec3d(std::cos(turn), 0, -std::sin(turn)) : Vec3d(-1, 0, 0);
        const Vec3d p = random.uniform(0, 1) * down + random.uniform(-1, 1) * Vec3d::UnitY();
        append(batch, p + sigma * normalDraw(random) * face,
               (face + tau * normalVector(random)).normalized());
    }
    CellPoints points;
    points.assign(batch, Vec3d::Zero(), 1.5);
    return points;
}

// Sheets grown one after the other are the faces, as far as the noise lets a plane be told.
TEST(Sheet, FacesOfAnEdgeAreGrownOneByOne)
{
    Random random(kSeed);
    constexpr double kSigma = 0.05, kTau = 0.15;
    const PointNoise noise = noiseOf(kSigma, kTau);
    CellPoints scratch;
    for (const double degrees : {60.0, 90.0, 120.0}) {
        const double turn = degrees * M_PI / 180;
        const CellPoints points = edge(turn, kSigma, kTau, random);
        std::vector<std::uint8_t> taken(points.count, 0);
        const Vec3d faces[] = {Vec3d::UnitZ(), Vec3d(std::sin(turn), 0, std::cos(turn))};
        bool found[2] = {};
        for (int k = 0; k < 2; ++k) {
            double reach = 0;
            const Sheet seed = seedSheet(points, taken, noise, reach);
            ASSERT_GT(seed.count, 0) << degrees;
            const Sheet sheet = growSheet(points, seed, 1.3 * reach, 0.8, noise, scratch);
            takePoints(points, sheet, noise, taken);
            for (int f = 0; f < 2; ++f) {
                const double tilt = std::acos(std::min(1.0, sheet.q.b.normalized().dot(faces[f])));
                // Some 100 points hold a slope to 2 sigma / (0.4 sqrt(100)).
                found[f] |= tilt < 3 * 2 * kSigma / (0.4 * 10);
            }
        }
        EXPECT_TRUE(found[0] && found[1]) << degrees << ", seed " << kSeed;
        EXPECT_LT(std::accumulate(taken.begin(), taken.end(), 0) - int(points.count), 40);
        EXPECT_GT(std::accumulate(taken.begin(), taken.end(), 0), int(points.count) - 40);
    }
}

TEST(MeanPyramid, KeepsWeightAndFirstMoments)
{
    Random random(kSeed);
    Interrupter progress;
    PointCloud cloud;
    for (int n = 0; n < 20000; ++n) {
        const Vec3d normal = random.direction();
        cloud.positions.push_back((3.5 * normal + Vec3d::Constant(4)).cast<float>());
        cloud.normals.push_back(normal.cast<float>());
        cloud.confidence.push_back(float(random.uniform(0.1, 1)));
    }
    const RootCube root{Vec3d::Zero(), 8};
    const SortedPoints points(std::move(cloud), root, progress);
    const MeanPyramid pyramid(points, root, 0.05, progress);
    const auto moments = [](const PointArrays& p) {
        Eigen::Vector4d sum = Eigen::Vector4d::Zero();
        for (std::size_t n = 0; n < p.size(); ++n)
            sum += double(p.confidence[n]) * Eigen::Vector4d(p.x[n], p.y[n], p.z[n], 1);
        return sum;
    };
    const Eigen::Vector4d all = moments(points.points());
    std::size_t count = points.size();
    for (const double size : {0.04, 0.07, 0.2, 0.5, 1.0}) {
        const SortedPoints& means = pyramid.of(size);
        EXPECT_LE(means.size(), count) << size;
        count = means.size();
        // Floats of half the count are rounded in each level.
        EXPECT_LT((moments(means.points()) - all).norm(), 1e-5 * all.norm()) << size;
    }
    EXPECT_EQ(pyramid.of(0.01).size(), points.size());
    EXPECT_LT(count, points.size() / 50);
}

} // namespace
} // namespace mpuvdb
