
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <random>

namespace mpuvdb
{
namespace
{

using Pattern = ScanSettings::Pattern;

const char* const kExactSolids[] = {
    "sphere(1)",        "torus(1,0.3)",
    "box(1,0.8,0.5)",   "roundedbox(1,0.8,0.5,0.1)",
    "capsule(0.3,1)",   "cylinder(0.4,1)",
    "cone(0.5,1)",      "slab(1,1,0.02)",
    "sheets(1,1,0.05)", "rotate(translate(scale(torus(1,0.4),0.5),0.1,0.2,0.3),1,2,3,40)"};
const char* const kOtherSolids[] = {"blob(1,12,0.03)",
                                    "gear(12,1,0.3)",
                                    "fandisk(1)",
                                    "difference(box(2,2,1),cylinder(0.4,3))",
                                    "intersection(sphere(1),box(1.5,1.5,1.5))",
                                    "union(sphere(1),translate(sphere(0.7),1,0,0))"};

std::vector<std::string> allSolids()
{
    std::vector<std::string> all(std::begin(kExactSolids), std::end(kExactSolids));
    all.insert(all.end(), std::begin(kOtherSolids), std::end(kOtherSolids));
    return all;
}

PointCloud take(const Solid& solid, const ScanSettings& settings)
{
    Interrupter progress;
    return scan(solid, settings, &progress);
}

PointCloud take(const std::string& solid, const ScanSettings& settings)
{
    return take(*parseSolid(solid), settings);
}

ScanSettings settingsFor(Pattern pattern, std::uint64_t points)
{
    ScanSettings s;
    s.pattern = pattern;
    s.points = points;
    return s;
}

/// Uniform in a box, the same on every platform.
class BoxPoints
{
public:
    BoxPoints(const Box3d& box, unsigned seed) : mBox(box), mEngine(seed) {}
    Vec3d next()
    {
        Vec3d u;
        for (int axis = 0; axis < 3; ++axis) u[axis] = double(mEngine()) / 4294967296.0;
        return mBox.min() + u.cwiseProduct(mBox.sizes());
    }

private:
    Box3d mBox;
    std::mt19937 mEngine;
};

Box3d enlarged(const Box3d& box, double factor)
{
    const Vec3d half = box.sizes() / 2 * factor;
    return Box3d(box.center() - half, box.center() + half);
}

Vec3d numericGradient(const Solid& solid, const Vec3d& p, double step)
{
    Vec3d g;
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3d d = step * Vec3d::Unit(axis);
        g[axis] = (solid.distance(p + d) - solid.distance(p - d)) / (2 * step);
    }
    return g;
}

double nearestDistance(const PointCloud& cloud, const Vec3d& p)
{
    const Vec3f local = (p - cloud.frame).cast<float>();
    float best = HUGE_VALF;
    for (const Vec3f& q : cloud.positions) best = std::min(best, (q - local).squaredNorm());
    return std::sqrt(double(best));
}

TEST(Solid, ExactDistancesHaveUnitGradientsAlongTheNormal)
{
    for (const char* text : kExactSolids) {
        const auto solid = parseSolid(text);
        BoxPoints points(enlarged(solid->bounds(), 1.5), 7);
        int smooth = 0;
        constexpr int kTries = 2000;
        for (int i = 0; i < kTries; ++i) {
            const Vec3d p = points.next();
            const Vec3d fine = numericGradient(*solid, p, 1e-6);
            // At the medial axis a distance has no gradient; there two step sizes disagree.
            if ((fine - numericGradient(*solid, p, 1e-4)).norm() > 1e-4) continue;
            ++smooth;
            EXPECT_NEAR(fine.norm(), 1, 1e-6) << text << " at " << p.transpose();
            EXPECT_LT((fine - solid->normal(p)).norm(), 1e-5) << text << " at " << p.transpose();
        }
        EXPECT_GT(smooth, 0.9 * kTries) << text;
    }
}

TEST(Solid, DistancesAgreeWithTheNearestOfManySamples)
{
    for (const std::string& text : allSolids()) {
        const auto solid = parseSolid(text);
        const PointCloud cloud = take(*solid, settingsFor(Pattern::Random, 20000));
        const bool exact = std::find(std::begin(kExactSolids), std::end(kExactSolids), text) !=
                           std::end(kExactSolids);
        BoxPoints points(enlarged(solid->bounds(), 1.3), 11);
        const double gap = 0.03 * solid->bounds().diagonal().norm(); // between samples
        for (int i = 0; i < 100; ++i) {
            const Vec3d p = points.next();
            const double distance = std::abs(solid->distance(p));
            const double nearest = nearestDistance(cloud, p);
            EXPECT_LE(distance, nearest + 1e-6) << text << " at " << p.transpose();
            EXPECT_LE(std::abs(solid->bound(p)), distance + 1e-12) << text;
            if (exact) {
                EXPECT_GE(distance + gap, nearest) << text;
            }
        }
    }
}

TEST(Solid, BlobIsExactWithinItsReach)
{
    const auto solid = parseSolid("blob(1,12,0.03)");
    const PointCloud cloud = take(*solid, settingsFor(Pattern::Random, 300));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d near = cloud.world(i);
        const Vec3d foot = near - solid->distance(near) * solid->normal(near);
        for (const double d : {-0.015, -1e-5, 1e-8, 0.003, 0.015})
            EXPECT_NEAR(solid->distance(foot + d * solid->normal(foot)), d, 1e-12);
    }
}

