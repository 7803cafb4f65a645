// Shapes: what is planned, that it is enough, and that it is no more than is needed.
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <cmath>
#include <random>

namespace mpuvdb
{
namespace
{

using test::expectSound;

Shape solid(const std::string& description)
{
    return Shape(makeSolidField(parseSolid(description)), description);
}

Shape movedBy(const Shape& shape, const Vec3d& by)
{
    return shape.moved(Eigen::Affine3d(Eigen::Translation3d(by)));
}

ShapeSettings voxels(double size, double halfWidth = 3)
{
    ShapeSettings settings;
    settings.voxelSize = size;
    settings.halfWidth = halfWidth;
    return settings;
}

LevelSet evaluated(const Shape& shape, const ShapeSettings& settings)
{
    Interrupter progress;
    return shape.evaluate(settings, &progress);
}

double volume(const LevelSet& levelSet)
{
    Interrupter progress;
    return measure(levelSet, &progress).volume;
}

/// A field that counts how often it is sampled.
class CountedField final : public Field
{
public:
    explicit CountedField(FieldPtr field) : mField(std::move(field)) {}
    Box3d bounds() const override { return mField->bounds(); }
    FieldSample evaluate(const Vec3d& p) const override { return mField->evaluate(p); }
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override
    {
        return mField->seedBlocks(lattice);
    }
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override
    {
        ++mSampled;
        return mField->sampler(lattice, band);
    }
    bool sampled() const { return mSampled > 0; }

private:
    FieldPtr mField;
    mutable std::atomic<int> mSampled{0};
};

std::shared_ptr<CountedField> counted(const std::string& description)
{
    return std::make_shared<CountedField>(makeSolidField(parseSolid(description)));
}

TEST(Shape, OperatorsAreBooleans)
{
    const Shape ball = solid("sphere(1)"), box = movedBy(solid("box(1,1,1)"), {0.9, 0, 0});
    const auto settings = voxels(1.0 / 32);
    const double a = volume(evaluated(ball, settings)), b = volume(evaluated(box, settings));
    const LevelSet both = evaluated(ball | box, settings), common = evaluated(ball & box, settings),
                   cut = evaluated(ball - box, settings);
    for (const LevelSet& made : {both, common, cut}) expectSound(made);
    // Inclusion and exclusion; the error of a volume is of second order, creases add one cell along
    // their length: h^2 times area and length, all about ten here.
    const double tolerance = 10 * settings.voxelSize * settings.voxelSize;
    EXPECT_NEAR(volume(both), a + b - volume(common), tolerance);
    EXPECT_NEAR(volume(cut), a - volume(common), tolerance);
}

TEST(Shape, ACutterFarAwayIsNotSampled)
{
    const auto near = counted("sphere(1)"), far = counted("sphere(0.5)");
    const Shape ball(near, "ball");
    const Shape cutter = movedBy(Shape(far, "cutter"), {5, 0, 0});
    const auto settings = voxels(0.1);
    const LevelSet cut = evaluated(ball - cutter, settings);
    EXPECT_TRUE(near->sampled());
    EXPECT_FALSE(far->sampled());
    EXPECT_NE((ball - cutter).explain(settings).find("too far away"), std::string::npos);
    EXPECT_EQ(evaluated(ball & cutter, settings).grid().activeVoxelCount(), 0u);
    expectSound(cut);
}

TEST(Shape, ExplainEndsWithWhatTheLimitIsComparedWith)
{
    const Shape shape = solid("sphere(0.5)") | movedBy(solid("sphere(0.5)"), {0.6, 0, 0});
    ShapeSettings settings = voxels(0.05);
    const std::string text = shape.explain(settings);
    const std::size_t last = text.rfind("together");
    ASSERT_NE(last, std::string::npos) << text;
    const double megabytes = std::stod(text.substr(last + 8));
    double most = 0, all = 0; // of one grid, of all
    for (const PlanStep& step : shape.plan(settings)) {
        most = std::max(most, double(step.bytes) / 1e6);
        all += double(step.bytes) / 1e6;
    }
    EXPECT_GE(megabytes, most - 0.05);
    EXPECT_LE(megabytes, all + 0.05);
    Interrupter progress;
    settings.maxBytes = std::uint64_t((megabytes + 0.1) * 1e6);
    EXPECT_NO_THROW(shape.evaluate(settings, &progress));
    settings.maxBytes = std::uint64_t((megabytes - 0.1) * 1e6);
    EXPECT_THROW(shape.evaluate(settings, &progress), LimitError);
}

TEST(Shape, WhatIsSharedIsMadeOnce)
{
    const Shape ball = solid("sphere(1)");
    const Shape grown = ball.offset(0.2);
    const auto steps = (grown - ball).plan(voxels(0.1));
    ASSERT_EQ(steps.size(), 4u); // difference, offset, sphere, the sphere again
    EXPECT_FALSE(steps[2].shared);
    EXPECT_TRUE(steps[3].shared);
    const Shape moved = movedBy(grown - ball, {1, 0, 0});
    EXPECT_TRUE(moved.plan(voxels(0.1))[3].shared) << "what is moved together stays shared";
}

TEST(Shape, ALoopOfBooleansIsOneBoolean)
{
    // A solid and one more, again and again; of the same solid twice, one is left.
    constexpr int kBalls = 20;
    const auto settings = voxels(0.1);
    std::vector<Shape> balls;
    for (int n = 0; n < kBalls; ++n) balls.push_back(movedBy(solid("sphere(1)"), {0.3 * n, 0, 0}));
    const Shape block = solid("box(4,4,4)");
    Shape sum = balls.front(), rest = block, doubled = balls.front();
    std::vector<Shape> cutters{block};
    for (const Shape& ball : balls) {
        sum = sum | ball;
        rest = rest - ball;
        doubled = doubled | doubled;
        cutters.push_back(ball);
    }
    EXPECT_EQ(sum.plan(settings).size(), 1u + kBalls);
    EXPECT_EQ(rest.plan(settings).size(), 2u + kBalls);
    EXPECT_EQ((block - sum).plan(settings).size(), 2u + kBalls);
    EXPECT_EQ(doubled.plan(settings).size(), 2u);
    EXPECT_EQ((block - (block - sum)).plan(settings).size(), 4u + kBalls) << "no Boolean of one";
    const auto values = [&](const Shape& shape) {
        return test::treeBytes(evaluated(shape, settings).grid());
    };
    EXPECT_EQ(values(sum), values(Shape::combine(Boolean::Union, balls)));
    EXPECT_EQ(values(rest), values(Shape::combine(Boolean::Difference, cutters)));
    EXPECT_EQ(values(block - sum), values(rest));
    EXPECT_EQ(values(doubled), values(balls.front()));
    EXPECT_EQ(evaluated(rest - rest, settings).grid().activeVoxelCount(), 0u);
    // A blend is of two solids at a time.
    const Shape blended = Shape::combine(Boolean::Union, {balls[0] | balls[4], balls[8]}, 0.2);
    EXPECT_EQ(blended.plan(settings).size(), 5u);
}

TEST(Shape, WithoutEndNeedsAnIntersection)
{
    const Shape half(makeHalfSpace(Vec3d::Zero(), Vec3d(1, 1, 0)), "half-space");
    Interrupter progress;
    EXPECT_THROW(half.evaluate(voxels(0.1), &progress), UsageError);
    const auto settings = voxels(1.0 / 32);
    const LevelSet dome = evaluated(solid("sphere(1)") & half, settings);
    expectSound(dome);
    EXPECT_NEAR(volume(dome), 2.0 / 3 * M_PI, 10 * settings.voxelSize * settings.voxelSize);
    const LevelSet rest = evaluated(solid("sphere(1)") - half, settings);
    EXPECT_NEAR(volume(rest), 2.0 / 3 * M_PI, 10 * settings.voxelSize * settings.voxelSize);
    const Shape lattice = Shape(makeGyroid(0.8, 0.2), "gyroid") & solid("box(2,2,2)");
    expectSound(evaluated(lattice, voxels(1.0 / 24)));
}

TEST(Shape, MemoryIsRefusedBeforeItIsTaken)
{
    const auto field = counted("sphere(1)");
    auto settings = voxels(0.01);
    settings.maxBytes = 1 << 20;
    Interrupter progress;
    try {
        Shape(field, "ball").offset(0.1).evaluate(settings, &progress);
        FAIL() << "a megabyte cannot be enough";
    } catch (const LimitError& error) {
        EXPECT_NE(std::string(error.what()).find("voxels of size"), std::string::npos);
    }
    EXPECT_FALSE(field->sampled());
}

TEST(Shape, TheEstimateIsNearWhatIsTaken)
{
    for (const char* description :
         {"sphere(1)", "torus(1,0.3)", "box(2,1,0.5)", "gear(12,1,0.4)"}) {
        SCOPED_TRACE(description);
        const Shape shape = solid(description);
        for (const double halfWidth : {3.0, 10.0}) {
            const auto settings = voxels(1.0 / 48, halfWidth);
            const PlanStep step = shape.plan(settings).front();
            const LevelSet made = evaluated(shape, settings);
            EXPECT_NEAR(double(step.voxels) / double(made.grid().activeVoxelCount()), 1, 0.35);
            EXPECT_NEAR(double(step.bytes) / double(made.grid().memUsage()), 1, 0.35);
        }
    }
}

TEST(Shape, TheEstimateKnowsWhatOperationsDoToTheSurface)
{
    const Eigen::Affine3d larger(Eigen::Translation3d(20, 0, 0) * Eigen::Scaling(3.0));
    SmoothSettings smoothing;
    const Shape ball = solid("sphere(0.5)"), torus = solid("torus(1,0.3)");
    const std::pair<const char*, Shape> shapes[] = {
        {"offset", ball.offset(1)},
        {"offset of a box", solid("box(0.4,0.3,0.5)").offset(0.5)},
        {"inward shell", torus.shell(0.15, Wall::Inward)},
        {"outward shell", torus.shell(0.15, Wall::Outward)},
        {"moved filter", ball.smooth(smoothing).moved(larger)},
        {"scaled grid", Shape(evaluated(ball, voxels(0.01))).moved(larger)},
        {"morph", Shape::morph(ball, solid("box(0.9,0.9,0.9)"), 0.5, Morphing::Linear)},
    };
    for (const auto& [name, shape] : shapes) {
        SCOPED_TRACE(name);
        const auto settings = voxels(1.0 / 32);
        const double planned = double(shape.plan(settings).front().voxels);
        const double made = double(evaluated(shape, settings).grid().activeVoxelCount());
        EXPECT_NEAR(planned / made, 1, 0.35);
    }
}

TEST(Shape, TheSmallestVoxelsCanBePlanned)
{
    const LevelSet made =
        evaluated(solid("sphere(0.0005)") - solid("box(0.0005,0.0005,0.01)"), voxels(2e-5));
    expectSound(made);
}

TEST(Shape, SolidsThinnerThanVoxelsAreTold)
{
    const auto notes = [](const Shape& shape, double size) {
        Interrupter progress;
        shape.evaluate(voxels(size), &progress);
        return progress.notes();
    };
    const Shape block = solid("box(4,4,4)"), pin = solid("cylinder(0.1,8)");
    ASSERT_EQ(notes(block - pin, 0.2).size(), 1u) << "a hole of a voxel";
    EXPECT_NE(notes(block - pin, 0.2)[0].find("1 of 2 solids is thinner"), std::string::npos);
    EXPECT_NE(notes(block - pin, 0.2)[0].find("cylinder"), std::string::npos);
    EXPECT_TRUE(notes(block - pin, 0.1).empty()) << "of two voxels";
    EXPECT_TRUE(notes(block - movedBy(pin, {9, 0, 0}), 0.2).empty()) << "it cuts nothing";
    const Shape grid(evaluated(pin, voxels(0.1)));
    EXPECT_TRUE(notes(block - grid, 0.1).empty());
    EXPECT_EQ(notes(block - grid, 0.2).size(), 1u) << "resampled to larger voxels";
}

TEST(Shape, AMotionGoesToTheLeaves)
{
    Eigen::Affine3d motion = Eigen::Translation3d(0.3, -0.1, 0.2) *
                             Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()) *
                             Eigen::Scaling(1.5);
    const Shape part = (solid("box(1,1,1)") - solid("cylinder(0.3,2)")).offset(0.05);
    const auto settings = voxels(1.0 / 32);
    const LevelSet moved = evaluated(part.moved(motion), settings);
    expectSound(moved);
    const double scale = std::pow(1.5, 3);
    EXPECT_NEAR(volume(moved), scale * volume(evaluated(part, voxels(1.0 / 48))),
                20 * settings.voxelSize * settings.voxelSize);
    for (const PlanStep& step : part.moved(motion).plan(settings))
        EXPECT_EQ(step.what.find("transform"), std::string::npos) << "nothing is resampled";
}

// The bounds of a chain of warps grow with each: its result was empty, or said to have no end.
TEST(Shape, ThereAndBackManyTimesIsTheSame)
{
    const auto settings = voxels(0.1);
    const Shape ball = solid("sphere(1)");
    const double whole = volume(evaluated(ball, settings)), tolerance = 0.01 * whole;
    for (const int pairs : {1, 6, 30}) {
        Shape twisted = ball, stretched = ball;
        for (int n = 0; n < pairs; ++n) {
            twisted = twisted.warped(makeTwist(Axis{}, 0.09), "twist")
                          .warped(makeTwist(Axis{}, -0.09), "twist");
            stretched = stretched.moved(Eigen::Affine3d(Eigen::Scaling(10.0, 1.0, 1.0)))
                            .moved(Eigen::Affine3d(Eigen::Scaling(0.1, 1.0, 1.0)));
        }
        EXPECT_NEAR(volume(evaluated(twisted, settings)), whole, tolerance) << pairs;
        EXPECT_NEAR(volume(evaluated(stretched, settings)), whole, tolerance) << pairs;
    }
    // Twists with a turn between, each undone, are no one warp.
    Shape turned = ball;
    const Eigen::Affine3d turn(Eigen::AngleAxisd(0.3, Vec3d::UnitX()));
    for (int n = 0; n < 3; ++n) turned = turned.warped(makeTwist(Axis{}, 0.5), "twist").moved(turn);
    for (int n = 0; n < 3; ++n)
        turned = turned.moved(turn.inverse()).warped(makeTwist(Axis{}, -0.5), "twist");
    EXPECT_NEAR(volume(evaluated(turned, settings)), whole, tolerance);
}

TEST(Shape, ALevelSetKeepsItsLattice)
{
    Interrupter progress;
    SampleSettings sampling;
    sampling.lattice = {Vec3d(0.013, 0.002, -0.007), 0.05};
    const LevelSet ball =
        sampleField(*makeSolidField(parseSolid("sphere(1)")), sampling, &progress);
    const LevelSet same = evaluated(Shape(ball), voxels(0.05));
    EXPECT_TRUE(same.grid().tree().hasSameTopology(ball.grid().tree()));
    for (auto it = ball.grid().cbeginValueOn(); it; ++it)
        ASSERT_EQ(same.grid().tree().getValue(it.getCoord()), *it);
}

TEST(Shape, NothingStaysNothing)
{
    const Shape none = solid("sphere(1)") - solid("sphere(2)");
    const auto settings = voxels(0.1);
    for (const Shape& shape : {none, none.offset(0.1), none.shell(0.3, Wall::Centered), none & none,
                               none.smooth({}), movedBy(none, {1, 0, 0})}) {
        const LevelSet made = evaluated(shape, settings);
        EXPECT_EQ(made.grid().activeVoxelCount(), 0u);
        expectSound(made);
    }
    EXPECT_NEAR(volume(evaluated(none | solid("sphere(1)"), settings)), 4.0 / 3 * M_PI, 0.1);
}

/// A shape with its function, which has the right sign.
struct Example {
    Shape shape;
    std::function<double(const Vec3d&)> function;
};

class Examples
{
public:
    /// @param reach  largest coordinate of the leaves' centers: with much of it some lie apart.
    Examples(unsigned seed, double reach) : mRandom(seed), mReach(reach) {}

