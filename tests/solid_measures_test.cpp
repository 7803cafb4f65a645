// Measures of solids beside exact ones and OpenVDB's.
#include "case_files.h"
#include "solid_level_set.h"

#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>

#include <fmt/format.h>
#include <openvdb/tools/LevelSetMeasure.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iostream>

namespace mpuvdb::test
{
namespace
{

struct Errors {
    double volume = 0, area = 0; ///< relative
};

Errors errorsOf(const SolidMeasures& m, double volume, double area)
{
    return {std::abs(m.volume / volume - 1), std::abs(m.area / area - 1)};
}

Errors errorsOfOpenVdb(const LevelSet& levelSet, double volume, double area)
{
    openvdb::tools::LevelSetMeasure<openvdb::FloatGrid> other(levelSet.grid());
    return {std::abs(other.volume() / volume - 1), std::abs(other.area() / area - 1)};
}

/// Surface of an ellipsoid of revolution with radii a, a, c < a.
double oblateArea(double a, double c)
{
    const double e = std::sqrt(1 - c * c / (a * a));
    return 2 * M_PI * a * a * (1 + (1 - e * e) / e * std::atanh(e));
}

struct KnownShape {
    std::string solid;
    double volume, area;
    int handles;
    double edges; ///< length of its sharp edges
};

const KnownShape kShapes[] = {
    {"translate(sphere(1),0.013,0.027,0.011)", 4 * M_PI / 3, 4 * M_PI, 0, 0},
    {"torus(1,0.4)", 2 * M_PI* M_PI * 0.16, 4 * M_PI* M_PI * 0.4, 1, 0},
    {"capsule(0.5,1)", M_PI * 0.25 + M_PI / 6, M_PI + M_PI, 0, 0},
    {"ellipsoid(1,1,0.6)", 4 * M_PI / 3 * 0.6, oblateArea(1, 0.6), 0, 0},
    {"translate(box(1.6,1.4,1.2),0.013,0.027,0.011)", 1.6 * 1.4 * 1.2,
     2 * (1.6 * 1.4 + 1.4 * 1.2 + 1.2 * 1.6), 0, 4 * (1.6 + 1.4 + 1.2)},
};

TEST(Measure, ConvergesAndIsAtLeastAsExactAsOpenVdb)
{
    for (const KnownShape& shape : kShapes) {
        SCOPED_TRACE(shape.solid);
        Errors before{1, 1};
        for (const double h : {0.1, 0.05, 0.025}) {
            const LevelSet solid = solidLevelSet(shape.solid, h);
            const Errors ours = errorsOf(measured(solid), shape.volume, shape.area),
                         theirs = errorsOfOpenVdb(solid, shape.volume, shape.area);
            std::cout << shape.solid << " h " << h << ": volume " << ours.volume << " (OpenVDB "
                      << theirs.volume << "), area " << ours.area << " (OpenVDB " << theirs.area
                      << ")\n";
            EXPECT_LE(ours.volume, std::max(theirs.volume, 2e-5));
            EXPECT_LE(ours.area, std::max(theirs.area, 2e-5));
            // An order of two at least, until rounding shows. But where a sharp edge leaves a cell
            // a corner is cut off it, of up to half the cell's face, which tapers off to the middle
            // of the cell: a pyramid's volume, and the area of its sides without its base's.
            const double cutVolume = h * h / 6 * shape.edges / shape.volume,
                         cutArea = (2 - std::sqrt(2)) * h / 2 * shape.edges / shape.area;
            EXPECT_LE(ours.volume, std::max(before.volume / 3, 2e-5) + cutVolume);
            EXPECT_LE(ours.area, std::max(before.area / 3, 2e-5) + cutArea);
            before = ours;
        }
    }
}

TEST(Measure, NeedsNoWideBand)
{
    for (const KnownShape& shape : kShapes) {
        SCOPED_TRACE(shape.solid);
        const SolidMeasures wide = measured(solidLevelSet(shape.solid, 0.05, 5));
        for (const double halfWidth : {1.5, 2.0, 3.0}) {
            const SolidMeasures m = measured(solidLevelSet(shape.solid, 0.05, halfWidth));
            EXPECT_NEAR(m.volume, wide.volume, 0.002 * wide.volume) << halfWidth;
            EXPECT_NEAR(m.area, wide.area, 0.01 * wide.area) << halfWidth;
            EXPECT_EQ(m.eulerCharacteristic, wide.eulerCharacteristic) << halfWidth;
            EXPECT_EQ(m.surfaces, wide.surfaces) << halfWidth;
        }
    }
}

TEST(Measure, CountsSurfacesAndHandles)
{
    for (const KnownShape& shape : kShapes) {
        const SolidMeasures m = measured(solidLevelSet(shape.solid, 0.05));
        EXPECT_EQ(m.surfaces, 1u) << shape.solid;
        EXPECT_EQ(m.eulerCharacteristic, 2 - 2 * shape.handles) << shape.solid;
        EXPECT_EQ(m.genus, shape.handles) << shape.solid;
    }
    const SolidMeasures several = measured(solidLevelSet(
        "union(difference(sphere(1),sphere(0.5)),translate(torus(0.6,0.2),0,0,2))", 0.05));
    EXPECT_EQ(several.surfaces, 3u);
    EXPECT_EQ(several.genus, 1);
    EXPECT_EQ(several.eulerCharacteristic, 4);
}

/// The counts of thin walls that are turned, and of random signs, are those of the mesh.
TEST(Measure, CountsWhatTheMeshShows)
{
    Random random(11);
    Interrupter progress;
    const auto expectAsMesh = [&](const LevelSet& levelSet) {
        const SolidMeasures m = measured(levelSet);
        const MeshReport mesh = measure(extractMesh(levelSet, {}, &progress));
        EXPECT_EQ(std::int64_t(m.eulerCharacteristic), mesh.eulerCharacteristic);
        EXPECT_EQ(m.surfaces, mesh.components);
        return m;
    };
    for (const double thick : {0.8, 1.0, 1.2, 1.5})
        for (int n = 0; n < 3; ++n) {
            const Vec3d axis = random.direction();
            const SolidMeasures m = expectAsMesh(
                solidLevelSet(fmt::format("rotate(box(2,2,{}),{},{},{},{})", 0.1 * thick, axis.x(),
                                          axis.y(), axis.z(), random.uniform(10, 80)),
                              0.1));
            // Crossings are on planes, beside the other side too; the rim's edges are cut.
            if (thick >= 1) {
                EXPECT_NEAR(m.volume / (0.4 * thick), 1, 0.04) << thick;
            }
        }
    expectAsMesh(randomLevelSet(20, random));
}

TEST(Measure, BoundsTheZeroSet)
{
    const double h = 0.05;
    const SolidMeasures m = measured(solidLevelSet("translate(sphere(1),0.313,-0.127,5.02)", h));
    const Vec3d center(0.313, -0.127, 5.02);
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(m.bounds.min()[axis], center[axis] - 1, 0.02 * h);
        EXPECT_NEAR(m.bounds.max()[axis], center[axis] + 1, 0.02 * h);
    }
}

TEST(Measure, ThicknessIsThatOfTheLargestBalls)
{
    const struct {
        const char* solid;
        double least;
        double mean; ///< negative: not known in closed form
        double tolerance;
    } cases[] = {
        {"slab(4,4,0.2)", 0.2, -1, 1e-4},
        {"slab(4,4,0.17)", 0.17, -1, 1e-3},
        {"rotate(slab(3,3,0.3),1,2,3,40)", 0.3, -1, 1e-3},
        {"translate(sphere(1),0.01,0.02,0)", 2, 2, 2e-3},
        {"capsule(0.4,2)", 0.8, 0.8, 2e-3},
        {"torus(1,0.4)", 0.8, 0.8, 2e-3},
        {"difference(sphere(1),sphere(0.7))", 0.3, -1, 2e-3},
    };
    for (const auto& c : cases) {
        SCOPED_TRACE(c.solid);
        const SolidMeasures m = measured(solidLevelSet(c.solid, 0.05));
        std::cout << c.solid << ": least " << m.minThickness << ", mean " << m.meanThickness
                  << '\n';
        EXPECT_NEAR(m.minThickness, c.least, c.tolerance + 0.01 * c.least);
        if (c.mean > 0) {
            EXPECT_NEAR(m.meanThickness, c.mean, 0.01 * c.mean);
        }
    }
}

/// A convex solid of flat quadrangles about the unit sphere.
Mesh facettedBall(int rings, int sides)
{
    Mesh mesh;
    const auto put = [&](double polar, double turn) {
        mesh.positions.emplace_back(float(std::sin(polar) * std::cos(turn)),
                                    float(std::sin(polar) * std::sin(turn)),
                                    float(std::cos(polar)));
    };
    put(0, 0);
    for (int i = 1; i < rings; ++i)
        for (int j = 0; j < sides; ++j) put(M_PI * i / rings, 2 * M_PI * j / sides);
    put(M_PI, 0);
    const auto at = [&](int i, int j) {
        return i == 0       ? 0u
               : i == rings ? std::uint32_t(mesh.positions.size() - 1)
                            : std::uint32_t(1 + (i - 1) * sides + j % sides);
    };
    for (int i = 0; i < rings; ++i)
        for (int j = 0; j < sides; ++j) {
            if (i > 0) mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
            if (i + 1 < rings)
                mesh.triangles.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
        }
    return mesh;
}

LevelSet meshLevelSet(const Mesh& mesh, double voxelSize)
{
    SampleSettings settings;
    settings.lattice = {Vec3d::Zero(), voxelSize};
    Interrupter progress;
    return voxelize(mesh, settings, &progress);
}

/// Processor time of measure() per active voxel, the least of two, nanoseconds.
double costOf(const LevelSet& solid)
{
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 1);
    double least = 1e9;
    for (int n = 0; n < 2; ++n) {
        const std::clock_t begin = std::clock();
        measured(solid);
        least = std::min(least, double(std::clock() - begin) / CLOCKS_PER_SEC);
    }
    return 1e9 * least / double(solid.grid().activeVoxelCount());
}