TEST(Solid, BoundsHoldAllSamples)
{
    for (const std::string& text : allSolids()) {
        const auto solid = parseSolid(text);
        const PointCloud cloud = take(*solid, settingsFor(Pattern::Random, 2000));
        const Box3d box = enlarged(solid->bounds(), 1 + 1e-6);
        for (std::size_t i = 0; i < cloud.size(); ++i)
            ASSERT_TRUE(box.contains(cloud.world(i))) << text;
    }
}

TEST(Solid, FieldSeedsCoverTheSurface)
{
    const auto solid = parseSolid("translate(torus(1,0.3),0.1,-0.2,0.3)");
    const FieldPtr field = makeSolidField(solid);
    const Lattice lattice{Vec3d(0.01, 0, 0), 0.05};
    const std::vector<Vec3i> seeds = field->seedBlocks(lattice);
    const auto key = [](const Vec3i& b) { return std::array<int, 3>{b.x(), b.y(), b.z()}; };
    std::map<std::array<int, 3>, int> found;
    for (const Vec3i& b : seeds) ++found[key(b)];
    EXPECT_EQ(found.size(), seeds.size());
    const PointCloud cloud = take(*solid, settingsFor(Pattern::Random, 5000));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        // A voxel's block also owns the half voxel below its first voxel.
        const Vec3d v = (cloud.world(i) - lattice.origin) / lattice.voxelSize;
        const Vec3i block = ((v.array() + 0.5) / kBlockDim).floor().cast<int>();
        ASSERT_TRUE(found.count(key(block)));
    }
    BlockValues values;
    field->sampler(lattice, 1)->evaluate(Vec3i(1, 2, -1), values);
    const Vec3d p = lattice.origin + 0.05 * Vec3d(8 + 3, 16 + 5, -8 + 7);
    EXPECT_EQ(values[(3 * 8 + 5) * 8 + 7], float(solid->distance(p)));
}

TEST(SolidParser, SaysWhereItIsWrong)
{
    const auto complaint = [](const std::string& text) -> std::string {
        try {
            parseSolid(text);
        } catch (const UsageError& e) {
            return e.what();
        }
        return "accepted";
    };
    EXPECT_NE(complaint("sphere(1").find("character 9: expected , or )"), std::string::npos);
    EXPECT_NE(complaint("ball(1)").find("character 1: expected a solid, one of: sphere"),
              std::string::npos);
    EXPECT_NE(complaint("union(sphere(1), ball(2))").find("character 18"), std::string::npos);
    EXPECT_NE(complaint("box(1,2)").find("box(x,y,z)"), std::string::npos);
    EXPECT_NE(complaint("sphere(-1)").find("number 1 is -1, and sizes must be above 0"),
              std::string::npos);
    EXPECT_NE(complaint("torus(1,2)").find("less than"), std::string::npos);
    for (const char* text :
         {"", "sphere", "sphere()", "sphere(1)x", "sphere(1,2)", "sphere(nan)", "sphere(1e999)",
          "sphere(sphere(1))", "union()", "union(1)", "translate(1,2,3,sphere(1))",
          "rotate(sphere(1),0,0,0,5)", "roundedbox(1,1,1,0.6)", "blob(1,5,0.5)", "gear(2.5,1,1)"})
        EXPECT_NE(complaint(text), "accepted") << text;
    std::string deep;
    for (int i = 0; i < 100000; ++i) deep += "union(";
    EXPECT_NE(complaint(deep).find("nested"), std::string::npos);
    EXPECT_THROW(parseSolid("intersection(sphere(1),translate(sphere(1),5,0,0))"), InputError);
}