    /// An expression with so many leaves, or fewer with some of those made before it in it again.
    Example make(int nodes)
    {
        const bool isShared = !mMade.empty() && uniform(0, 4) < 1;
        if (isShared) return mMade[std::size_t(uniform(0, double(mMade.size())))];
        mMade.push_back(nodes <= 1 ? leaf() : combined(nodes));
        return mMade.back();
    }

    double uniform(double low, double high)
    {
        return low + (high - low) * double(mRandom()) / 4294967296.0;
    }

    Vec3d place(double reach)
    {
        const double x = uniform(-reach, reach), y = uniform(-reach, reach);
        return {x, y, uniform(-reach, reach)};
    }

private:
    Example combined(int nodes)
    {
        const int left = 1 + int(uniform(0, nodes - 1));
        const Example a = make(left), b = make(nodes - left);
        const auto f = a.function, g = b.function;
        switch (int(uniform(0, 4))) {
        case 0:
            return {a.shape | b.shape, [f, g](const Vec3d& p) { return std::min(f(p), g(p)); }};
        case 1:
            return {a.shape - b.shape, [f, g](const Vec3d& p) { return std::max(f(p), -g(p)); }};
        case 2:
            return {(a.shape - b.shape) | (b.shape - a.shape), [f, g](const Vec3d& p) {
                        return std::max(std::min(f(p), g(p)), -std::max(f(p), g(p)));
                    }};
        default:
            return {a.shape & b.shape, [f, g](const Vec3d& p) { return std::max(f(p), g(p)); }};
        }
    }

