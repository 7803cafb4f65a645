// The spline under tension on problems of known solution, and the coarse sign that it makes.
#include "field_fixture.h"
#include "mpu/fill/coarse_sign.h"
#include "mpu/fill/tension_spline.h"

#include <mpuvdb/error.h>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

namespace mpuvdb
{
namespace
{

using test::Random;

// --- The spline

/// Laplacian, per square of a step, at the interior nodes; 0 on the box.
std::vector<double> laplacian(const NodeGrid& grid, const std::vector<double>& u)
{
    std::vector<double> result(grid.size(), 0.0);
    for (int i = 1; i < grid.n[0] - 1; ++i)
        for (int j = 1; j < grid.n[1] - 1; ++j)
            for (int k = 1; k < grid.n[2] - 1; ++k) {
                const auto at = [&](int a, int b, int c) { return u[grid.index(a, b, c)]; };
                result[grid.index(i, j, k)] = at(i - 1, j, k) + at(i + 1, j, k) + at(i, j - 1, k) +
                                              at(i, j + 1, k) + at(i, j, k - 1) + at(i, j, k + 1) -
                                              6 * at(i, j, k);
            }
    return result;
}

constexpr double kTension2 = double(TensionSpline::kTension) * double(TensionSpline::kTension);

/// -Lap (t^2 - Lap)^2 u for a u that is 0 on the box with its Laplacian and the Laplacian of that.
std::vector<double> applied(const NodeGrid& grid, const std::vector<double>& u)
{
    std::vector<double> v = laplacian(grid, u);
    for (int n = 0; n < 2; ++n) {
        const std::vector<double> next = laplacian(grid, v);
        for (std::size_t m = 0; m < v.size(); ++m) v[m] = kTension2 * v[m] - next[m];
    }
    for (double& x : v) x = -x;
    return v;
}

std::vector<float> nothingOn(const NodeGrid& grid)
{
    return std::vector<float>(grid.size(), 0.0f);
}

TEST(TensionSpline, DampsEachWaveByItsEnergy)
{
    // With data everywhere, a wave that is 0 on the box keeps D / (D + l (t^2 + l)^2) of its
    // height, where -l is its eigenvalue under the Laplacian.
    Interrupter progress;
    for (const auto& n : {std::array<int, 3>{33, 33, 33}, std::array<int, 3>{17, 49, 33},
                          std::array<int, 3>{65, 17, 17}})
        for (const float weight : {TensionSpline::kMinWeight, 1600.0f, 50000.0f}) {
            const NodeGrid grid{n};
            std::vector<float> data(grid.size(), 0.0f);
            std::vector<double> expected(grid.size(), 0.0);
            for (const auto& waves : {std::array<int, 3>{1, 1, 1}, std::array<int, 3>{1, 2, 3},
                                      std::array<int, 3>{7, 5, 9}}) {
                double eigenvalue = 0;
                for (std::size_t c = 0; c < 3; ++c)
                    eigenvalue += 2 - 2 * std::cos(M_PI * waves[c] / (n[c] - 1));
                const double kept =
                    weight / (weight + eigenvalue * std::pow(kTension2 + eigenvalue, 2));
                for (int i = 0; i < n[0]; ++i)
                    for (int j = 0; j < n[1]; ++j)
                        for (int k = 0; k < n[2]; ++k) {
                            const double wave = std::sin(M_PI * waves[0] * i / (n[0] - 1)) *
                                                std::sin(M_PI * waves[1] * j / (n[1] - 1)) *
                                                std::sin(M_PI * waves[2] * k / (n[2] - 1));
                            data[grid.index(i, j, k)] += float(wave);
                            expected[grid.index(i, j, k)] += kept * wave;
                        }
            }
            TensionSpline spline(grid, std::vector<float>(grid.size(), weight), progress);
            const std::vector<float> u = spline.solve(data, nothingOn(grid), {}, 12);
            double worst = 0;
            for (std::size_t m = 0; m < u.size(); ++m)
                worst = std::max(worst, std::abs(double(u[m]) - expected[m]));
            EXPECT_LT(worst, 2e-4) << n[0] << " x " << n[1] << " x " << n[2] << ", " << weight;
        }
}

/// Data of random height on a thin shell, as points on a surface are.
struct Shell {
    NodeGrid grid;
    std::vector<float> weight, data;

