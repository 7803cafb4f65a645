// Warps: inverse against image, stretch as a bound, twisted and bent solids as level sets.
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/mpu_field.h>

namespace mpuvdb
{
namespace
{

using test::sampled;
using test::solidField;
using WarpPtr = std::shared_ptr<const Warp>;

Axis tilted()
{
    return {Vec3d(0.1, -0.2, 0.05), Vec3d(0.2, 0.1, 1)};
}

std::vector<std::pair<std::string, WarpPtr>> warps()
{
    return {
        {"twist", makeTwist(tilted(), 1.7)},
        {"bend", makeBend(tilted(), Vec3d(1, 0.3, 0), 0.5, -0.6, 0.8)},
        {"bend back", makeBend(tilted(), Vec3d(1, 0.3, 0), -0.4, -0.6, 0.8)},
        {"taper", makeTaper(tilted(), -0.5, 0.7, 1.2, 0.4)},
    };
}

/// Where q goes, by Newton's method on the inverse: an independent forward map.
bool forward(const Warp& warp, const Vec3d& q, Vec3d& p)
{
    for (int step = 0; step < 100; ++step) {
        const Vec3d miss = warp.inverse(p) - q;
        if (miss.norm() < 1e-12) return true;
        Eigen::Matrix3d jacobian;
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3d by = 1e-6 * Vec3d::Unit(axis);
            jacobian.col(axis) = (warp.inverse(p + by) - warp.inverse(p - by)) / 2e-6;
        }
        p -= 0.5 * jacobian.inverse() * miss;
    }
    return (warp.inverse(p) - q).norm() < 1e-9;
}

TEST(Warp, ImagesHoldWhatComesFromTheBox)
{
    for (const auto& [name, warp] : warps()) {
        SCOPED_TRACE(name);
        int found = 0;
        test::forRandomPlaces(
            Box3d(Vec3d::Constant(-0.9), Vec3d::Constant(0.9)), 17, 300,
            [&](const Vec3d& q, test::Random& random) {
                Vec3d p = q;
                if (!forward(*warp, q, p)) return;
                ++found;
                for (const double size : {0.01, 0.2, 1.5}) {
                    // A box that has q in it somewhere.
                    const Vec3d u(random.uniform(), random.uniform(), random.uniform());
                    const Vec3d low = q - size * u;
                    Box3d image = warp->image(Box3d(low, low + Vec3d::Constant(size)));
                    image.min().array() -= 1e-9;
                    image.max().array() += 1e-9;
                    EXPECT_TRUE(image.contains(p)) << q.transpose();
                    EXPECT_LT(image.sizes().maxCoeff(), 12 * size);
                }
            });
        EXPECT_GT(found, 250);
    }
}

TEST(Warp, StretchBoundsTheInverse)
{
    for (const auto& [name, warp] : warps()) {
        SCOPED_TRACE(name);
        double tightest = 0;
        test::forRandomPlaces(
            Box3d(Vec3d::Constant(-1), Vec3d::Constant(1)), 23, 5000,
            [&](const Vec3d& p, test::Random& random) {
                const double radius = 0.05;
                const Box3d box(p - Vec3d::Constant(radius), p + Vec3d::Constant(radius));
                const Vec3d a = p + random.inBall(radius), b = a + 1e-5 * random.direction();
                const double ratio = (warp->inverse(a) - warp->inverse(b)).norm() / (a - b).norm();
                const double bound = warp->stretch(box);
                EXPECT_LE(ratio, bound * (1 + 1e-6)) << p.transpose();
                tightest = std::max(tightest, ratio / bound);
            });
        EXPECT_GT(tightest, 0.8);
    }
}

TEST(Warp, LeavesTheEndsOfABendStraight)
{
    // A quarter of a circle of radius 2 towards +x.
    const Axis axis{Vec3d::Zero(), Vec3d::UnitZ()};
    const WarpPtr bend = makeBend(axis, Vec3d::UnitX(), 0.5, 0, M_PI);
    const auto expect = [&](const Vec3d& to, const Vec3d& from) {
        EXPECT_LT((bend->inverse(to) - from).norm(), 1e-12) << to.transpose();
    };
    expect({0, 0, -1}, {0, 0, -1});
    expect({0.3, 0.5, 0}, {0.3, 0.5, 0});
    expect({2, 0, 2}, {0, 0, M_PI});
    expect({2, 0.1, 1.5}, {0.5, 0.1, M_PI});
    expect({3, 0, 2}, {0, 0, M_PI + 1});
    const double s = std::sqrt(0.5);
    expect({2 - 2 * s, 0, 2 * s}, {0, 0, M_PI / 2});
}

TEST(WarpedField, IsNoSteeperThanItSays)
{
    for (const auto& [name, warp] : warps()) {
        SCOPED_TRACE(name);
        const FieldPtr warped = makeWarpedField(solidField("box(0.6, 0.8, 1.4)"), warp);
        double steepest = 0;
        test::forRandomPlaces(
            warped->bounds(), 31, 20000, [&](const Vec3d& p, test::Random& random) {
                const FieldSample sample = warped->evaluate(p);
                if (std::abs(sample.value) > 0.02) return;
                const Vec3d q = p + 1e-5 * random.direction();
                steepest =
                    std::max(steepest, std::abs(warped->evaluate(q).value - sample.value) / 1e-5);
            });
        EXPECT_LE(steepest, warped->steepness() * (1 + 1e-6));
        EXPECT_GT(steepest, 0.5 * warped->steepness());
        EXPECT_FALSE(warped->isDistance());
    }
}

TEST(WarpedField, TwistKeepsVolumeAndUndoesItself)
{
    const Axis axis{Vec3d::Zero(), Vec3d::UnitZ()};
    const FieldPtr box = solidField("box(0.8, 0.5, 1.6)");
    const FieldPtr twisted = makeWarpedField(box, makeTwist(axis, 1.5));
    const LevelSet levelSet = sampled(*twisted, 1.0 / 40, 3, Vec3d(1e-3, 2e-3, 3e-3));
    test::expectSound(levelSet);
    const MeshReport mesh = test::meshed(levelSet);
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
    EXPECT_NEAR(mesh.volume, 0.64, 0.01 * 0.64);
    RecordProperty("volume", std::to_string(mesh.volume));

    const FieldPtr back = makeWarpedField(twisted, makeTwist(axis, -1.5));
    test::forRandomPlaces(Box3d(Vec3d::Constant(-1), Vec3d::Constant(1)), 41, 500,
                          [&](const Vec3d& p, test::Random&) {
                              EXPECT_NEAR(back->evaluate(p).value, box->evaluate(p).value, 1e-12);
                          });
    Box3d zone = back->bounds();
    zone.extend(zone.max() + Vec3d::Constant(1e-9)).extend(zone.min() - Vec3d::Constant(1e-9));
    EXPECT_TRUE(zone.contains(box->bounds()));
}

TEST(WarpedField, TwistedFitIsTheTwistedSolid)
{
    MpuSettings settings;
    settings.tolerance = 0.002;
    settings.voxelSize = 1.0 / 24;
    Interrupter progress;
    const std::string solid = "union(translate(torus(0.6, 0.2), 0, 0, 0.5), "
                              "translate(torus(0.6, 0.2), 0, 0, -0.5))";
    const FieldPtr fitted =
        std::make_shared<MpuField>(test::randomScan(solid, 20000), settings, &progress);
    const WarpPtr twist = makeTwist({Vec3d(0.4, 0, 0), Vec3d(0, 1, 0.2)}, 0.8);
    const FieldPtr exact = makeWarpedField(solidField(solid), twist);
    const FieldPtr warped = makeWarpedField(fitted, twist);
    const LevelSet a = sampled(*exact, 1.0 / 24), b = sampled(*warped, 1.0 / 24);
    test::expectSound(b);
    EXPECT_EQ(test::meshed(b).components, 2u);
    EXPECT_EQ(test::meshed(b).eulerCharacteristic, 0);
    EXPECT_NEAR(test::meshed(b).volume, test::meshed(a).volume, 0.01 * test::meshed(a).volume);
}

TEST(WarpedField, BendsABarIntoAnArc)
{
    // Half a ring with straight ends of 0.5: Pappus' theorem keeps the volume.
    const double length = M_PI + 1;
    const FieldPtr bar = solidField("cylinder(0.2, " + std::to_string(length) + ")");
    const WarpPtr bend =
        makeBend({Vec3d::Zero(), Vec3d::UnitZ()}, Vec3d::UnitY(), 1, -M_PI / 2, M_PI / 2);
    const FieldPtr arc = makeWarpedField(bar, bend);
    EXPECT_LT(arc->steepness(), 1.6); // 1 / 0.8 and what cubes add
    const LevelSet levelSet = sampled(*arc, 1.0 / 32);
    test::expectSound(levelSet);
    const MeshReport mesh = test::meshed(levelSet);
    EXPECT_EQ(mesh.components, 1u);
    EXPECT_EQ(mesh.eulerCharacteristic, 2);
    EXPECT_NEAR(mesh.volume, M_PI * 0.04 * length, 0.015 * M_PI * 0.04 * length);
    // As exact as a distance where it is bent: that of the torus.
    const Vec3d center(0, 1, -M_PI / 2);
    const auto torus = [&](const Vec3d& p) {
        const Vec3d q = p - center;
        return std::hypot(std::hypot(q[1], q[2]) - 1, q[0]) - 0.2;
    };
    const Lattice lattice = levelSet.lattice();
    double largest = 0;
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on) {
        const Vec3d p = test::worldOf(lattice, on.getCoord());
        if (p[2] > -M_PI / 2 + 0.2 && std::abs(torus(p)) < 2 * lattice.voxelSize)
            largest = std::max(largest, std::abs(double(*on) - torus(p)) / lattice.voxelSize);
    }
    EXPECT_LT(largest, 0.08);
    // A bar that reaches the center has no bounded slope.
    EXPECT_THROW(makeWarpedField(solidField("cylinder(1.1, 3)"), bend), UsageError);
}