TEST(SolidParser, HelpListsEverySolidAndAllOfItsExamplesParse)
{
    const std::string help = solidHelp();
    for (const std::string& text : allSolids())
        EXPECT_NE(help.find(text.substr(0, text.find('(') + 1)), std::string::npos) << text;
    EXPECT_LT(parseSolid(" union ( sphere( 1 ) , box(1,1 ,1) )\n")->distance(Vec3d::Zero()), 0);
}

TEST(Scan, PointsLieOnTheSurfaceWithItsNormals)
{
    for (const std::string& text : allSolids()) {
        const auto solid = parseSolid(text);
        for (const Pattern pattern : {Pattern::Even, Pattern::Random, Pattern::Scan}) {
            const PointCloud cloud = take(*solid, settingsFor(pattern, 1000));
            EXPECT_NEAR(double(cloud.size()), 1000, pattern == Pattern::Scan ? 150 : 0) << text;
            EXPECT_EQ(cloud.frame, solid->bounds().center());
            for (std::size_t i = 0; i < cloud.size(); ++i) {
                const Vec3d p = cloud.world(i), n = cloud.normals[i].cast<double>();
                EXPECT_LT(std::abs(solid->distance(p)), 4e-7) << text;
                EXPECT_NEAR(n.norm(), 1, 1e-6);
                EXPECT_LT(solid->distance(p - 5e-6 * n), 0) << text;
                EXPECT_GT(solid->distance(p + 5e-6 * n), 0) << text;
            }
        }
    }
}

/// Chi-square of counts against shares.
double chiSquare(const std::vector<double>& counts, const std::vector<double>& shares)
{
    double total = 0, sum = 0, chi = 0;
    for (const double c : counts) total += c;
    for (const double s : shares) sum += s;
    for (std::size_t i = 0; i < counts.size(); ++i) {
        const double expected = total * shares[i] / sum;
        chi += (counts[i] - expected) * (counts[i] - expected) / expected;
    }
    return chi;
}

TEST(Scan, RandomIsUniformByArea)
{
    // Six faces of a box, each in four quarters: 24 cells. chi-square(23) is below 50 in 99.9 %.
    const PointCloud box = take("box(2,1,0.5)", settingsFor(Pattern::Random, 100000));
    std::vector<double> counts(24), shares(24);
    const double area[3] = {1 * 0.5, 2 * 0.5, 2 * 1};
    for (std::size_t i = 0; i < box.size(); ++i) {
        Eigen::Index axis = 0;
        box.normals[i].cwiseAbs().maxCoeff(&axis);
        const Vec3f& p = box.positions[i];
        const int quarter = 2 * (p[(axis + 1) % 3] > 0) + (p[(axis + 2) % 3] > 0);
        ++counts[std::size_t((2 * axis + (p[axis] > 0)) * 4 + quarter)];
    }
    for (std::size_t i = 0; i < 24; ++i) shares[i] = area[i / 8];
    EXPECT_LT(chiSquare(counts, shares), 50);

    // Zones of equal height on a sphere have equal areas.
    const PointCloud sphere = take("sphere(1)", settingsFor(Pattern::Random, 100000));
    std::vector<double> zones(24);
    for (const Vec3f& p : sphere.positions)
        ++zones[std::size_t(std::clamp(int((p.z() + 1) * 3), 0, 5) * 4 + 2 * (p.x() > 0) +
                            (p.y() > 0))];
    EXPECT_LT(chiSquare(zones, std::vector<double>(24, 1)), 50);

    // A torus's outer half has the larger share, (1 + 2r/(pi R)) / 2.
    const PointCloud torus = take("torus(1,0.4)", settingsFor(Pattern::Random, 100000));
    double outer = 0;
    for (const Vec3f& p : torus.positions) outer += p.head<2>().norm() > 1;
    EXPECT_NEAR(outer / 100000, 0.5 * (1 + 2 * 0.4 / M_PI), 4 * 0.5 / std::sqrt(100000.0));
}

