// Every kind of local fit reproduces its own kind of surface; none breaks on what is degenerate.
#include "cell_points.h"
#include "field_fixture.h"
#include "mpu/fit/fit_quality.h"
#include "mpu/fit/local_fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

namespace mpuvdb
{
namespace
{

using test::cellOf;
using test::Random;

constexpr double kExact = 1e-10; ///< of the ball's radius

double valueOf(const LocalFit& fit, const Vec3d& y)
{
    return fit.ruling(y).value(y);
}

bool isFinite(const LocalFit& fit)
{
    for (int k = 0; k < fit.count; ++k) {
        const Quadric& q = fit.pieces[std::size_t(k)];
        if (!q.A.allFinite() || !q.b.allFinite() || !std::isfinite(q.c)) return false;
    }
    return fit.count >= 1 && fit.count <= LocalFit::kMaxPieces;
}

/// Largest difference between @a fit and @a exact in the ball, in parts of its radius.
double largestError(const LocalFit& fit, const std::function<double(const Vec3d&)>& exact,
                    double radius, Random& random)
{
    double worst = 0;
    for (int i = 0; i < 300; ++i) {
        const Vec3d y = random.inBall(radius);
        worst = std::max(worst, std::abs(valueOf(fit, y) - exact(y)) / radius);
    }
    return worst;
}

Eigen::Matrix3d randomRotation(Random& random)
{
    return Eigen::AngleAxisd(random.uniform(0, 2 * M_PI), random.direction()).toRotationMatrix();
}

// --- The partition's weight

TEST(BsplineWeight, HasTheSupportAndTheSmoothnessOfAQuadraticBspline)
{
    EXPECT_EQ(bsplineWeight(1.5), 0.0);
    EXPECT_EQ(bsplineWeight(7.0), 0.0);
    EXPECT_DOUBLE_EQ(bsplineWeight(0.0), 0.75);
    // Pieces 3/4 - t^2 and (3/2 - t)^2 / 2, and their derivatives, meet at 1/2.
    const double step = 1e-5;
    for (double t = step; t < 1.6; t += 0.01) {
        const double expected = t < 0.5   ? 0.75 - t * t
                                : t < 1.5 ? 0.5 * (1.5 - t) * (1.5 - t)
                                          : 0.0;
        EXPECT_NEAR(bsplineWeight(t), expected, 1e-15) << t;
        const double slope = (bsplineWeight(t + step) - bsplineWeight(t - step)) / (2 * step);
        const double expectedSlope = t < 0.5 ? -2 * t : t < 1.5 ? t - 1.5 : 0.0;
        EXPECT_NEAR(slope, expectedSlope, 2 * step) << t;
        EXPECT_NEAR(bsplineWeight(float(t)), expected, 1e-6) << t;
    }
}

TEST(BsplineWeight, TranslatesSumToOne)
{
    for (double t = -0.5; t <= 0.5; t += 0.01) {
        double sum = 0;
        for (int k = -2; k <= 2; ++k) sum += bsplineWeight(std::abs(t - k));
        EXPECT_NEAR(sum, 1, 1e-15) << t;
    }
}

// --- (b) Bivariate quadratics and planes

TEST(FitBivariate, ReproducesQuadraticPatches)
{
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const double radius = std::pow(10.0, random.uniform(-4, 4));
        const Eigen::Matrix3d axes = randomRotation(random); // columns u, v, w
        double k[6];
        for (int i = 0; i < 3; ++i) k[i] = random.uniform(-0.5, 0.5) / radius;
        for (int i = 3; i < 5; ++i) k[i] = random.uniform(-0.3, 0.3);
        k[5] = random.uniform(-0.2, 0.2) * radius;
        const auto height = [&](double u, double v) {
            return k[0] * u * u + k[1] * u * v + k[2] * v * v + k[3] * u + k[4] * v + k[5];
        };
        std::vector<Vec3d> positions, normals;
        const std::size_t count = 15 + random.below(50);
        while (positions.size() < count) {
            const double u = random.uniform(-radius, radius), v = random.uniform(-radius, radius);
            const Vec3d p = axes * Vec3d(u, v, height(u, v));
            if (!(p.norm() < 0.95 * radius)) continue;
            positions.push_back(p);
            normals.push_back(axes.col(2));
        }
        LocalFit fit;
        fit.pieces[0] = fitBivariate(cellOf(positions, normals, radius), axes.col(2));
        const auto exact = [&](const Vec3d& y) {
            const Vec3d local = axes.transpose() * y;
            return local[2] - height(local[0], local[1]);
        };
        EXPECT_LT(largestError(fit, exact, radius, random), kExact);
    }
}

TEST(FitBivariate, IsThePlaneOfFewPoints)
{
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const Vec3d normal = random.direction();
        const double offset = random.uniform(-0.3, 0.3);
        std::vector<Vec3d> positions, normals;
        for (std::size_t i = 0; i < 1 + seed % 5; ++i) {
            const Vec3d p = random.inBall(0.6);
            positions.push_back(p - (normal.dot(p) - offset) * normal);
            normals.push_back(normal);
        }
        const Quadric q = fitBivariate(cellOf(positions, normals, 1), normal);
        EXPECT_EQ(q.A, Eigen::Matrix3d::Zero());
        for (int i = 0; i < 20; ++i) {
            const Vec3d y = random.inBall(1);
            EXPECT_NEAR(q.value(y), normal.dot(y) - offset, kExact);
        }
    }
}