    Example leaf()
    {
        static const char* const kSolids[] = {"sphere(0.7)", "box(1,0.8,1.2)", "torus(0.6,0.25)",
                                              "capsule(0.3,0.9)", "cylinder(0.5,1)"};
        const auto solid = parseSolid(kSolids[std::size_t(uniform(0, 5))]);
        const Eigen::Affine3d motion = Eigen::Translation3d(place(mReach)) *
                                       Eigen::AngleAxisd(uniform(0, 3), place(1).normalized());
        const Eigen::Affine3d back = motion.inverse();
        return {Shape(makeSolidField(solid), "leaf").moved(motion),
                [solid, back](const Vec3d& p) { return solid->distance(back * p); }};
    }

    std::mt19937 mRandom;
    double mReach;
    std::vector<Example> mMade;
};

/// As xor is made: each operand is there twice, and asks for nothing of the other.
TEST(Shape, SolidsThatLieApartStayWhereTheyAreShared)
{
    const Shape a = solid("box(1,1,1)"), b = movedBy(solid("box(1,1,1)"), {2, 0, 0}), c = a - b;
    const ShapeSettings settings = voxels(0.05);
    const double one = volume(evaluated(a, settings));
    EXPECT_NEAR(volume(evaluated(c | (b - a), settings)), 2 * one, 1e-3);
    EXPECT_NEAR(volume(evaluated(a | (b - a), settings)), 2 * one, 1e-3);
    EXPECT_NEAR(volume(evaluated((c | (c | b)) - c, settings)), one, 1e-3);
}

TEST(Shape, RandomProgramsAgreeWithTheirFunctions)
{
    const unsigned seed = 20261121;
    std::printf("seed %u\n", seed);
    const double h = 0.05;
    for (int n = 0; n < 48; ++n) {
        const double reach = n % 2 == 0 ? 0.5 : 1.5;
        Examples examples(seed + unsigned(n), reach);
        const Example example = examples.make(2 + n % 14);
        const LevelSet made = evaluated(example.shape, voxels(h));
        SCOPED_TRACE(fmt::format("program {}\n{}", n, example.shape.explain(voxels(h))));
        expectSound(made);
        int judged = 0;
        for (int k = 0; k < 2000; ++k) {
            const Vec3d p = examples.place(0.7 + reach);
            const double exact = example.function(p);
            // Within a cell's diagonal of the surface the nearest voxel may lie on its other side.
            if (std::abs(exact) < std::sqrt(3.0) * h) continue;
            const auto at = openvdb::Coord::round(
                made.grid().worldToIndex(openvdb::Vec3d(p.x(), p.y(), p.z())));
            ASSERT_EQ(made.grid().tree().getValue(at) < 0, exact < 0) << p.transpose();
            ++judged;
        }
        EXPECT_GT(judged, 1000);
    }
}

TEST(Shape, PlannedBandsAreWideEnough)
{
    const double h = 0.04;
    const Shape ball = solid("sphere(0.8)"), box = movedBy(solid("box(1,1,1)"), {0.6, 0.2, 0});
    const Shape blended = Shape::combine(Boolean::Union, {ball, box}, 0.15);
    const Shape drilled =
        Shape::combine(Boolean::Difference, {blended, solid("cylinder(0.3,3)")}, 0.1);
    for (const Shape& shape :
         {blended, drilled, drilled.offset(0.1), drilled.offset(-0.07),
          blended.warped(makeTwist(Axis{}, 0.8), "twist"), drilled.shell(0.16, Wall::Inward)}) {
        SCOPED_TRACE(shape.explain(voxels(h)));
        const LevelSet planned = evaluated(shape, voxels(h)),
                       wide = evaluated(shape, voxels(h, 12));
        expectSound(planned);
        std::uint64_t off = 0;
        double largest = 0; // voxels
        for (auto it = planned.grid().cbeginValueOn(); it; ++it) {
            const double error =
                std::abs(double(*it - wide.grid().tree().getValue(it.getCoord()))) / h;
            off += error > 0.01;
            largest = std::max(largest, error);
        }
        // Where creases end in others, what is restored depends on what is near.
        EXPECT_LE(double(off), 2e-3 * double(planned.grid().activeVoxelCount()));
        EXPECT_LE(largest, 1);
        RecordProperty("off", std::to_string(off) + " by " + std::to_string(largest));
    }
}

TEST(Shape, PlannedBandsOfSharpSolidsEqualWideOnes)
{
    const double h = 0.04;
    const Shape bored = solid("box(1,1,1)") - solid("cylinder(0.3,3)"),
                turned = solid("rotate(box(1.6,1.2,1.4),1,2,3,40)");
    for (const Shape& shape :
         {bored.offset(0.1), bored.offset(-0.07), turned.offset(0.1), turned.offset(-0.1),
          bored.warped(makeTwist(Axis{}, 0.8), "twist")}) {
        SCOPED_TRACE(shape.explain(voxels(h)));
        const LevelSet planned = evaluated(shape, voxels(h)),
                       wide = evaluated(shape, voxels(h, 12));
        for (auto it = planned.grid().cbeginValueOn(); it; ++it)
            ASSERT_NEAR(*it, wide.grid().tree().getValue(it.getCoord()), 0.01 * h) << it.getCoord();
    }
}

TEST(Shape, OffsetsGoFartherThanAnyBand)
{
    const LevelSet grown = evaluated(solid("sphere(0.1)").offset(0.6), voxels(0.02));
    expectSound(grown);
    EXPECT_NEAR(volume(grown), 4.0 / 3 * M_PI * std::pow(0.7, 3), 0.01);
}

TEST(Shape, OneThreadOrTwoGiveTheSameBits)
{
    const Shape part = Shape::combine(
        Boolean::Difference,
        {solid("box(1,1,1)").offset(0.1), solid("cylinder(0.3,3)"), solid("torus(0.6,0.1)")}, 0.05);
    const LevelSet two = evaluated(part, voxels(0.04));
    std::optional<LevelSet> one;
    tbb::task_arena(1).execute([&] { one = evaluated(part, voxels(0.04)); });
    ASSERT_TRUE(one->grid().tree().hasSameTopology(two.grid().tree()));
    for (auto it = two.grid().cbeginValueOn(); it; ++it)
        ASSERT_EQ(one->grid().tree().getValue(it.getCoord()), *it);
}

} // namespace
} // namespace mpuvdb