TEST(WarpedField, TapersAPrismToAFrustum)
{
    const FieldPtr prism = solidField("box(1, 1, 2)");
    const WarpPtr taper = makeTaper({Vec3d::Zero(), Vec3d::UnitZ()}, -1, 1, 1, 0.3);
    const LevelSet levelSet = sampled(*makeWarpedField(prism, taper), 1.0 / 32);
    test::expectSound(levelSet);
    const double volume = 2.0 / 3 * (1 + 0.3 + 0.09);
    EXPECT_NEAR(test::meshed(levelSet).volume, volume, 0.01 * volume);
}

TEST(WarpedField, TakesAUsersWarp)
{
    // A wave across, with an image that is far too large.
    const auto inverse = [](const Vec3d& p) {
        return Vec3d(p[0] - 0.2 * std::sin(3 * p[2]), p[1], p[2]);
    };
    const auto image = [](const Box3d& box) {
        return Box3d(box.min() - Vec3d::Constant(0.5), box.max() + Vec3d::Constant(0.5));
    };
    const WarpPtr wave = makeWarp(inverse, image, 1.35);
    const LevelSet levelSet =
        sampled(*makeWarpedField(solidField("capsule(0.3, 1)"), wave), 1.0 / 32);
    test::expectSound(levelSet);
    const double volume = M_PI * (0.09 + 4.0 / 3 * 0.027);
    EXPECT_NEAR(test::meshed(levelSet).volume, volume, 0.01 * volume);
}