// --- (a) General quadrics

TEST(FitGeneral, ReproducesQuadrics)
{
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const double radius = std::pow(10.0, random.uniform(-3, 3));
        // Two sheets near the middle: what general quadrics are for.
        const Eigen::Matrix3d axes = randomRotation(random);
        const Vec3d curvatures(random.uniform(0.8, 1.5), random.uniform(-0.3, 0.8),
                               random.uniform(-0.8, 0.3));
        Quadric exact;
        exact.A = axes * curvatures.asDiagonal() * axes.transpose() / radius;
        exact.b = 0.2 * random.inBall(1);
        exact.c = -random.uniform(0.05, 0.2) * radius;
        std::vector<Vec3d> positions, normals;
        for (int tries = 0; positions.size() < 60 && tries < 100000; ++tries) {
            Vec3d p = random.inBall(radius);
            for (int step = 0; step < 30; ++step) {
                const Vec3d g = exact.gradient(p);
                p -= exact.value(p) / std::max(g.squaredNorm(), 1e-3) * g;
            }
            const bool lands = std::abs(exact.value(p)) < 1e-14 * radius && p.norm() < radius;
            if (!lands) continue;
            positions.push_back(p);
            normals.push_back(exact.gradient(p).normalized());
        }
        ASSERT_EQ(positions.size(), 60u);
        std::vector<Vec3d> auxPoints = {Vec3d::Zero()};
        for (int corner = 0; corner < 8; ++corner)
            auxPoints.push_back(
                radius / 2.6 *
                Vec3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1));
        std::vector<double> auxValues;
        for (const Vec3d& q : auxPoints) auxValues.push_back(exact.value(q));
        LocalFit fit;
        fit.pieces[0] = fitGeneral(cellOf(positions, normals, radius), auxPoints, auxValues);
        EXPECT_LT(largestError(
                      fit, [&](const Vec3d& y) { return exact.value(y); }, radius, random),
                  kExact);
    }
}

// --- (c) Edges and corners

struct Planes {
    std::vector<Vec3d> normals;
    double value(std::size_t k, const Vec3d& y) const { return normals[k].dot(y - apex); }
    Vec3d apex = Vec3d::Zero();
};

using Combination = std::function<double(const Planes&, const Vec3d&)>;

double unite(const Planes& planes, const Vec3d& y)
{
    double v = planes.value(0, y);
    for (std::size_t k = 1; k < planes.normals.size(); ++k) v = std::min(v, planes.value(k, y));
    return v;
}

double intersect(const Planes& planes, const Vec3d& y)
{
    double v = planes.value(0, y);
    for (std::size_t k = 1; k < planes.normals.size(); ++k) v = std::max(v, planes.value(k, y));
    return v;
}