    Shell(std::array<int, 3> n, std::uint64_t seed) : grid{n}
    {
        Random random(seed);
        weight.assign(grid.size(), 0.0f);
        data.assign(grid.size(), 0.0f);
        for (int i = 1; i < n[0] - 1; ++i)
            for (int j = 1; j < n[1] - 1; ++j)
                for (int k = 1; k < n[2] - 1; ++k) {
                    const Vec3d r = Vec3d(i, j, k) - 0.5 * Vec3d(n[0] - 1, n[1] - 1, n[2] - 1);
                    const double off = r.norm() - 0.3 * n[0];
                    if (!(std::abs(off) < 1.5)) continue;
                    weight[grid.index(i, j, k)] = 1600;
                    data[grid.index(i, j, k)] = float(off + random.uniform(-0.1, 0.1));
                }
    }

    /// Root mean square of what the equation is off by at nodes three from the box and farther,
    /// where @a applied needs no values on it.
    double residual(const std::vector<float>& u) const
    {
        const std::vector<double> au = applied(grid, {u.begin(), u.end()});
        double sum = 0;
        for (int i = 3; i < grid.n[0] - 3; ++i)
            for (int j = 3; j < grid.n[1] - 3; ++j)
                for (int k = 3; k < grid.n[2] - 3; ++k) {
                    const std::size_t n = grid.index(i, j, k);
                    sum += std::pow(au[n] + double(weight[n]) * double(u[n] - data[n]), 2);
                }
        return std::sqrt(sum / double(grid.size()));
    }
};

TEST(TensionSpline, EveryCycleReducesTheResidual)
{
    Interrupter progress;
    const Shell shell({49, 33, 33}, 2);
    const std::vector<float> border(shell.grid.size(), 3.0f);
    const auto after = [&](int cycles) {
        TensionSpline spline(shell.grid, shell.weight, progress);
        return shell.residual(spline.solve(shell.data, border, {}, cycles));
    };
    double before = after(1);
    for (int cycles = 2; cycles <= 6; ++cycles) {
        const double now = after(cycles);
        EXPECT_LT(now, 0.7 * before) << "cycle " << cycles;
        before = now;
    }
    // Three Laplacians, each up to 12 times as large, of values up to 10 in floats.
    EXPECT_LT(after(30), 1728 * 2 * 10 * std::numeric_limits<float>::epsilon());
}

TEST(TensionSpline, GoesOnStraightWhereNothingBends)
{
    Interrupter progress;
    const NodeGrid grid{{33, 17, 49}};
    std::vector<float> weight(grid.size(), 0.0f), linear(grid.size()), border(grid.size(), 1e6f);
    for (int i = 0; i < grid.n[0]; ++i)
        for (int j = 0; j < grid.n[1]; ++j)
            for (int k = 0; k < grid.n[2]; ++k) {
                const std::size_t n = grid.index(i, j, k);
                linear[n] = 1 + 0.02f * float(i) - 0.05f * float(j) + 0.03f * float(k);
                if (k % grid.borderStep(i, j) == 0) border[n] = linear[n];
                if (i > 5 && i < 9 && k > 10) weight[n] = 1600;
            }
    TensionSpline spline(grid, weight, progress);
    const std::vector<float> u = spline.solve(linear, border, {}, 12);
    for (std::size_t n = 0; n < u.size(); ++n) ASSERT_NEAR(u[n], linear[n], 1e-3);
}

TEST(TensionSpline, BendsOnBeyondItsData)
{
    // A sphere's distance with a hole as wide as curvatures reach from both sides: the middle is
    // nearer to the sphere than to the hole's chord.
    Interrupter progress;
    const NodeGrid grid{{65, 65, 65}};
    constexpr double radius = 8, half = 1 / double(TensionSpline::kTension);
    const double chord = std::sqrt(radius * radius - half * half);
    std::vector<float> weight(grid.size(), 0.0f), data(grid.size(), 0.0f),
        border(grid.size(), 12.0f);
    for (int i = 1; i < 64; ++i)
        for (int j = 1; j < 64; ++j)
            for (int k = 1; k < 64; ++k) {
                const Vec3d r = Vec3d(i, j, k) - Vec3d(32, 32, 32);
                const double off = r.norm() - radius;
                if (!(std::abs(off) < 1.5) || r[2] > chord / radius * r.norm()) continue;
                weight[grid.index(i, j, k)] = 1600;
                data[grid.index(i, j, k)] = float(off);
            }
    TensionSpline spline(grid, weight, progress);
    const std::vector<float> u = spline.solve(data, border, {}, 12);
    double found = 0;
    for (int k = 33; k < 62 && found == 0; ++k) {
        const double here = u[grid.index(32, 32, k)], next = u[grid.index(32, 32, k + 1)];
        if (here < 0 && next >= 0) found = k - 32 + here / (here - next);
    }
    EXPECT_NEAR(found, radius, 0.5 * (radius - chord));
}

TEST(TensionSpline, DoesNotDependOnThreads)
{
    Interrupter progress;
    const Shell shell({33, 49, 33}, 4);
    std::vector<std::vector<float>> results;
    for (const std::size_t threads : {1u, 2u, 8u}) {
        tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        TensionSpline spline(shell.grid, shell.weight, progress);
        results.push_back(spline.solve(shell.data, nothingOn(shell.grid), {}, 2));
    }
    EXPECT_EQ(results[0], results[1]);
    EXPECT_EQ(results[0], results[2]);
}

TEST(TensionSpline, Stops)
{
    Interrupter progress;
    const Shell shell({17, 17, 17}, 5);
    TensionSpline spline(shell.grid, shell.weight, progress);
    progress.stop();
    EXPECT_THROW(spline.solve(shell.data, nothingOn(shell.grid), {}, 2), Interrupted);
}

// --- The coarse sign

CoarseSign coarseSignOf(PointCloud cloud)
{
    Interrupter progress;
    const Box3d bounds = cloud.localBounds();
    const double side = 1.6 * bounds.sizes().maxCoeff();
    const RootCube root{bounds.center() - Vec3d::Constant(side / 2), side};
    const SortedPoints points(std::move(cloud), root, progress);
    return CoarseSign(points, bounds, root, 0, {}, progress);
}

/// @a cloud without its points for which @a drop(world position) holds.
template <typename Drop>
PointCloud without(const PointCloud& cloud, Drop drop)
{
    PointCloud kept;
    kept.frame = cloud.frame;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (drop(cloud.world(i))) continue;
        kept.positions.push_back(cloud.positions[i]);
        kept.normals.push_back(cloud.normals[i]);
    }
    return kept;
}

TEST(CoarseSign, IsRightFartherThanAStepFromAWholeSurface)
{
    for (const char* description :
         {"sphere(1)", "torus(1, 0.4)", "box(1, 1.5, 2)", "blob(1, 5, 0.1)"}) {
        const auto solid = parseSolid(description);
        const PointCloud cloud = test::randomScan(description, 20000);
        const Vec3d frame = cloud.frame;
        const CoarseSign sign = coarseSignOf(cloud);
        Random random(1);
        int inside = 0, wrong = 0;
        for (int i = 0; i < 20000; ++i) {
            const Vec3d p = random.inCube(2.5);
            const double d = solid->distance(p);
            if (!(std::abs(d) > sign.rootStep())) continue;
            inside += d < 0;
            wrong += (sign.evaluate(p - frame).value < 0) != (d < 0);
        }
        EXPECT_EQ(wrong, 0) << description;
        EXPECT_GT(inside, 100) << description;
    }
}

void expectFourAsEach(const CoarseSign& sign)
{
    Random random(4);
    for (int n = 0; n < 2000; ++n) {
        std::array<std::array<double, 4>, 3> places;
        std::array<double, 4> values, steps;
        std::array<Vec3d, 4> p;
        for (std::size_t i = 0; i < 4; ++i) {
            p[i] = random.inCube(n % 2 ? 1.5 : 6); // half of them beyond the nodes' box
            for (std::size_t k = 0; k < 3; ++k) places[k][i] = p[i][Eigen::Index(k)];
        }
        sign.evaluateFour(places, values, steps);
        for (std::size_t i = 0; i < 4; ++i) {
            ASSERT_EQ(values[i], sign.evaluate(p[i]).value);
            ASSERT_EQ(steps[i], sign.evaluate(p[i]).step);
        }
    }
}

TEST(CoarseSign, SaysOfFourPlacesWhatItSaysOfEach)
{
    expectFourAsEach(coarseSignOf(test::randomScan("torus(1, 0.4)", 5000)));
}

TEST(CoarseSign, IsNearTheDistanceNearData)
{
    const PointCloud cloud = test::randomScan("sphere(1)", 20000);
    const Vec3d frame = cloud.frame;
    const CoarseSign sign = coarseSignOf(cloud);
    Random random(2);
    for (int i = 0; i < 2000; ++i) {
        const double d = random.uniform(-1, 1) * sign.rootStep();
        const Vec3d n = random.direction();
        const CoarseSample sample = sign.evaluate((1 + d) * n - frame);
        // u is capped at 1.5 steps from the data: towards them it flattens, and tells too much.
        EXPECT_NEAR(sample.value, d,
                    (std::abs(d) < 0.5 * sign.rootStep() ? 0.5 : 1.5) * sign.rootStep());
        if (std::abs(d) > 0.3 * sign.rootStep()) {
            EXPECT_EQ(sample.value < 0, d < 0);
        }
        EXPECT_GT(sample.gradient.dot(n), 0.8);
    }
}

/// Number of connected parts (by faces) of the nodes of a lattice that are inside; -1 if one of
/// them is at the lattice's border.
int insideParts(const CoarseSign& sign, const Vec3d& center, double half)
{
    constexpr int n = 61;
    const auto index = [](int i, int j, int k) { return std::size_t((i * n + j) * n + k); };
    std::vector<char> inside(index(n - 1, n - 1, n - 1) + 1);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            for (int k = 0; k < n; ++k) {
                const Vec3d at(i, j, k);
                const Vec3d p = center + half * (at / ((n - 1) / 2.0) - Vec3d::Ones());
                inside[index(i, j, k)] = sign.evaluate(p).value < 0;
                const int lowest = std::min({i, j, k}), highest = std::max({i, j, k});
                if (inside[index(i, j, k)] && (lowest == 0 || highest == n - 1)) return -1;
            }
    int parts = 0;
    for (std::size_t seed = 0; seed < inside.size(); ++seed) {
        if (!inside[seed]) continue;
        ++parts;
        std::vector<std::size_t> open{seed};
        inside[seed] = 0;
        while (!open.empty()) {
            const std::size_t at = open.back();
            open.pop_back();
            for (const std::size_t step : {std::size_t(1), std::size_t(n), std::size_t(n * n)})
                for (const std::size_t next : {at + step, at - step})
                    if (inside[next]) {
                        inside[next] = 0;
                        open.push_back(next);
                    }
        }
    }
    return parts;
}

TEST(CoarseSign, ClosesHalfASphere)
{
    const PointCloud cloud =
        without(test::randomScan("sphere(1)", 20000), [](const Vec3d& p) { return p[2] < 0; });
    const Vec3d frame = cloud.frame;
    const CoarseSign sign = coarseSignOf(cloud);
    EXPECT_EQ(insideParts(sign, Vec3d(0, 0, 0.5) - frame, 2.0), 1);
    EXPECT_LT(sign.evaluate(Vec3d(0, 0, 0.5) - frame).value, 0);
    EXPECT_GT(sign.evaluate(Vec3d(0, 0, 1.2) - frame).value, 0);
    EXPECT_GT(sign.evaluate(Vec3d(0, 0, -1.5) - frame).value, 0);
    // Far beyond the grid: outside, and farther with distance.
    for (const Vec3d& direction : {Vec3d(0, 0, -1), Vec3d(1, 0, 0), Vec3d(-1, 1, 1)}) {
        EXPECT_GT(sign.evaluate(10 * direction).value, 5);
        EXPECT_GT(sign.evaluate(100 * direction).value, sign.evaluate(10 * direction).value);
    }
}

TEST(CoarseSign, ClosesASphereWithAHole)
{
    const PointCloud cloud = without(test::randomScan("sphere(1)", 20000), [](const Vec3d& p) {
        return (p - Vec3d(0, 0.6, 0.8)).norm() < 0.5;
    });
    const Vec3d frame = cloud.frame;
    const CoarseSign sign = coarseSignOf(cloud);
    EXPECT_EQ(insideParts(sign, -frame, 2.0), 1);
    // The surface bends on through the hole: there the sphere's, about.
    EXPECT_LT(sign.evaluate(Vec3d(0, 0.6, 0.8) * 0.8 - frame).value, 0);
    EXPECT_GT(sign.evaluate(Vec3d(0, 0.6, 0.8) * 1.2 - frame).value, 0);
}

/// Distance from the coarse zero set to @a surface on the line along @a outward; both ends of the
/// line, @a reach away, have to be on their sides.
double misplacement(const CoarseSign& sign, const Vec3d& surface, const Vec3d& outward,
                    double reach)
{
    double low = -reach, high = reach;
    EXPECT_LT(sign.evaluate(surface + low * outward).value, 0);
    EXPECT_GT(sign.evaluate(surface + high * outward).value, 0);
    for (int i = 0; i < 30; ++i) {
        const double middle = 0.5 * (low + high);
        (sign.evaluate(surface + middle * outward).value < 0 ? low : high) = middle;
    }
    return std::abs(low);
}

TEST(CoarseSign, ClosesABoreAsItsWallBends)
{
    // A chord across the third of the wall that is missing leaves 0.2 at its middle.
    constexpr double radius = 0.4, gap = M_PI / 3;
    const PointCloud cloud = without(
        test::randomScan("difference(box(2,2,1), cylinder(0.4,3))", 40000), [&](const Vec3d& p) {
            return p.head<2>().norm() < radius + 1e-3 && std::abs(std::atan2(p[1], p[0])) < gap;
        });
    const Vec3d frame = cloud.frame;
    const CoarseSign sign = coarseSignOf(cloud);
    double sum = 0, worst = 0;
    int count = 0;
    for (double angle = -gap; angle <= gap; angle += gap / 16) {
        for (double z = -0.35; z <= 0.36; z += 0.05) {
            const Vec3d inwards(std::cos(angle), std::sin(angle), 0);
            const double off =
                misplacement(sign, radius * inwards + Vec3d(0, 0, z) - frame, -inwards, 0.3);
            sum += off;
            worst = std::max(worst, off);
            ++count;
        }
    }
    EXPECT_LT(sum / count, 0.07);
    EXPECT_LT(worst, 0.15);
}

// --- Its finer levels

/// A rod whose root step is many spacings, with two dents that are as large as the step, whose
/// bottom nobody saw.
struct Rod {
    static constexpr double kRadius = 0.2, kDent = 0.1, kHole = 0.07;
    std::array<Vec3d, 2> holes{Vec3d(kRadius - kDent, 0, -2), Vec3d(kRadius - kDent, 0, 1.5)};
    Vec3d frame;
    Box3d bounds;
    RootCube root;
    std::unique_ptr<const SortedPoints> points;