TEST(Warp, RefusesWhatIsNoWarp)
{
    const Axis axis;
    EXPECT_THROW(makeTwist(axis, std::nan("")), UsageError);
    EXPECT_THROW(makeTwist({Vec3d::Zero(), Vec3d::Zero()}, 1), UsageError);
    EXPECT_THROW(makeBend(axis, Vec3d::UnitZ(), 1, 0, 1), UsageError);
    EXPECT_THROW(makeBend(axis, Vec3d::UnitX(), 1, 0, 7), UsageError);
    EXPECT_THROW(makeBend(axis, Vec3d::UnitX(), 1, 1, 1), UsageError);
    EXPECT_THROW(makeTaper(axis, 0, 1, 1, 0), UsageError);
    EXPECT_THROW(makeTaper(axis, 1, 0, 1, 1), UsageError);
    EXPECT_THROW(makeWarp(std::function<Vec3d(const Vec3d&)>(), {}, 1), UsageError);
    EXPECT_THROW(makeWarpedField(makeGyroid(1, 0.1), makeTwist(axis, 1)), UsageError);
    const Vec3d p(0.3, 0.2, 5);
    EXPECT_EQ(makeBend(axis, Vec3d::UnitX(), 0, 0, 1)->inverse(p), p);
}

} // namespace
} // namespace mpuvdb