/// Points of the zero set of @a solid, which consists of parts of the planes.
CellPoints cornerPoints(const Planes& planes, const Combination& solid, std::size_t perFace,
                        Random& random)
{
    std::vector<Vec3d> positions, normals;
    for (std::size_t k = 0; k < planes.normals.size(); ++k) {
        const Vec3d n = planes.normals[k];
        for (std::size_t found = 0; found < perFace;) {
            Vec3d p = random.inBall(1);
            p -= planes.value(k, p) * n;
            if (!(p.norm() < 0.98) || std::abs(solid(planes, p)) > 1e-13) continue;
            positions.push_back(p);
            normals.push_back(n);
            ++found;
        }
    }
    return cellOf(positions, normals, 1);
}

void expectReproduced(const Planes& planes, const Combination& solid, std::size_t perFace,
                      Random& random)
{
    const CellPoints points = cornerPoints(planes, solid, perFace, random);
    CellPoints scratch;
    const std::optional<LocalFit> sharp = fitSharp(points, scratch);
    ASSERT_TRUE(sharp);
    EXPECT_EQ(std::size_t(sharp->count), planes.normals.size());
    EXPECT_LT(largestError(
                  *sharp, [&](const Vec3d& y) { return solid(planes, y); }, 1, random),
              kExact);
    EXPECT_LT(taubinError(*sharp, points, 1), kExact);
}

/// Faces around the axes of a turned cube, each tilted by up to @a degrees.
Planes tiltedCorner(double degrees, Random& random)
{
    Planes planes;
    const Eigen::Matrix3d axes = randomRotation(random);
    for (int k = 0; k < 3; ++k) {
        const Eigen::AngleAxisd tilt(random.uniform(0, degrees) * M_PI / 180, random.direction());
        planes.normals.push_back(tilt * axes.col(k));
    }
    planes.apex = random.inBall(0.2);
    return planes;
}

TEST(FitSharp, ReproducesEdges)
{
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const Eigen::Matrix3d axes = randomRotation(random);
        const double angle = random.uniform(30, 150) * M_PI / 180; // between the normals
        Planes planes;
        planes.normals = {axes.col(0),
                          std::cos(angle) * axes.col(0) + std::sin(angle) * axes.col(1)};
        planes.apex = random.inBall(0.15);
        for (const std::size_t perFace : {std::size_t(4), std::size_t(15)}) {
            expectReproduced(planes, intersect, perFace, random);
            expectReproduced(planes, unite, perFace, random);
        }
    }
}

TEST(FitSharp, ReproducesCornersOfThreeFacesOfAllConvexities)
{
    const Combination solids[] = {
        intersect, unite,
        [](const Planes& f, const Vec3d& y) {
            return std::min(f.value(0, y), std::max(f.value(1, y), f.value(2, y)));
        },
        [](const Planes& f, const Vec3d& y) {
            return std::max(f.value(0, y), std::min(f.value(1, y), f.value(2, y)));
        }};
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        Random random(seed);
        Planes planes = tiltedCorner(10, random);
        for (const Combination& solid : solids) {
            for (int turn = 0; turn < 3; ++turn) {
                SCOPED_TRACE(testing::Message() << "seed " << seed << ", solid " << &solid - solids
                                                << ", turn " << turn);
                expectReproduced(planes, solid, 40, random);
                std::rotate(planes.normals.begin(), planes.normals.begin() + 1,
                            planes.normals.end());
            }
        }
    }
}

/// Four faces, two of them on one side of the widest pair.
Planes hippedRoof(Random& random)
{
    Planes planes;
    const Eigen::Matrix3d axes = randomRotation(random);
    for (const Vec3d& n :
         {Vec3d(2, -0.5, 1), Vec3d(-2, -0.5, 1), Vec3d(0.6, 1.4, 1), Vec3d(-0.6, 1.4, 1)})
        planes.normals.push_back(axes * (n + random.inBall(0.05)).normalized());
    planes.apex = random.inBall(0.1);
    return planes;
}

TEST(FitSharp, ReproducesConvexAndConcaveCornersOfFourFaces)
{
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const Planes planes = hippedRoof(random);
        expectReproduced(planes, intersect, 14, random);
        expectReproduced(planes, unite, 14, random);
    }
}

