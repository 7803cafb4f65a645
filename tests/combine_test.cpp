// Booleans of level sets beside exact distances: sharp creases and those a ball rolled along.
#include "combine_fixture.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/shape.h>

#include <random>

namespace mpuvdb::test
{
namespace
{

// --- Exact distances

/// A solid whose normals and crease with another are known.
struct Smooth {
    Exact distance;
    std::function<Vec3d(const Vec3d&)> normal;
};

Smooth ball(const Vec3d& center, double radius)
{
    return {[=](const Vec3d& p) { return (p - center).norm() - radius; },
            [=](const Vec3d& p) { return (p - center).normalized(); }};
}

Smooth below(const Vec3d& normal)
{
    return {[=](const Vec3d& p) { return normal.dot(p); }, [=](const Vec3d&) { return normal; }};
}

Smooth complement(const Smooth& s)
{
    return {[=](const Vec3d& p) { return -s.distance(p); },
            [=](const Vec3d& p) { return Vec3d(-s.normal(p)); }};
}

/// The union with a ball of @a radius rolled along the crease, given the place on its path that is
/// nearest to a point.
Exact unionOf(const Smooth& a, const Smooth& b, double radius,
              const std::function<Vec3d(const Vec3d&)>& onPath)
{
    return [=](const Vec3d& p) {
        const Vec3d q = onPath(p), to = q - p;
        const Vec3d na = a.normal(q), nb = b.normal(q);
        const double c = na.dot(nb), u = na.dot(to), v = nb.dot(to);
        if (u - c * v > 0 && v - c * u > 0) return radius - to.norm();
        return std::min(a.distance(p), b.distance(p));
    };
}

Exact negated(const Exact& f)
{
    return [=](const Vec3d& p) { return -f(p); };
}

/// The circle about the x axis at which two balls on it, of radii ra at x = 0 and rb at x = d,
/// meet.
std::function<Vec3d(const Vec3d&)> circle(double ra, double rb, double d)
{
    const double x = (d * d + ra * ra - rb * rb) / (2 * d), r = std::sqrt(ra * ra - x * x);
    return [=](const Vec3d& p) {
        const Vec3d across = Vec3d(0, p.y(), p.z());
        const double length = across.norm();
        return Vec3d(Vec3d(x, 0, 0) + (length > 0 ? Vec3d(across * (r / length)) : Vec3d(0, r, 0)));
    };
}

constexpr double kBallA = 0.6, kBallB = 0.5, kApart = 0.7;

// What is left is thinner than a voxel and lies between voxels.
TEST(Combine, LeavesNoBandAroundNothing)
{
    for (const double left : {0.03, 0.0001}) {
        const LevelSet block = solidLevelSet("translate(box(1,1,1), 0.5,0.5,0.5)", 0.05);
        const LevelSet rest =
            solidLevelSet(fmt::format("translate(box(3,4,4), {},1,1)", 1.5 + left), 0.05);
        Interrupter progress;
        const LevelSet cut = combine(Boolean::Difference, {block, rest}, 0, &progress);
        EXPECT_TRUE(cut.grid().empty()) << left;
        EXPECT_EQ(cut.halfWidth(), block.halfWidth());
    }
}

TEST(Combine, GivesDistancesToTheCreaseOfTwoBalls)
{
    const double h = 1.0 / 32;
    const LevelSet a = solidLevelSet("sphere(0.6)", h),
                   b = solidLevelSet("translate(sphere(0.5), 0.7, 0, 0)", h);
    const Smooth sa = ball(Vec3d::Zero(), kBallA), sb = ball(Vec3d(kApart, 0, 0), kBallB);
    const auto crease = circle(kBallA, kBallB, kApart);
    const double half = 1.4;
    expectNear(a | b, unionOf(sa, sb, 0, crease), half, 0.004, 0.05);
    expectNear(a & b, negated(unionOf(complement(sa), complement(sb), 0, crease)), half, 0.004,
               0.05);
    expectNear(a - b, negated(unionOf(complement(sa), sb, 0, crease)), half, 0.004, 0.05);
    for (const LevelSet& result : {a | b, a & b, a - b}) expectSoundCreases(result);
}

TEST(Combine, RollsABallAlongTheCreaseOfTwoBalls)
{
    const double h = 1.0 / 32, half = 1.4;
    const LevelSet a = solidLevelSet("sphere(0.6)", h),
                   b = solidLevelSet("translate(sphere(0.5), 0.7, 0, 0)", h);
    const Smooth sa = ball(Vec3d::Zero(), kBallA), sb = ball(Vec3d(kApart, 0, 0), kBallB);
    for (const double r : {0.02, 0.1, 0.2}) {
        SCOPED_TRACE(r);
        const LevelSet both = combined(Boolean::Union, {a, b}, r);
        expectNear(both, unionOf(sa, sb, r, circle(kBallA + r, kBallB + r, kApart)), half, 0.01,
                   0.1);
        const LevelSet cut = combined(Boolean::Difference, {a, b}, r);
        expectNear(cut,
                   negated(unionOf(complement(sa), sb, r, circle(kBallA - r, kBallB + r, kApart))),
                   half, 0.01, 0.1);
        for (const LevelSet& result : {both, cut}) {
            EXPECT_LE(checked(result).meanGradientError, 0.03);
            EXPECT_NEAR(result.halfWidth(), 3, 1e-5);
            expectSoundCreases(result);
        }
    }
}

/// Slabs whose faces cross on the y axis, all turned alike.
std::string slab(double degrees)
{
    return fmt::format("rotate(rotate(translate(box(3,3,1.5), 0,0,-0.75), 0,1,0, {}), 1,2,3, 25)",
                       degrees);
}

Vec3d slabNormal(double degrees)
{
    const auto turn = [](const Vec3d& axis, double angle) {
        return Eigen::AngleAxisd(angle * M_PI / 180, axis.normalized());
    };
    return turn(Vec3d(1, 2, 3), 25) * (turn(Vec3d(0, 1, 0), degrees) * Vec3d(0, 0, 1));
}

TEST(Combine, FilletsPlanesAtAnyAngle)
{
    const double h = 1.0 / 20, half = 0.5;
    const LevelSet a = solidLevelSet(slab(0), h);
    const Vec3d na = slabNormal(0);
    for (const double degrees : {30.0, 70.0, 90.0, 120.0, 150.0}) {
        const LevelSet b = solidLevelSet(slab(degrees), h);
        const Vec3d nb = slabNormal(degrees);
        const Vec3d along = na.cross(nb).normalized();
        for (const double r : {0.0, 0.08}) {
            SCOPED_TRACE(fmt::format("{} degrees, radius {}", degrees, r));
            // In a gap so acute the fillet's depth reaches beyond the bands.
            const bool isAcute = r > 0 && degrees > 120;
            const double rms = isAcute ? 0.015 : 1e-4, max = isAcute ? 0.2 : 1e-3;
            const Vec3d path = r / (1 + na.dot(nb)) * (na + nb);
            const auto onPath = [&](const Vec3d& p) { return Vec3d(path + along.dot(p) * along); };
            const auto opposite = [&](const Vec3d& p) {
                return Vec3d(-path + along.dot(p) * along);
            };
            expectNear(combined(Boolean::Union, {a, b}, r),
                       unionOf(below(na), below(nb), r, onPath), half, rms, max);
            expectNear(combined(Boolean::Intersection, {a, b}, r),
                       negated(unionOf(complement(below(na)), complement(below(nb)), r, opposite)),
                       half, rms, max);
        }
    }
}

TEST(Combine, RollsABallBetweenABallAndAPlane)
{
    const double h = 1.0 / 24, r = 0.15, radius = 0.5;
    const LevelSet plane = solidLevelSet("translate(box(3,3,1), 0,0,-0.5)", h);
    const LevelSet sphere = solidLevelSet("translate(sphere(0.5), 0,0,0.2)", h);
    const double rho = std::sqrt((radius + r) * (radius + r) - (r - 0.2) * (r - 0.2));
    const auto path = [&](const Vec3d& p) {
        const double length = std::hypot(p.x(), p.y());
        if (length == 0) return Vec3d(rho, 0, r);
        return Vec3d(p.x() * rho / length, p.y() * rho / length, r);
    };
    const LevelSet result = combined(Boolean::Union, {plane, sphere}, r);
    expectNear(result, unionOf(below(Vec3d(0, 0, 1)), ball(Vec3d(0, 0, 0.2), radius), r, path), 0.9,
               0.005, 0.08);
    expectSoundCreases(result);
}

// --- Identities

struct Three {
    double h = 1.0 / 24;
    LevelSet a = solidLevelSet("rotate(torus(0.6, 0.25), 1, 2, 0, 40)", h);
    LevelSet b = solidLevelSet("translate(sphere(0.5), 0.4, 0.2, 0.1)", h);
    LevelSet c = solidLevelSet("translate(roundedbox(0.8, 0.9, 0.6, 0.1), -0.3, 0.3, 0.2)", h);
};

TEST(Combine, HoldsTheLawsOfSets)
{
    const Three s;
    EXPECT_TRUE(bytesOf(s.a | s.a) == bytesOf(s.a));
    EXPECT_TRUE(bytesOf(s.a & s.a) == bytesOf(s.a));
    for (const LevelSet& x : {s.a, s.b, s.c, s.a - s.b}) {
        const LevelSet nothing = x - x;
        EXPECT_TRUE(nothing.grid().empty()) << nothing.grid().activeVoxelCount();
        EXPECT_EQ(nothing.grid().getConstAccessor().getValue(Coord(3, 4, 5)),
                  nothing.grid().background());
    }
    const LevelSet cut = s.a - (s.b | s.c);
    const std::uint64_t few = cut.grid().activeVoxelCount() / 50; // about corners
    for (const LevelSet& same : {(s.a - s.b) - s.c, (s.a - s.b) & (s.a - s.c),
                                 combined(Boolean::Difference, {s.a, s.b, s.c})}) {
        EXPECT_EQ(differences(cut, same, 6), 0u);
        EXPECT_LE(differences(cut, same, 0.5), few);
    }
}

TEST(Combine, DoesNotDependOnTheOrderOfTwo)
{
    const Three s;
    for (const Boolean kind : {Boolean::Union, Boolean::Intersection})
        for (const double r : {0.0, 0.1}) {
            EXPECT_TRUE(bytesOf(combined(kind, {s.a, s.b}, r)) ==
                        bytesOf(combined(kind, {s.b, s.a}, r)));
            EXPECT_TRUE(bytesOf(combined(kind, {s.c, s.b}, r)) ==
                        bytesOf(combined(kind, {s.b, s.c}, r)));
        }
}

TEST(Combine, TakesEmptyAndDistantSolids)
{
    const Three s;
    const LevelSet nothing = emptyLevelSet(s.h);
    EXPECT_TRUE(bytesOf(s.a | nothing) == bytesOf(s.a));
    EXPECT_TRUE(bytesOf(nothing | s.a) == bytesOf(s.a));
    EXPECT_TRUE(bytesOf(s.a - nothing) == bytesOf(s.a));
    for (const LevelSet& none : {s.a & nothing, nothing & s.a, nothing - s.a, nothing | nothing})
        EXPECT_TRUE(none.grid().empty());
    const LevelSet far = solidLevelSet("translate(sphere(0.3), 9, 9, 9)", s.h);
    EXPECT_TRUE((s.a & far).grid().empty());
    EXPECT_TRUE(bytesOf(s.a - far) == bytesOf(s.a));
    EXPECT_EQ((s.a | far).grid().activeVoxelCount(),
              s.a.grid().activeVoxelCount() + far.grid().activeVoxelCount());
}

TEST(Combine, KeepsTheInsideOfWhatLiesInsideAnother)
{
    const double h = 1.0 / 24;
    const LevelSet large = solidLevelSet("sphere(1)", h), small = solidLevelSet("sphere(0.3)", h);
    EXPECT_TRUE(bytesOf(large | small) == bytesOf(large));
    EXPECT_TRUE(bytesOf(large & small) == bytesOf(small));
    EXPECT_TRUE((small - large).grid().empty());
    const LevelSet hollow = large - small;
    const Accessor at = hollow.grid().getConstAccessor();
    EXPECT_GT(at.getValue(Coord(0, 0, 0)), 0);
    EXPECT_EQ(at.getValue(Coord(15, 0, 0)), -hollow.grid().background());
    expectSoundCreases(hollow);
}

TEST(Combine, VolumesAddUp)
{
    for (const double h : {1.0 / 16, 1.0 / 32, 1.0 / 64}) {
        const LevelSet a = solidLevelSet("sphere(0.6)", h);
        const LevelSet b = solidLevelSet("translate(torus(0.5, 0.2), 0.5, 0.1, 0.2)", h);
        const auto volume = [](const LevelSet& s) {
            Interrupter progress;
            return measure(extractMesh(s, {}, &progress)).volume;
        };
        const double sum = volume(a) + volume(b), parts = volume(a | b) + volume(a & b);
        EXPECT_NEAR(parts, sum, 2 * h * h);
        EXPECT_NEAR(volume(a - b) + volume(a & b), volume(a), 2 * h * h);
        if (std::getenv("MPUVDB_TEST_FIGURES"))
            fmt::print("  {:.4f} h^2\n", (parts - sum) / (h * h));
    }
}

// --- Blends

// What lies in one of two boxes but not in both touches itself along edges, here of the lattice.
TEST(Combine, PartsThatTouchAlongEdgesStayApart)
{
    Interrupter progress;
    const LevelSet a = solidLevelSet("box(20, 20, 20)", 1),
                   b = solidLevelSet("translate(box(20, 20, 20), 10, 10, -10)", 1);
    const LevelSet aOnly = combine(Boolean::Difference, {a, b}, 0, &progress),
                   bOnly = combine(Boolean::Difference, {b, a}, 0, &progress);
    const LevelSet both = combine(Boolean::Union, {aOnly, bOnly}, 0, &progress);
    for (const LevelSet* const result : {&aOnly, &bOnly, &both}) {
        expectSoundCreases(*result);
        for (auto voxel = result->grid().cbeginValueOn(); voxel; ++voxel)
            ASSERT_FALSE(*voxel == 0 && std::signbit(*voxel)) << voxel.getCoord();
    }
    EXPECT_EQ(components(both, &progress).size(), 2u);
    EXPECT_EQ(components(combine(Boolean::Union, {a, b}, 0, &progress), &progress).size(), 1u);
    // Face to face they are one, with no wall between.
    const LevelSet beside = solidLevelSet("translate(box(20, 20, 20), 20, 0, 0)", 1);
    const LevelSet one = combine(Boolean::Union, {a, beside}, 0, &progress);
    EXPECT_EQ(components(one, &progress).size(), 1u);
    EXPECT_LT(one.grid().tree().getValue(openvdb::Coord(10, 0, 0)), -2);
}

TEST(Combine, BlendsOfNearlyParallelSurfacesAreSound)
{
    constexpr unsigned kSeed = 7;
    std::mt19937 random(kSeed);
    const auto within = [&](double most) {
        return most * (2 * (double(random()) / 4294967296.0) - 1);
    };
    const double h = 1.0 / 20;
    const LevelSet a = solidLevelSet("blob(1,9,0.12)", h);
    for (int n = 0; n < 4; ++n) {
        const double x = within(1), y = within(1), z = within(1), degrees = 20 + within(15);
        const std::string turned = fmt::format(
            "translate(rotate(blob(1,9,0.12),{},{},{},{}),{},0,0)", x, y, z, degrees, within(0.08));
        SCOPED_TRACE(fmt::format("seed {}: {}", kSeed, turned));
        const LevelSet b = solidLevelSet(turned, h);
        for (const Boolean kind : {Boolean::Union, Boolean::Intersection, Boolean::Difference})
            expectSoundCreases(combined(kind, {a, b}, 6 * h), 0.25);
    }
}

TEST(Combine, BlendsOnlyWithinTheRadius)
{
    const Three s;
    const double r = 0.1;
    const LevelSet sharp = s.a | s.b, blend = combined(Boolean::Union, {s.a, s.b}, r);
    const auto a = parseSolid(s.a.grid().getName()), b = parseSolid(s.b.grid().getName());
    const Accessor at = blend.grid().getConstAccessor();
    std::uint64_t changed = 0;
    for (auto it = sharp.grid().cbeginValueOn(); it; ++it) {
        const Vec3d p = worldOf(sharp.lattice(), it.getCoord());
        const bool isFar = std::min(a->distance(p), b->distance(p)) > r ||
                           std::max(a->distance(p), b->distance(p)) > 2 * r + 4 * s.h;
        const bool isSame = at.getValue(it.getCoord()) == *it && at.isValueOn(it.getCoord());
        changed += !isSame;
        EXPECT_TRUE(isSame || !isFar) << it.getCoord() << " " << *it;
    }
    EXPECT_GT(changed, 100u);
    EXPECT_TRUE(bytesOf(combined(Boolean::Union, {s.a, s.b}, 0)) == bytesOf(sharp));
}

TEST(Combine, RollsABallThatIsLargerThanBoth)
{
    const double h = 1.0 / 32, r = 2;
    const LevelSet a = solidLevelSet("sphere(0.6)", h),
                   b = solidLevelSet("translate(sphere(0.5), 0.7, 0, 0)", h);
    const LevelSet both = combined(Boolean::Union, {a, b}, r);
    expectNear(both,
               unionOf(ball(Vec3d::Zero(), kBallA), ball(Vec3d(kApart, 0, 0), kBallB), r,
                       circle(kBallA + r, kBallB + r, kApart)),
               1.4, 0.01, 0.1);
    expectSoundCreases(both);
    // It has no room within either: nothing to roll along.
    EXPECT_TRUE(bytesOf(combined(Boolean::Intersection, {a, b}, r)) == bytesOf(a & b));
}

TEST(Combine, LeavesNothingWhereTheBallHasNoRoom)
{
    // A wall 30 voxels thick and a plate of 16, both along a box: the ball of 10 voxels fits into
    // the wall, and as far into the plate's mouth as the cutter's edge lets it.
    const LevelSet block = solidLevelSet("box(80,80,80)", 1);
    const LevelSet cutter = solidLevelSet("translate(box(80,120,60), 30, 0, 6)", 1);
    const double edge = -10, r = 10, low = -40 + r, high = -24;
    const double mouth = edge - std::sqrt(r * r - (high - low) * (high - low)) + r;
    const LevelSet rest = combined(Boolean::Difference, {block, cutter}, r), sharp = block - cutter;
    expectSoundCreases(rest);
    const Accessor at = rest.grid().getConstAccessor(), was = sharp.grid().getConstAccessor();
    for (int x = -45; x <= 45; ++x)
        for (int y = -45; y <= 45; ++y)
            for (int z = -45; z <= 45; ++z) {
                const Coord c(x, y, z);
                EXPECT_TRUE(!(x > mouth + 0.5) || at.getValue(c) > 0) << c;
                EXPECT_TRUE(!(x < edge - 2 * r) || at.getValue(c) == was.getValue(c))
                    << c << " " << at.getValue(c) << " " << was.getValue(c);
            }
    EXPECT_LT(at.getValue(Coord(int(std::floor(mouth - 0.5)), 0, int(low))), 0);
}

TEST(Combine, TellsWhereTheBallHasNoRoom)
{
    const LevelSet a = solidLevelSet("sphere(17)", 1),
                   b = solidLevelSet("translate(sphere(17), 20, 0, 0)", 1);
    const auto notes = [&](Boolean kind, double radius) {
        Interrupter progress;
        combine(kind, {a, b}, radius, &progress);
        return progress.notes();
    };
    // What they have in common is 14 thick.
    const auto gone = notes(Boolean::Intersection, 10);
    ASSERT_EQ(gone.size(), 1u);
    EXPECT_NE(gone[0].find("up to 14 thick at (10, 0, 0)"), std::string::npos) << gone[0];
    const auto nothing = notes(Boolean::Intersection, 30);
    ASSERT_EQ(nothing.size(), 1u);
    EXPECT_NE(nothing[0].find("changed nothing"), std::string::npos) << nothing[0];
    EXPECT_TRUE(notes(Boolean::Intersection, 3).empty());
    EXPECT_TRUE(notes(Boolean::Union, 30).empty());
}

/// A heap of balls about the origin, rough in all directions.
std::string heap(std::mt19937& random)
{
    const auto between = [&](double low, double high) {
        return low + (high - low) * double(random()) / 4294967296.0;
    };
    std::string balls;
    for (int n = 0; n < 12; ++n) {
        Vec3d at(between(-1, 1), between(-1, 1), between(-1, 1));
        at *= between(0.55, 0.62) / at.norm();
        balls += fmt::format("{}translate(sphere({:.3f}), {:.3f}, {:.3f}, {:.3f})", n ? ", " : "",
                             between(0.2, 0.45), at.x(), at.y(), at.z());
    }
    return "union(" + balls + ")";
}

TEST(Combine, FilletsOfNearlyParallelSurfacesLeaveNoSpecks)
{
    const double h = 1.0 / 30;
    Interrupter progress;
    for (unsigned seed = 1; seed <= 4; ++seed) {
        SCOPED_TRACE(fmt::format("seed {}", seed));
        std::mt19937 random(seed);
        const LevelSet a = solidLevelSet(heap(random), h), b = solidLevelSet(heap(random), h);
        const std::size_t parts = components(a | b, &progress).size();
        EXPECT_LE(components(combined(Boolean::Union, {a, b}, 4.8 * h), &progress).size(), parts);
    }
}

// --- Refusals, threads, lattices

TEST(Combine, RefusesWhatItCannotCombine)
{
    const LevelSet a = solidLevelSet("sphere(0.5)", 1.0 / 8);
    Interrupter progress;
    EXPECT_THROW(combine(Boolean::Union, {}, 0, &progress), UsageError);
    for (const double bad : {-1.0, std::nan(""), HUGE_VAL})
        EXPECT_THROW(combine(Boolean::Union, {a, a}, bad, &progress), UsageError);
    EXPECT_THROW(combine(Boolean::Union, {a, a}, 20, &progress), LimitError); // it is 2 across
    progress.stop();
    EXPECT_THROW(combine(Boolean::Union, {a, a}, 0, &progress), Interrupted);
}

TEST(Combine, TakesTheFinestLatticeAndTheWidestBand)
{
    const LevelSet coarse = solidLevelSet("sphere(0.5)", 1.0 / 8, 4);
    const LevelSet fine = solidLevelSet("translate(sphere(0.5), 0.4, 0, 0)", 1.0 / 16);
    Interrupter progress;
    const OneLattice shared = onOneLattice({coarse, fine, fine}, 0, &progress);
    const std::vector<LevelSet>& same = shared.levelSets;
    ASSERT_EQ(same.size(), 3u);
    EXPECT_EQ(shared.model, 1u);
    EXPECT_EQ(shared.resampled, std::vector<std::size_t>{0});
    EXPECT_EQ(same[0].voxelSize(), fine.voxelSize());
    EXPECT_EQ(same[1].gridPtr(), fine.gridPtr());
    const LevelSet both = coarse | fine;
    EXPECT_EQ(both.voxelSize(), fine.voxelSize());
    EXPECT_NEAR(both.halfWidth(), 4, 1e-5);
    EXPECT_EQ(both.grid().getName(), coarse.grid().getName());
    expectSoundCreases(both);
}

/// Volumes of two balls apart, and their level sets with voxels 40 times as large for one as for
/// the other.
struct UnlikeBalls {
    LevelSet coarse = solidLevelSet("sphere(1)", 0.1);
    LevelSet fine = solidLevelSet("translate(sphere(0.025), 1.2, 0, 0)", 0.0025);
    double volume = 4.0 / 3 * M_PI * (1 + 0.025 * 0.025 * 0.025);
};

TEST(Combine, MultipliesNoVoxelsUnasked)
{
    const UnlikeBalls balls;
    Interrupter progress;
    const auto expectRefused = [&](const auto& work) {
        try {
            work();
            ADD_FAILURE() << "done";
        } catch (const LimitError& e) {
            for (const char* said : {"0.0025 to 0.1", "64 times", "--voxel-size", "million voxels"})
                EXPECT_NE(std::string(e.what()).find(said), std::string::npos) << e.what();
        }
    };
    expectRefused([&] { onOneLattice({balls.coarse, balls.fine}, 0, &progress); });
    expectRefused([&] { combine(Boolean::Union, {balls.fine, balls.coarse}, 0, &progress); });
    expectRefused([&] { morph(balls.fine, balls.coarse, 0.5, Morphing::Linear, &progress); });
    const Shape both(Shape::combine(Boolean::Union, {Shape(balls.coarse), Shape(balls.fine)}));
    ShapeSettings settings;
    settings.voxelSize = both.voxelSize();
    expectRefused([&] { both.requireFewVoxels(settings); });
    settings.voxelSize = 0.02;
    both.requireFewVoxels(settings);
}

TEST(Combine, TakesTheVoxelsThatAreAskedFor)
{
    const UnlikeBalls balls;
    Interrupter progress;
    for (const double h : {0.1, 0.03, 0.01}) {
        const OneLattice shared = onOneLattice({balls.coarse, balls.fine}, h, &progress);
        EXPECT_EQ(shared.model.has_value(), h == 0.1);
        EXPECT_EQ(shared.resampled.size(), h == 0.1 ? 1u : 2u);
        const LevelSet both = combined(Boolean::Union, shared.levelSets);
        EXPECT_DOUBLE_EQ(both.voxelSize(), h);
        expectSoundCreases(both);
        // Second order in the voxels that each ball has, and what is as small as one may be lost.
        EXPECT_NEAR(measure(both, &progress).volume, balls.volume, 0.02 * balls.volume) << h;
    }
    // What was asked for is made, however many voxels.
    const LevelSet coarse = solidLevelSet("sphere(1)", 0.2);
    const LevelSet fine = solidLevelSet("translate(sphere(0.1), 1.2, 0, 0)", 0.01);
    EXPECT_THROW(onOneLattice({coarse, fine}, 0, &progress), LimitError);
    const OneLattice asked = onOneLattice({coarse, fine}, 0.01, &progress);
    EXPECT_EQ(asked.model, 1u);
    EXPECT_NEAR(measure(combined(Boolean::Union, asked.levelSets), &progress).volume,
                4.0 / 3 * M_PI * 1.001, 0.1);
}

TEST(Combine, DoesNotDependOnThreads)
{
    const Three s;
    for (const double r : {0.0, 0.1}) {
        std::vector<std::string> bytes;
        for (const std::size_t threads : {1u, 2u, 8u}) {
            tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            bytes.push_back(bytesOf(combined(Boolean::Difference, {s.a, s.b, s.c}, r)));
        }
        EXPECT_TRUE(bytes[0] == bytes[1]);
        EXPECT_TRUE(bytes[0] == bytes[2]);
    }
}

// --- Random programs

/// A level set and the exact sign of what it stands for.
struct Program {
    LevelSet levelSet;
    Exact exact;
    std::string text;
};

Program randomLeaf(Random& random, double h)
{
    const auto number = [&](double low, double high) {
        return std::round(random.uniform(low, high) * 64) / 64;
    };
    std::string text;
    switch (random.below(3)) {
    case 0:
        text = fmt::format("sphere({})", number(0.2, 0.5));
        break;
    case 1:
        text = fmt::format("box({},{},{})", number(0.3, 0.9), number(0.3, 0.9), number(0.3, 0.9));
        break;
    default:
        text = fmt::format("torus({},{})", number(0.3, 0.5), number(0.12, 0.25));
    }
    if (random.below(2))
        text =
            fmt::format("rotate({},{},{},1,{})", text, number(-1, 1), number(-1, 1), number(0, 90));
    text = fmt::format("translate({},{},{},{})", text, number(-0.5, 0.5), number(-0.5, 0.5),
                       number(-0.5, 0.5));
    const auto exact = parseSolid(text);
    return {solidLevelSet(text, h), [exact](const Vec3d& p) { return exact->distance(p); }, text};
}

Program randomProgram(Random& random, double h, std::size_t nodes)
{
    if (nodes < 3) return randomLeaf(random, h);
    const std::size_t left = 1 + random.below(nodes - 2);
    const Program a = randomProgram(random, h, left);
    const Program b = randomProgram(random, h, nodes - 1 - left);
    const auto fa = a.exact, fb = b.exact;
    switch (random.below(4)) {
    case 0:
        return {a.levelSet & b.levelSet, [=](const Vec3d& p) { return std::max(fa(p), fb(p)); },
                fmt::format("intersection({},{})", a.text, b.text)};
    case 1:
        return {a.levelSet - b.levelSet, [=](const Vec3d& p) { return std::max(fa(p), -fb(p)); },
                fmt::format("difference({},{})", a.text, b.text)};
    default:
        return {a.levelSet | b.levelSet, [=](const Vec3d& p) { return std::min(fa(p), fb(p)); },
                fmt::format("union({},{})", a.text, b.text)};
    }
}

TEST(Combine, RunsRandomPrograms)
{
    const double h = 1.0 / 20;
    for (std::uint64_t seed = 1; seed <= 30; ++seed) {
        Random random(seed);
        const Program program = randomProgram(random, h, 3 + random.below(28));
        SCOPED_TRACE(fmt::format("seed {}: {}", seed, program.text));
        expectSoundCreases(program.levelSet, 0.25); // slivers of a voxel are all crease
        const Accessor at = program.levelSet.grid().getConstAccessor();
        std::uint64_t wrong = 0;
        for (int n = 0; n < 2000; ++n) {
            const Vec3d p = random.inCube(1.2);
            const Vec3i voxel = (p / h).array().round().cast<int>();
            const double d = program.exact(h * voxel.cast<double>());
            if (std::abs(d) > h)
                wrong += (at.getValue(Coord(voxel[0], voxel[1], voxel[2])) < 0) != (d < 0);
        }
        EXPECT_EQ(wrong, 0u);
    }
}

} // namespace
} // namespace mpuvdb::test