TEST(Scan, PartsFarApartGetTheirShares)
{
    // Zones of equal height on two balls that overlap up to and from z = 0.9125, and on one so far
    // away that one line in 1e5 through all would meet a ball. chi-square(23) is below 50 in 99.9
    // %.
    constexpr double kSeam = 0.9125, kTop = 1.7, kFar = 1000;
    const PointCloud cloud = take("union(sphere(1),translate(sphere(0.5),0,0,1.2),"
                                  "translate(sphere(1),0,1000,0))",
                                  settingsFor(Pattern::Random, 100000));
    std::vector<double> counts(24), shares(24);
    for (std::size_t zone = 0; zone < 24; ++zone)
        shares[zone] = zone < 8 ? (1 + kSeam) / 8 : zone < 16 ? 0.5 * (kTop - kSeam) / 8 : 2.0 / 8;
    for (const Vec3f& local : cloud.positions) {
        const Vec3d p = cloud.frame + local.cast<double>();
        const bool isFar = p.y() > kFar / 2, isUpper = !isFar && p.z() > kSeam;
        const double share = isFar     ? (p.z() + 1) / 2
                             : isUpper ? (p.z() - kSeam) / (kTop - kSeam)
                                       : (p.z() + 1) / (kSeam + 1);
        ++counts[std::size_t((isFar ? 16 : isUpper ? 8 : 0) + std::clamp(int(8 * share), 0, 7))];
    }
    EXPECT_LT(chiSquare(counts, shares), 50);
}

/// Distances of each point to the nearest other.
std::vector<double> nearestOthers(const PointCloud& cloud)
{
    std::vector<double> distances;
    for (const Vec3f& p : cloud.positions) {
        float best = HUGE_VALF;
        for (const Vec3f& q : cloud.positions)
            if (&q != &p) best = std::min(best, (q - p).squaredNorm());
        distances.push_back(std::sqrt(double(best)));
    }
    return distances;
}

TEST(Scan, EvenKeepsItsDistance)
{
    for (const char* text : {"sphere(1)", "box(1,1,1)", "torus(1,0.3)", "blob(1,8,0.05)"}) {
        const std::vector<double> even =
            nearestOthers(take(text, settingsFor(Pattern::Even, 3000)));
        const double count = double(even.size());
        double mean = 0, smallest = HUGE_VAL, variance = 0;
        for (const double d : even) {
            mean += d / count;
            smallest = std::min(smallest, d);
        }
        for (const double d : even) variance += (d - mean) * (d - mean) / count;
        // Random points: a deviation of 52 % of the mean, a smallest distance near zero.
        EXPECT_LT(std::sqrt(variance), 0.12 * mean) << text;
        EXPECT_GT(smallest, 0.8 * mean) << text;
    }
}

TEST(Scan, EvenCoversBothSidesOfThinWalls)
{
    const PointCloud slab = take("slab(1,1,0.004)", settingsFor(Pattern::Even, 2000));
    double top = 0;
    for (const Vec3f& n : slab.normals) top += n.z() > 0.5f;
    EXPECT_NEAR(top, 1000, 60);
    const PointCloud sheets = take("sheets(1,1,0.02)", settingsFor(Pattern::Even, 4000));
    std::map<int, int> perSide;
    for (std::size_t i = 0; i < sheets.size(); ++i)
        if (std::abs(sheets.normals[i].z()) > 0.5f)
            ++perSide[2 * (sheets.positions[i].z() > 0) + (sheets.normals[i].z() > 0)];
    for (int side = 0; side < 4; ++side) EXPECT_NEAR(perSide[side], 1000, 60);
}