TEST(FitSharp, LeavesCornersOfFourFacesThatAreNeitherToOthers)
{
    Random random(5);
    const Planes planes = hippedRoof(random);
    const Combination mixed = [](const Planes& f, const Vec3d& y) {
        return std::min(std::max(f.value(0, y), f.value(2, y)),
                        std::max(f.value(1, y), f.value(3, y)));
    };
    // Neither Combination of the four faces fits; the general quadric is offered too, the best
    // kept.
    CellPoints scratch;
    const CellPoints points = cornerPoints(planes, mixed, 7, random);
    const std::optional<LocalFit> sharp = fitSharp(points, scratch);
    ASSERT_TRUE(sharp);
    ASSERT_GT(taubinError(*sharp, points, 1), 0.01);
    FitSettings settings;
    settings.tolerance = 1e-6;
    const FitResult result = fitCell(points, 1, 1, settings, scratch);
    EXPECT_FALSE(result.fit.isSharp());
    EXPECT_LT(result.error, taubinError(*sharp, points, 1));
}

TEST(FitSharp, SeesNoFeatureWhereTheSurfaceBendsWithinTheAngle)
{
    // Test (14) of the paper: cosine of the widest pair below 0.9.
    for (const double degrees : {3.0, 10.0, 25.0, 27.0}) {
        const double angle = degrees * M_PI / 180, radius = 1.6 / angle;
        std::vector<Vec3d> positions, normals;
        for (const double z : {-0.4, 0.0, 0.4})
            for (int n = 0; n < 9; ++n) {
                const double at = angle * (n / 8.0 - 0.5);
                const Vec3d normal(std::sin(at), std::cos(at), 0);
                positions.push_back(radius * (normal - Vec3d(0, 1, 0)) + Vec3d(0, 0, z));
                normals.push_back(normal);
            }
        CellPoints scratch;
        const CellPoints points = cellOf(positions, normals, 1);
        EXPECT_EQ(fitSharp(points, scratch).has_value(), std::cos(angle) < 0.9) << degrees;
    }
}

TEST(FitSharp, ReproducesDullFoldsOfFlatFaces)
{
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        SCOPED_TRACE(seed);
        Random random(seed);
        const Eigen::Matrix3d axes = randomRotation(random);
        const double angle = random.uniform(2.5, 25) * M_PI / 180;
        Planes planes;
        planes.normals = {axes.col(0),
                          std::cos(angle) * axes.col(0) + std::sin(angle) * axes.col(1)};
        planes.apex = random.inBall(0.15);
        expectReproduced(planes, intersect, 10, random);
        expectReproduced(planes, unite, 10, random);
    }
}

// --- The choice, and what it is judged by

FitSettings settingsOf(double tolerance)
{
    FitSettings settings;
    settings.tolerance = tolerance;
    return settings;
}

/// Points on the cap of a sphere that passes the center.
CellPoints capPoints(double sphereRadius, std::size_t count, Random& random)
{
    std::vector<Vec3d> positions, normals;
    const Vec3d center(0, 0, -sphereRadius);
    while (positions.size() < count) {
        const Vec3d n = (random.inBall(0.95) - center).normalized();
        const Vec3d p = center + sphereRadius * n;
        if (!(p.norm() < 0.95)) continue;
        positions.push_back(p);
        normals.push_back(n);
    }
    return cellOf(positions, normals, 1);
}

TEST(FitCell, TakesASmoothFitWhereItIsWithinTolerance)
{
    Random random(1);
    CellPoints scratch;
    const CellPoints points = capPoints(2, 25, random);
    const FitResult smooth = fitCell(points, 1, 1, settingsOf(0.02), scratch);
    EXPECT_FALSE(smooth.fit.isSharp());
    EXPECT_LT(smooth.error, 0.02);
    EXPECT_TRUE(smooth.spreadNormals);
    EXPECT_FALSE(smooth.opposedNormals);
    EXPECT_FALSE(smooth.needsSplit);
}

TEST(FitCell, TakesTheFeatureWhereSmoothFails)
{
    Random random(2);
    Planes planes;
    planes.normals = {Vec3d(1, 0, 0), Vec3d(0, 1, 0)};
    const CellPoints points = cornerPoints(planes, intersect, 14, random);
    CellPoints scratch;
    const FitResult sharp = fitCell(points, 1, 1, settingsOf(1e-3), scratch);
    EXPECT_EQ(sharp.fit.count, 2);
    EXPECT_LT(sharp.error, kExact);
    FitSettings smoothOnly = settingsOf(1e-3);
    smoothOnly.maxSharpPoints = 0;
    const FitResult smooth = fitCell(points, 1, 1, smoothOnly, scratch);
    EXPECT_EQ(smooth.fit.count, 1);
    EXPECT_GT(smooth.error, 1e-3);
}

