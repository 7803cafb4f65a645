// Fields from solids, formulas and motions: bounds that hold, seeds that find all, sound level
// sets.
#include "modelling_fixture.h"

#include "spatial/kd_tree.h"

#include <mpuvdb/error.h>
#include <mpuvdb/mpu_field.h>

#include <set>

namespace mpuvdb
{
namespace
{

using test::sampled;
using test::solidField;

Box3d cube(double half)
{
    return Box3d(Vec3d::Constant(-half), Vec3d::Constant(half));
}

double boxDistance(const Box3d& box, const Vec3d& p)
{
    const Vec3d q = (box.min() - p).cwiseMax(p - box.max());
    return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
}

/// A small fitted field: a sphere's points.
FieldPtr fittedSphere()
{
    MpuSettings settings;
    settings.tolerance = 0.002;
    settings.voxelSize = 1.0 / 24;
    Interrupter progress;
    return std::make_shared<MpuField>(test::randomScan("sphere(1)", 6000), settings, &progress);
}

// --- Solids

/// The distance of the nearest of many places on the ellipsoid, refined: an upper bound.
double bruteEllipsoid(const Vec3d& radii, const Vec3d& p)
{
    double best = 1e300, a = 0, b = 0;
    const auto at = [&](double u, double v) {
        const Vec3d s(std::sin(u) * std::cos(v), std::sin(u) * std::sin(v), std::cos(u));
        return (radii.cwiseProduct(s) - p).norm();
    };
    constexpr int kSteps = 60;
    for (int i = 0; i <= kSteps; ++i)
        for (int j = 0; j < 2 * kSteps; ++j) {
            const double u = M_PI * i / kSteps, v = M_PI * j / kSteps, d = at(u, v);
            if (d < best) best = d, a = u, b = v;
        }
    for (double step = M_PI / kSteps; step > 1e-9; step /= 2)
        for (bool better = true; better;) {
            better = false;
            for (const auto& [du, dv] : {std::pair(step, 0.0), std::pair(-step, 0.0),
                                         std::pair(0.0, step), std::pair(0.0, -step)}) {
                const double d = at(a + du, b + dv);
                if (d < best - 1e-15) best = d, a += du, b += dv, better = true;
            }
        }
    return best;
}

TEST(Ellipsoid, HasTheDistanceOfTheNearestPlace)
{
    for (const Vec3d& radii : {Vec3d(1, 0.6, 0.3), Vec3d(0.2, 1, 1), Vec3d(1, 1, 1),
                               Vec3d(2, 0.05, 0.7), Vec3d(0.5, 0.5, 1.5)}) {
        const auto solid =
            parseSolid("ellipsoid(" + std::to_string(radii[0]) + "," + std::to_string(radii[1]) +
                       "," + std::to_string(radii[2]) + ")");
        EXPECT_TRUE(solid->isExact());
        EXPECT_TRUE(solid->bounds().isApprox(Box3d(-radii, radii)));
        const Box3d box(-1.6 * radii, 1.6 * radii);
        test::forRandomPlaces(box, 11, 60, [&](Vec3d p, test::Random& random) {
            // Also in the planes and on the axes, where the nearest place is not unique.
            for (int axis = 0; axis < 3; ++axis)
                if (random.below(4) == 0) p[axis] = 0;
            const double d = solid->distance(p);
            // No place found is nearer, and there is a place at that distance: the foot below.
            EXPECT_LE(std::abs(d), bruteEllipsoid(radii, p) + 1e-9) << p.transpose();
            EXPECT_EQ(d < 0, p.cwiseQuotient(radii).squaredNorm() < 1);
            const Vec3d n = solid->normal(p), foot = p - d * n;
            EXPECT_NEAR(n.norm(), 1, 1e-12);
            EXPECT_NEAR(foot.cwiseQuotient(radii).squaredNorm(), 1, 1e-7) << p.transpose();
        });
    }
    EXPECT_NE(solidHelp().find("ellipsoid"), std::string::npos);
}

TEST(SolidField, MeetsTheSurfaceWithItsSeedsOnly)
{
    const auto solid = parseSolid("rotate(torus(1, 0.3), 1, 2, 3, 50)");
    const FieldPtr field = makeSolidField(solid);
    const Lattice lattice{Vec3d(0.3, -0.1, 7e-3), 1.0 / 100};
    const std::vector<Vec3i> seeds = field->seedBlocks(lattice);
    // All blocks of the box that may meet it, tried one by one.
    const double edge = kBlockDim * lattice.voxelSize;
    std::size_t n = 0;
    for (int x = -25; x < 25; ++x)
        for (int y = -25; y < 25; ++y)
            for (int z = -25; z < 25; ++z) {
                const Vec3d center = lattice.origin + edge * Vec3d(x, y, z) +
                                     Vec3d::Constant((kBlockDim - 1) / 2.0 * lattice.voxelSize);
                const Vec3d half = Vec3d::Constant(edge / 2);
                if (std::abs(solid->distance(center)) > std::sqrt(3.0) / 2 * edge ||
                    !solid->bounds().intersects(Box3d(center - half, center + half)))
                    continue;
                ASSERT_LT(n, seeds.size());
                EXPECT_EQ(seeds[n], Vec3i(x, y, z));
                ++n;
            }
    EXPECT_EQ(n, seeds.size());
}

TEST(SolidField, RefusesVoxelsThatNoMemoryHolds)
{
    const FieldPtr field = solidField("sphere(1)");
    EXPECT_THROW(field->seedBlocks({Vec3d::Zero(), 1e-10}), LimitError);
    EXPECT_THROW(field->seedBlocks({Vec3d::Constant(1e6), 1.6e-5}), LimitError);
}

TEST(SolidField, IsRedistancedWhereBooleansTellLess)
{
    const auto solid = parseSolid("difference(sphere(1), translate(sphere(0.8), 0.7, 0, 0))");
    const FieldPtr field = makeSolidField(solid);
    EXPECT_FALSE(field->isDistance());
    EXPECT_TRUE(solidField("rotate(cone(1,1),1,0,0,20)")->isDistance());
    const LevelSet levelSet = sampled(*field, 1.0 / 32, 5);
    test::expectSound(levelSet);
    // Away from the crease the values are those of the spheres.
    const auto exact = [&](const Vec3d& p) { return solid->distance(p); };
    const test::Deviation d = test::deviation(levelSet, exact, 1);
    EXPECT_LT(d.wrongSigns, d.voxels / 1000); // the crease is rounded
    EXPECT_LT(d.mean, 0.02);
}

// --- Half-space and gyroid

TEST(HalfSpace, NeedsABoxToBecomeALevelSet)
{
    const Vec3d normal = Vec3d(1, 2, 2) / 3;
    const FieldPtr field = makeHalfSpace({0.1, 0, 0}, 5 * normal);
    EXPECT_TRUE(field->isDistance());
    EXPECT_FALSE(field->bounds().sizes().allFinite());
    EXPECT_NEAR(field->evaluate({0.1, 3, -1}).value, 4.0 / 3, 1e-12);
    EXPECT_THROW(sampled(*field, 0.1), UsageError);
    EXPECT_THROW(field->seedBlocks({Vec3d::Zero(), 0.1}), UsageError);
    EXPECT_THROW(makeHalfSpace(Vec3d::Zero(), Vec3d::Zero()), UsageError);

    const LevelSet cut = sampled(*makeClippedField(field, cube(1)), 1.0 / 24);
    test::expectSound(cut);
    // The plane cuts the cube into parts of known volume: here by counting fine cells.
    std::uint64_t inside = 0;
    constexpr int kCells = 200;
    for (int x = 0; x < kCells; ++x)
        for (int y = 0; y < kCells; ++y) {
            // z below (0.1 - x - 2 y) / 2
            const double at = -1 + (x + 0.5) * 2 / kCells, b = -1 + (y + 0.5) * 2 / kCells;
            const double top = (0.1 - at - 2 * b) / 2;
            inside += std::uint64_t(1e6 * (std::clamp(top, -1.0, 1.0) + 1));
        }
    const double volume = double(inside) / 1e6 * 4 / (kCells * kCells);
    EXPECT_NEAR(test::meshed(cut).volume, volume, 0.01 * volume);
}

/// Places of the gyroid of period 1 in and about the unit cube, @a apart or less from each other.
std::vector<Vec3f> gyroidPlaces(double apart)
{
    std::vector<Vec3f> places;
    for (double x = -0.3; x < 1.3; x += apart)
        for (double y = -0.3; y < 1.3; y += apart) {
            const auto value = [&](double z) {
                const Eigen::Array3d a = 2 * M_PI * Eigen::Array3d(x, y, z), s = a.sin(),
                                     c = a.cos();
                return s[0] * c[1] + s[1] * c[2] + s[2] * c[0];
            };
            for (double z = -0.3; z < 1.3; z += apart) {
                const double below = value(z), above = value(z + apart);
                if ((below < 0) == (above < 0)) continue;
                const auto crossing = float(z + apart * below / (below - above));
                // The gyroid stays where axes are exchanged: so places are dense on all its parts.
                places.emplace_back(float(x), float(y), crossing);
                places.emplace_back(float(y), crossing, float(x));
                places.emplace_back(crossing, float(x), float(y));
            }
        }
    return places;
}

TEST(Gyroid, HasWallsOfItsThickness)
{
    const double apart = 0.02;
    const std::vector<Vec3f> places = gyroidPlaces(apart);
    const KdTree tree(places);
    const double thickness = 0.12;
    const FieldPtr field = makeGyroid(1, thickness);
    EXPECT_FALSE(field->isDistance());
    double farthest = 0;
    const Box3d unit(Vec3d::Zero(), Vec3d::Ones());
    test::forRandomPlaces(unit, 5, 20000, [&](const Vec3d& p, test::Random&) {
        std::vector<std::uint32_t> nearest(1);
        std::vector<float> squared(1);
        tree.nearest(p.cast<float>(), nearest, squared);
        const double distance = std::sqrt(double(squared[0])), at = field->evaluate(p).value;
        EXPECT_LE(at, distance - thickness / 2 + 1e-3);
        EXPECT_GE(at, distance - thickness / 2 - 0.75 * apart);
        EXPECT_NEAR(field->evaluate(p - Vec3d(3, -1, 7)).value, at, 1e-9);
        farthest = std::max(farthest, at + thickness / 2);
    });
    EXPECT_NEAR(makeGyroid(1, 0.4)->evaluate({0.25, 0.125, 0}).value, 0.0296578, 1e-6);
    EXPECT_LE(farthest, 0.229658);
    EXPECT_GE(farthest, 0.22);

    const FieldPtr cut = makeClippedField(field, cube(0.8));
    const LevelSet levelSet = sampled(*cut, 1.0 / 32);
    test::expectSound(levelSet);
    EXPECT_EQ(test::meshed(levelSet).boundaryEdges, 0u);
    EXPECT_NO_THROW(makeGyroid(1, 0.45));
    EXPECT_THROW(makeGyroid(1, 0.46), UsageError);
    EXPECT_THROW(makeGyroid(0, 0.1), UsageError);
}

TEST(Fields, AreNoSteeperThanTheySay)
{
    const FieldPtr gyroid = makeGyroid(2, 0.2);
    const FieldPtr wave = makeFunctionField(
        [](const Vec3d& p) { return p.norm() - 1 + 0.1 * std::sin(8 * p[0]); }, cube(1.2), 1.8);
    Eigen::Affine3d squeeze = Eigen::Affine3d::Identity();
    squeeze.linear() << 1, 0.3, 0, 0, 0.5, 0.2, 0, 0, 2;
    const std::vector<FieldPtr> fields = {
        gyroid,
        wave,
        makeClippedField(gyroid, cube(0.7)),
        makeMovedField(gyroid, squeeze),
        makeMovedField(solidField("box(1, 1, 1)"), squeeze),
        makeMovedField(solidField("torus(1, 0.2)"), Eigen::Affine3d(Eigen::Scaling(3.0))),
    };
    for (std::size_t n = 0; n < fields.size(); ++n) {
        double steepest = 0;
        test::forRandomPlaces(cube(1.5), 3, 20000, [&](const Vec3d& p, test::Random& random) {
            const Vec3d q = p + 1e-4 * random.direction();
            const double rise =
                std::abs(fields[n]->evaluate(q).value - fields[n]->evaluate(p).value);
            steepest = std::max(steepest, rise / (q - p).norm());
        });
        EXPECT_LE(steepest, fields[n]->steepness() * (1 + 1e-9)) << n;
        EXPECT_GE(steepest, 0.5 * fields[n]->steepness()) << n;
    }
}

// --- Functions

TEST(FunctionField, IsWhatItsFunctionSays)
{
    // An ellipsoid by its implicit function, which is far from a distance.
    const Vec3d radii(1, 0.7, 0.5);
    const auto implicit = [&](const Vec3d& p) { return p.cwiseQuotient(radii).squaredNorm() - 1; };
    const Box3d box(-1.05 * radii, 1.05 * radii);
    const FieldPtr field = makeFunctionField(implicit, box, 6);
    const auto solid = parseSolid("ellipsoid(1, 0.7, 0.5)");
    const auto exact = [&](const Vec3d& p) { return solid->distance(p); };
    double before = 0;
    for (const double n : {20.0, 40.0}) {
        const LevelSet levelSet = sampled(*field, 1 / n, 4, Vec3d(1e-3, 2e-3, 3e-3));
        test::expectSound(levelSet);
        const test::Deviation d = test::deviation(levelSet, exact);
        RecordProperty("mean_" + std::to_string(int(n)), std::to_string(d.mean));
        EXPECT_EQ(d.wrongSigns, 0u);
        EXPECT_LT(d.largest, 0.1);
        EXPECT_LT(d.mean, 0.02);
        if (before > 0) {
            EXPECT_LT(d.mean, 0.6 * before);
        }
        before = d.mean;
    }
    EXPECT_EQ(sampled(*field, 0.1, 4).grid().getName(), "surface");
}

TEST(FunctionField, IsCutOffAtItsBounds)
{
    // The half-space below 0.1, steep or not, ends as a box; what is inside everywhere is all of
    // it.
    const Box3d whole(Vec3d(-1, -0.8, -0.6), Vec3d(1, 0.8, 0.6));
    Box3d lower = whole;
    lower.max()[2] = 0.1;
    struct {
        double slope;
        Box3d solid;
    } const cases[] = {{1, lower}, {3, lower}, {0, whole}};
    for (const auto& c : cases) {
        const FieldPtr field = makeFunctionField(
            [&](const Vec3d& p) { return c.slope > 0 ? c.slope * (p[2] - 0.1) : -1; }, whole,
            c.slope > 0 ? c.slope : 1);
        const LevelSet levelSet = sampled(*field, 0.04, 3, Vec3d(0.011, 0.023, 0.007));
        test::expectSound(levelSet);
        const test::Deviation d =
            test::deviation(levelSet, [&](const Vec3d& p) { return boxDistance(c.solid, p); });
        RecordProperty("largest", std::to_string(d.largest));
        EXPECT_EQ(d.wrongSigns, 0u);
        EXPECT_LT(d.mean, 1e-3);
        EXPECT_LT(d.largest, 0.02);
        EXPECT_EQ(test::meshed(levelSet).boundaryEdges, 0u);
    }
}

TEST(FunctionField, StaysWhereItIsWithinTightBounds)
{
    // Steeper than a distance, and touching its bounds in six places.
    const FieldPtr field =
        makeFunctionField([](const Vec3d& p) { return p.squaredNorm() - 1; }, cube(1), 2.2);
    const LevelSet levelSet = sampled(*field, 0.04, 3, Vec3d(0.011, 0.023, 0.007));
    test::expectSound(levelSet);
    const test::Deviation d =
        test::deviation(levelSet, [](const Vec3d& p) { return p.norm() - 1; });
    EXPECT_LT(d.mean, 2e-3);
    EXPECT_LT(d.largest, 0.05);
}

TEST(FunctionField, HasASlopeAtItsCut)
{
    const FieldPtr field = makeFunctionField([](const Vec3d& p) { return 2 * p[2]; }, cube(1), 2);
    const FieldSample face = field->evaluate(Vec3d(0.999, 0.2, -0.5));
    EXPECT_NEAR(face.value, -0.002, 1e-12);
    EXPECT_LT((face.gradient - Vec3d(2, 0, 0)).norm(), 1e-9);
    const FieldSample own = field->evaluate(Vec3d(0.2, 0.2, -0.1));
    EXPECT_NEAR(own.value, -0.2, 1e-12);
    EXPECT_LT((own.gradient - Vec3d(0, 0, 2)).norm(), 1e-6);
}

TEST(FunctionField, FindsEveryPart)
{
    const auto balls = [](const Vec3d& p) {
        double nearest = 1e300;
        for (int i = 0; i < 10; ++i)
            nearest = std::min(nearest, (p - Vec3d(i, (7 * i) % 10, (3 * i) % 10)).norm() - 0.05);
        return nearest;
    };
    const FieldPtr field =
        makeFunctionField(balls, Box3d(Vec3d::Constant(-0.1), Vec3d::Constant(9.1)), 1);
    EXPECT_EQ(test::meshed(sampled(*field, 0.02)).components, 10u);
    EXPECT_LT(field->seedBlocks({Vec3d::Zero(), 0.02}).size(), 400u);
}

TEST(FunctionField, RefusesWhatIsNoNumber)
{
    const FieldPtr broken = makeFunctionField(
        [](const Vec3d& p) { return p[0] > 0.5 ? std::nan("") : p.norm() - 1; }, cube(1.1), 1);
    EXPECT_THROW(sampled(*broken, 0.1), InputError);
    EXPECT_THROW(makeFunctionField(std::function<double(const Vec3d&)>(), cube(1), 1), UsageError);
    EXPECT_THROW(makeFunctionField([](const Vec3d&) { return 0.0; }, cube(1), 0), UsageError);
    EXPECT_THROW(makeFunctionField([](const Vec3d&) { return 0.0; }, Box3d(), 1), UsageError);
}

// --- Motions

TEST(MovedField, KeepsTheDistanceUnderSimilarities)
{
    Eigen::Affine3d motion = Eigen::Translation3d(0.3, -2, 5) *
                             Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()) *
                             Eigen::Scaling(2.5);
    const FieldPtr moved = makeMovedField(solidField("box(1, 0.6, 0.4)"), motion);
    EXPECT_TRUE(moved->isDistance());
    EXPECT_NEAR(moved->steepness(), 1, 1e-12);
    const auto straight = parseSolid("box(2.5, 1.5, 1)");
    const Eigen::Affine3d back = (motion * Eigen::Scaling(0.4)).inverse();
    const auto exact = [&](const Vec3d& p) { return straight->distance(back * p); };
    test::forRandomPlaces(moved->bounds(), 7, 500, [&](const Vec3d& p, test::Random&) {
        const FieldSample sample = moved->evaluate(p);
        EXPECT_NEAR(sample.value, exact(p), 1e-12);
        EXPECT_NEAR(sample.gradient.norm(), 1, 1e-6);
    });
    const LevelSet levelSet = sampled(*moved, 1.0 / 16);
    test::expectSound(levelSet);
    EXPECT_LT(test::deviation(levelSet, exact).largest, 1e-4);
    // A mirror image, too.
    const FieldPtr mirrored =
        makeMovedField(solidField("cone(1, 2)"), Eigen::Affine3d(Eigen::Scaling(1.0, 1.0, -1.0)));
    EXPECT_TRUE(mirrored->isDistance());
    EXPECT_NEAR(mirrored->evaluate({0, 0, -1.5}).value, 0.5, 1e-12);
}

TEST(MovedField, StretchesASphereToAnEllipsoid)
{
    Eigen::Affine3d motion(Eigen::Scaling(1.0, 0.6, 0.3));
    motion.translation() = Vec3d(0.1, 0.2, 0.3);
    const auto solid = parseSolid("translate(ellipsoid(1, 0.6, 0.3), 0.1, 0.2, 0.3)");
    const auto exact = [&](const Vec3d& p) { return solid->distance(p); };
    for (const FieldPtr& sphere : {solidField("sphere(1)"), fittedSphere()}) {
        const FieldPtr moved = makeMovedField(sphere, motion);
        EXPECT_FALSE(moved->isDistance());
        EXPECT_NEAR(moved->steepness(), 1 / 0.3, 1e-9);
        const LevelSet levelSet = sampled(*moved, 1.0 / 32);
        test::expectSound(levelSet);
        const test::Deviation d = test::deviation(levelSet, exact, 2);
        EXPECT_LT(d.mean, 0.05);
        EXPECT_EQ(d.wrongSigns, 0u);
    }
}

TEST(MovedField, KeepsTheBlocksOfAFittedFieldUnderShifts)
{
    const FieldPtr fitted = fittedSphere();
    Eigen::Affine3d motion(Eigen::Scaling(2.0));
    motion.translation() = Vec3d(3, -1, 0.5);
    const FieldPtr moved = makeMovedField(fitted, motion);
    // On lattices that move along, the grids have the same topology and twice the values.
    const LevelSet a = sampled(*fitted, 1.0 / 32),
                   b = sampled(*moved, 1.0 / 16, 3, motion.translation());
    EXPECT_EQ(a.grid().activeVoxelCount(), b.grid().activeVoxelCount());
    const auto at = b.grid().getConstAccessor();
    for (auto on = a.grid().cbeginValueOn(); on; ++on)
        ASSERT_EQ(2 * *on, at.getValue(on.getCoord())) << on.getCoord();
    // Turned, it is evaluated point by point: the same surface.
    const FieldPtr turned =
        makeMovedField(fitted, Eigen::Affine3d(Eigen::AngleAxisd(1, Vec3d(3, 1, 2).normalized())));
    EXPECT_TRUE(turned->isDistance());
    const LevelSet c = sampled(*turned, 1.0 / 32);
    test::expectSound(c);
    EXPECT_NEAR(test::meshed(c).volume, test::meshed(a).volume, 1e-3);
    const auto sphere = [](const Vec3d& p) { return p.norm() - 1; };
    EXPECT_LT(test::deviation(c, sphere, 1).largest,
              2 * test::deviation(a, sphere, 1).largest + 0.02);
}

TEST(MovedField, RefusesWhatHasNoInverse)
{
    const FieldPtr field = solidField("sphere(1)");
    EXPECT_THROW(makeMovedField(field, Eigen::Affine3d(Eigen::Scaling(1.0, 0.0, 1.0))), UsageError);
    Eigen::Affine3d bad = Eigen::Affine3d::Identity();
    bad.translation()[1] = std::nan("");
    EXPECT_THROW(makeMovedField(field, bad), UsageError);
}

// --- Clipping

TEST(ClippedField, KeepsWhatIsInTheBox)
{
    const Box3d box(Vec3d(-0.5, -2, -2), Vec3d(2, 0.4, 0.3));
    for (const FieldPtr& sphere : {solidField("sphere(1)"), fittedSphere()}) {
        const FieldPtr clipped = makeClippedField(sphere, box);
        const Box3d bounds = clipped->bounds();
        EXPECT_NEAR(bounds.min()[0], -0.5, 1e-9);
        EXPECT_NEAR(bounds.max()[2], 0.3, 1e-9);
        const LevelSet levelSet = sampled(*clipped, 1.0 / 32);
        test::expectSound(levelSet);
        const auto exact = [&](const Vec3d& p) {
            return std::max(p.norm() - 1, boxDistance(box, p));
        };
        const test::Deviation d = test::deviation(levelSet, exact, 1);
        EXPECT_LT(d.mean, 0.05);
        EXPECT_EQ(test::meshed(levelSet).components, 1u);
    }
    EXPECT_THROW(makeClippedField(solidField("sphere(1)"), Box3d()), UsageError);
    EXPECT_THROW(sampled(*makeClippedField(solidField("sphere(1)"),
                                           Box3d(Vec3d::Constant(3), Vec3d::Constant(4))),
                         0.1),
                 InputError);
}

TEST(ClippedField, FindsWallsThatNoSurfaceMeets)
{
    // The box lies inside the sphere, so that all that is left of it is the box.
    const LevelSet levelSet = sampled(*makeClippedField(solidField("sphere(3)"), cube(0.5)), 0.04);
    EXPECT_NEAR(test::meshed(levelSet).volume, 1, 0.01);
}

} // namespace
} // namespace mpuvdb