TEST(Scan, SeesOnlyWhatTheViewpointsSee)
{
    const auto solid = parseSolid("union(sphere(0.5),translate(sphere(0.2),1,0,0))");
    ScanSettings s = settingsFor(Pattern::Scan, 5000);
    const Vec3d eye(3, 0, 0);
    s.viewpoints = {eye};
    const PointCloud cloud = take(*solid, s);
    ASSERT_GT(cloud.size(), 4000u);
    int behind = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d p = cloud.world(i), n = cloud.normals[i].cast<double>();
        EXPECT_GT(n.dot(eye - p), -1e-6);
        for (double t = 0.01; t < 0.99; t += 0.01)
            ASSERT_GT(solid->distance(p + t * (eye - p)), -1e-6) << "hidden " << p.transpose();
        behind += p.x() < 0.6;
    }
    EXPECT_GT(behind, 1000); // the big sphere's rim is seen past the small one
    s.viewpoints = {Vec3d(0.1, 0, 0)};
    EXPECT_THROW(take(*solid, s), UsageError);
}

TEST(Scan, ViewsTogetherSeeAllOfASphere)
{
    ScanSettings s = settingsFor(Pattern::Scan, 20000);
    s.confidence = true;
    const PointCloud cloud = take("sphere(1)", s);
    std::vector<int> octants(8);
    for (const Vec3f& p : cloud.positions)
        ++octants[std::size_t(4 * (p.x() > 0) + 2 * (p.y() > 0) + (p.z() > 0))];
    for (const int n : octants) EXPECT_GT(n, 1500);
    ASSERT_EQ(cloud.confidence.size(), cloud.size());
    EXPECT_EQ(*std::max_element(cloud.confidence.begin(), cloud.confidence.end()), 1.0f);
    EXPECT_GT(*std::min_element(cloud.confidence.begin(), cloud.confidence.end()), 0.0f);
}

TEST(Scan, ConfidenceFallsWithTheAngle)
{
    ScanSettings s = settingsFor(Pattern::Scan, 20000);
    s.confidence = true;
    const Vec3d eye(0, 0, 4);
    s.viewpoints = {eye};
    const PointCloud cloud = take("sphere(1)", s);
    double frontal = 0, rim = 0, frontals = 0, rims = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const double cosine =
            cloud.normals[i].cast<double>().dot((eye - cloud.world(i)).normalized());
        if (cosine > 0.9) frontal += cloud.confidence[i], ++frontals;
        if (cosine < 0.15) rim += cloud.confidence[i], ++rims;
    }
    ASSERT_GT(frontals, 0);
    ASSERT_GT(rims, 0);
    EXPECT_GT(frontal / frontals, 0.9);
    EXPECT_LT(rim / rims, 0.1);
}

double deviation(const PointCloud& cloud, const Solid& solid)
{
    double squares = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        squares += std::pow(solid.distance(cloud.world(i)), 2);
    return std::sqrt(squares / double(cloud.size()));
}

TEST(Scan, NoiseHasTheDeviationAskedFor)
{
    const auto solid = parseSolid("sphere(1)");
    for (const Pattern pattern : {Pattern::Even, Pattern::Random}) {
        ScanSettings s = settingsFor(pattern, 20000);
        s.noise = 0.01;
        EXPECT_NEAR(deviation(take(*solid, s), *solid), 0.01, 0.0003);
    }
    // Along the ray: in a frontal view of a plate it is along the normal.
    const auto plate = parseSolid("slab(1,1,0.5)");
    ScanSettings s = settingsFor(Pattern::Scan, 20000);
    s.noise = 0.01;
    s.viewpoints = {Vec3d(0, 0, 50)};
    EXPECT_NEAR(deviation(take(*plate, s), *plate), 0.01, 0.0003);
}

TEST(Scan, NormalNoiseHasTheDeviationAskedFor)
{
    ScanSettings s = settingsFor(Pattern::Random, 20000);
    s.normalNoise = 5;
    const PointCloud cloud = take("sphere(1)", s);
    double squares = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const double sine = cloud.normals[i].cross(cloud.positions[i].normalized()).norm();
        squares += std::pow(std::asin(std::min(sine, 1.0)), 2);
    }
    // Two tangential directions.
    const double degrees = std::sqrt(squares / (2 * double(cloud.size()))) * 180 / M_PI;
    EXPECT_NEAR(degrees, 5, 0.15);
}