TEST(FitCell, TakesAGeneralQuadricBetweenTwoSheets)
{
    Random random(4);
    std::vector<Vec3d> positions, normals;
    for (int i = 0; i < 80; ++i) {
        const double side = i % 2 ? 1 : -1;
        const double x = random.uniform(-0.6, 0.6), y = random.uniform(-0.6, 0.6);
        positions.emplace_back(x, y, side * 0.3);
        normals.emplace_back(0, 0, side);
    }
    CellPoints scratch;
    const FitResult result =
        fitCell(cellOf(positions, normals, 1), 1, 1, settingsOf(0.01), scratch);
    EXPECT_TRUE(result.opposedNormals);
    EXPECT_FALSE(result.needsSplit);
    EXPECT_FALSE(result.fit.isSharp());
    EXPECT_LT(result.error, 0.1); // the auxiliary values are no quadric's: a compromise
    EXPECT_LT(valueOf(result.fit, Vec3d::Zero()), 0);
    EXPECT_GT(valueOf(result.fit, Vec3d(0, 0, 0.6)), 0);
    EXPECT_GT(valueOf(result.fit, Vec3d(0, 0, -0.6)), 0);
}

// --- Degenerate cells

struct Degenerate {
    const char* name;
    std::vector<Vec3d> positions, normals;
    double confidence;
};

std::vector<Degenerate> degenerateCells()
{
    Random random(6);
    const Vec3d z(0, 0, 1), p(0.1, 0.2, 0.1);
    std::vector<Vec3d> line, random40, randomNormals, opposed, corner;
    for (int i = 0; i < 40; ++i) {
        line.emplace_back(0.02 * (i - 20), 0.01 * (i - 20), 0.1);
        random40.push_back(random.inBall(0.9));
        randomNormals.push_back(random.direction());
        opposed.push_back(i % 2 ? z : Vec3d(-z));
        corner.push_back(Vec3d::Unit(i % 3));
    }
    const std::vector<Vec3d> same(40, p), up(40, z), rim(40, Vec3d(1, 0, 0));
    return {{"nothing", {}, {}, 1},
            {"one point", {p}, {z}, 1},
            {"two points", {p, Vec3d(-p)}, {z, Vec3d(1, 0, 0)}, 1},
            {"two opposed", {p, p}, {z, Vec3d(-z)}, 1},
            {"all equal", same, up, 1},
            {"all equal, opposed normals", same, opposed, 1},
            {"all equal, normals of a corner", same, corner, 1},
            {"all equal, any normals", same, randomNormals, 1},
            {"collinear", line, up, 1},
            {"collinear, opposed normals", line, opposed, 1},
            {"collinear, any normals", line, randomNormals, 1},
            {"zero normals", random40, std::vector<Vec3d>(40, Vec3d::Zero()), 1},
            {"no confidence", random40, randomNormals, 0},
            {"on the ball's rim", rim, up, 1},
            {"chaos", random40, randomNormals, 1}};
}

TEST(FitCell, IsFiniteOnDegenerateCells)
{
    CellPoints scratch;
    for (const Degenerate& d : degenerateCells()) {
        for (const double scale : {1e-6, 1.0, 1e6}) {
            SCOPED_TRACE(testing::Message() << d.name << ", scale " << scale);
            std::vector<Vec3d> positions;
            for (const Vec3d& p : d.positions) positions.push_back(scale * p);
            const CellPoints cell = cellOf(positions, d.normals, scale, d.confidence);
            FitSettings settings = settingsOf(1e-9 * scale);
            settings.maxSharpPoints = 100;
            const FitResult result = fitCell(cell, scale, scale, settings, scratch);
            EXPECT_TRUE(isFinite(result.fit));
            EXPECT_FALSE(std::isnan(result.error));
            EXPECT_TRUE(std::isfinite(zeroSetGap(result.fit, cell, Vec3d::Zero(), scale, 0)) ||
                        d.positions.empty());
        }
    }
}

} // namespace
} // namespace mpuvdb