/// Four times as many voxels, and each at the same price: by searches that visit all places that
/// are about equally near, it was four times as high.
void expectLinear(const std::function<LevelSet(double)>& make)
{
    const double coarse = costOf(make(0.06)), fine = costOf(make(0.03));
    std::cout << coarse << " ns a voxel, at half the size " << fine << '\n';
    EXPECT_LT(fine, 1.6 * coarse);
}

TEST(Measure, TakesTimeInProportionToTheBand)
{
    const Mesh ball = facettedBall(24, 48);
    expectLinear([&](double h) { return meshLevelSet(ball, h); });
    expectLinear([](double h) { return solidLevelSet("difference(sphere(1),sphere(0.7))", h); });
}

TEST(Measure, OfAFacettedBallTakesTimeInProportionToTheBand)
{
    MPUVDB_CASE(file, "T28-facetted-ball.obj");
    Interrupter progress;
    const Mesh ball = readMesh(file, &progress);
    expectLinear([&](double h) { return meshLevelSet(ball, h); });
}

TEST(Measure, OfNothingIsZero)
{
    const SolidMeasures m = measured(emptyLevelSet(0.1));
    EXPECT_EQ(m.volume, 0);
    EXPECT_EQ(m.area, 0);
    EXPECT_TRUE(m.bounds.isEmpty());
    EXPECT_EQ(m.eulerCharacteristic, 0);
    EXPECT_EQ(m.surfaces, 0u);
    EXPECT_EQ(m.genus, 0);
    EXPECT_EQ(m.minThickness, 0);
    EXPECT_EQ(m.meanThickness, 0);
}

TEST(Measure, IsTheSameForAnyNumberOfThreads)
{
    for (const LevelSet& solid :
         {solidLevelSet("torus(1,0.4)", 0.05), meshLevelSet(facettedBall(24, 48), 0.05)}) {
        const auto with = [&](std::size_t threads) {
            const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                              threads);
            return measured(solid);
        };
        const SolidMeasures one = with(1), two = with(2);
        EXPECT_EQ(one.volume, two.volume);
        EXPECT_EQ(one.area, two.area);
        EXPECT_EQ(one.minThickness, two.minThickness);
        EXPECT_EQ(one.meanThickness, two.meanThickness);
    }
}

TEST(Measure, CanBeStopped)
{
    const LevelSet solid = solidLevelSet("sphere(1)", 0.01);
    expectStops([&](Interrupter& progress) {
        for (;;) measure(solid, &progress);
    });
}

} // namespace
} // namespace mpuvdb::test