TEST(Scan, OutliersAreAsManyAndAsFarAsAskedFor)
{
    const auto solid = parseSolid("sphere(1)");
    ScanSettings s = settingsFor(Pattern::Random, 20000);
    const PointCloud clean = take(*solid, s);
    s.outliers = 0.05;
    s.outlierDistance = 0.1;
    const PointCloud cloud = take(*solid, s);
    ASSERT_EQ(cloud.size(), clean.size());
    double moved = 0, squares = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (cloud.positions[i] == clean.positions[i]) continue;
        ++moved;
        squares += double((cloud.positions[i] - clean.positions[i]).squaredNorm()) / 3;
    }
    EXPECT_EQ(moved, 1000);
    EXPECT_NEAR(std::sqrt(squares / moved), 0.1 * std::sqrt(12.0), 0.03);
}

TEST(Scan, HolesAreEmpty)
{
    ScanSettings s = settingsFor(Pattern::Even, 20000);
    s.holes = 3;
    s.holeRadius = 0.08;
    const PointCloud cloud = take("sphere(1)", s);
    // A ball of radius r about a surface point takes the share r^2/4 of a unit sphere's area.
    const double radius = 0.08 * std::sqrt(12.0), share = radius * radius / 4;
    EXPECT_LT(double(cloud.size()), 20000 * (1 - 0.98 * share));
    EXPECT_GT(double(cloud.size()), 20000 * (1 - 3.02 * share));
    double widest = 0;
    BoxPoints points(Box3d(Vec3d(-1, -1, -1), Vec3d(1, 1, 1)), 5);
    for (int i = 0; i < 1000; ++i)
        widest = std::max(widest, nearestDistance(cloud, points.next().normalized()));
    EXPECT_GT(widest, 0.8 * radius);
}

bool sameBytes(const PointCloud& a, const PointCloud& b)
{
    const auto same = [](const auto& x, const auto& y) {
        return x.size() == y.size() &&
               (x.empty() || std::memcmp(x.data(), y.data(), x.size() * sizeof x[0]) == 0);
    };
    return a.frame == b.frame && same(a.positions, b.positions) && same(a.normals, b.normals) &&
           same(a.confidence, b.confidence);
}

TEST(Scan, SameBytesForAnyNumberOfThreads)
{
    for (const Pattern pattern : {Pattern::Even, Pattern::Random, Pattern::Scan}) {
        ScanSettings s = settingsFor(pattern, 4000);
        s.noise = 0.01;
        s.normalNoise = 3;
        s.outliers = 0.02;
        s.holes = 2;
        s.confidence = true;
        std::vector<PointCloud> clouds;
        for (const std::size_t threads : {1u, 2u, 8u}) {
            tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            clouds.push_back(take("fandisk(1)", s));
        }
        EXPECT_TRUE(sameBytes(clouds[0], clouds[1]));
        EXPECT_TRUE(sameBytes(clouds[0], clouds[2]));
        s.seed = 2;
        EXPECT_FALSE(sameBytes(clouds[0], take("fandisk(1)", s)));
    }
}

TEST(Scan, RefusesSettingsOutOfRange)
{
    const auto refuses = [](auto change) {
        ScanSettings s = settingsFor(Pattern::Random, 100);
        change(s);
        EXPECT_THROW(take("sphere(1)", s), UsageError);
    };
    refuses([](ScanSettings& s) { s.points = 0; });
    refuses([](ScanSettings& s) { s.views = 0; });
    refuses([](ScanSettings& s) { s.noise = -1; });
    refuses([](ScanSettings& s) { s.noise = NAN; });
    refuses([](ScanSettings& s) { s.normalNoise = 91; });
    refuses([](ScanSettings& s) { s.outliers = 0.6; });
    refuses([](ScanSettings& s) { s.outlierDistance = -1; });
    refuses([](ScanSettings& s) { s.holes = -1; });
    refuses([](ScanSettings& s) { s.holeRadius = INFINITY; });
    refuses([](ScanSettings& s) { s.viewpoints = {Vec3d(NAN, 0, 0)}; });
    EXPECT_THROW(take("difference(sphere(1),sphere(2))", settingsFor(Pattern::Random, 10)),
                 InputError);
}

TEST(Scan, Stops)
{
    Interrupter progress;
    progress.stop();
    EXPECT_THROW(scan(*parseSolid("sphere(1)"), {}, &progress), Interrupted);
}

} // namespace
} // namespace mpuvdb