    Rod()
    {
        PointCloud cloud = without(
            test::randomScan("difference(capsule(0.2, 6), translate(sphere(0.1), 0.2, 0, -2), "
                             "translate(sphere(0.1), 0.2, 0, 1.5))",
                             200000),
            [&](const Vec3d& p) {
                return (p - holes[0]).norm() < kHole || (p - holes[1]).norm() < kHole;
            });
        frame = cloud.frame;
        bounds = cloud.localBounds();
        const double side = 1.6 * bounds.sizes().maxCoeff();
        root = {bounds.center() - Vec3d::Constant(side / 2), side};
        Interrupter progress;
        points = std::make_unique<SortedPoints>(std::move(cloud), root, progress);
    }

    /// With the cells in these holes as unseen ones.
    CoarseSign coarse(const std::vector<Vec3d>& open) const
    {
        constexpr int kLevel = 8;
        Unseen unseen;
        for (const Vec3d& hole : open) {
            const Vec3d center = hole - frame, reach = Vec3d::Constant(kHole);
            const OctreeCell first = root.cellAt(center - reach, kLevel),
                             last = root.cellAt(center + reach, kLevel);
            for (std::uint32_t i = first.i; i <= last.i; ++i)
                for (std::uint32_t j = first.j; j <= last.j; ++j)
                    for (std::uint32_t k = first.k; k <= last.k; ++k)
                        unseen.cells.push_back({kLevel, i, j, k});
        }
        Interrupter progress;
        return CoarseSign(*points, bounds, root, 0, unseen, progress);
    }
};

const Rod& theRod()
{
    static const Rod rod;
    return rod;
}

TEST(CoarseLevels, AreOnlyWhereDataAreMissing)
{
    const Rod& rod = theRod();
    const CoarseSign plain = rod.coarse({}), fine = rod.coarse({rod.holes[0]});
    EXPECT_EQ(plain.levels().levels(), 0);
    ASSERT_EQ(fine.levels().levels(), 2);
    EXPECT_LT(fine.stepAt(rod.holes[0] - rod.frame), 0.3 * fine.rootStep());
    Random random(11);
    int same = 0;
    // A block's own edge, 8 steps of the root, and as much for the cells' reach.
    const double far = Rod::kHole + 16 * std::sqrt(3.0) * plain.rootStep();
    for (int n = 0; n < 5000; ++n) {
        const Vec3d p = random.inCube(4);
        if ((p - rod.holes[0]).norm() < far) continue;
        const CoarseSample a = plain.evaluate(p - rod.frame), b = fine.evaluate(p - rod.frame);
        ASSERT_EQ(a.value, b.value);
        ASSERT_EQ(a.step, b.step);
        ++same;
    }
    EXPECT_GT(same, 1000);
}

TEST(CoarseLevels, AreContinuous)
{
    const Rod& rod = theRod();
    const CoarseSign fine = rod.coarse({rod.holes[0]});
    const double span = 1e-7 * fine.rootStep();
    // The slope is at most that of a quotient of splines; where levels do not meet it has no bound.
    const double steepest = 100, rounding = 1e-5 * fine.rootStep();
    Random random(12);
    int across = 0;
    for (int n = 0; n < 40000; ++n) {
        // Across a face of the blocks of one of the levels.
        const int level = 1 + n % 2, axis = n / 2 % 3;
        Vec3d p = rod.holes[0] - rod.frame + random.inCube(1.2);
        const Vec3d cell = fine.levels().cellAt(p, level) / CoarseBlock::kNodes;
        p[axis] +=
            (std::round(cell[axis]) - cell[axis]) * CoarseBlock::kNodes * fine.levels().step(level);
        const Vec3d offset = span * Vec3d::Unit(axis);
        const CoarseSample a = fine.evaluate(p - offset), b = fine.evaluate(p + offset);
        ASSERT_NEAR(a.value, b.value, 2 * steepest * span + rounding);
        ASSERT_NEAR(a.step, b.step, 2 * steepest * span + rounding);
        ASSERT_LT((a.gradient - b.gradient).norm(), 1e-2);
        across += fine.stepAt(p) < fine.rootStep();
    }
    EXPECT_GT(across, 500);
}

TEST(CoarseLevels, SayOfFourPlacesWhatTheySayOfEach)
{
    const Rod& rod = theRod();
    expectFourAsEach(rod.coarse({rod.holes[0], rod.holes[1]}));
}

TEST(CoarseLevels, DependOnWhatIsNearAlone)
{
    const Rod& rod = theRod();
    const CoarseSign both = rod.coarse({rod.holes[0], rod.holes[1]}),
                     one = rod.coarse({rod.holes[1]});
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    const CoarseSign serial = rod.coarse({rod.holes[1], rod.holes[0]});
    Random random(13);
    for (int n = 0; n < 5000; ++n) {
        const Vec3d p = rod.holes[1] - rod.frame + random.inCube(1);
        const CoarseSample a = one.evaluate(p), b = both.evaluate(p), c = serial.evaluate(p);
        ASSERT_EQ(a.value, b.value);
        ASSERT_EQ(a.step, b.step);
        ASSERT_EQ(b.value, c.value);
        ASSERT_EQ(b.gradient, c.gradient);
    }
}

TEST(CoarseSign, IsFiniteOnDegenerateClouds)
{
    Random random(3);
    std::vector<std::vector<Vec3f>> clouds(4);
    clouds[0] = {Vec3f(1, 2, 3)};
    clouds[1].assign(100, Vec3f(1, 2, 3));
    for (int i = 0; i < 200; ++i) {
        clouds[2].emplace_back(float(i), 0.f, 0.f);
        clouds[3].push_back(Vec3f(float(random.uniform()), float(random.uniform()), 0));
    }
    Interrupter progress;
    for (const auto& positions : clouds) {
        PointCloud cloud;
        cloud.positions = positions;
        cloud.normals.assign(positions.size(), Vec3f(0, 0, 1));
        const Box3d bounds = cloud.localBounds();
        const double side = 1.5 * bounds.sizes().maxCoeff() + 1;
        const RootCube root{bounds.center() - Vec3d::Constant(side / 2), side};
        const CoarseSign sign(SortedPoints(std::move(cloud), root, progress), bounds, root, 0, {},
                              progress);
        for (int i = 0; i < 200; ++i) {
            const CoarseSample sample = sign.evaluate(bounds.center() + random.inCube(side));
            EXPECT_TRUE(std::isfinite(sample.value));
            EXPECT_TRUE(sample.gradient.allFinite());
        }
        EXPECT_GT(sign.evaluate(bounds.center() + Vec3d(0, 0, 10 * side)).value, 0);
    }
}

} // namespace
} // namespace mpuvdb
