// Particles to level sets: balls, sheets and pools whose measures are known; files; bad input.
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/particles.h>

#include <gtest/gtest.h>
#include <openvdb/points/PointConversion.h>
#include <tbb/global_control.h>

#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

namespace mpuvdb
{
namespace
{

/// Radius of a ball of unit volume.
const double kUnitBall = std::cbrt(3 / (4 * M_PI));

Length world(double length)
{
    return {length, Length::Unit::World};
}

/// Centers a unit apart, off their places by up to @a jitter along each axis.
std::vector<Vec3d> box(int nx, int ny, int nz, double jitter, unsigned seed = 1)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> off(-jitter, jitter);
    std::vector<Vec3d> centers;
    for (int x = 0; x < nx; ++x)
        for (int y = 0; y < ny; ++y)
            for (int z = 0; z < nz; ++z)
                centers.push_back(Vec3d(x + 0.5, y + 0.5, z + 0.5) +
                                  Vec3d(off(random), off(random), off(random)));
    return centers;
}

Particles particlesAt(const std::vector<Vec3d>& centers)
{
    return importParticles({NumberView(centers), {}, {}, {}, {}});
}

ParticleResult surfaceOf(const std::vector<Vec3d>& centers, double radius, double voxelSize,
                         ParticleSurface surface = ParticleSurface::Smooth)
{
    ParticleOptions options;
    options.surface = surface;
    options.radius = world(radius);
    options.voxelSize = world(voxelSize);
    return particlesToLevelSet(particlesAt(centers), options);
}

/// Call visit(world position, value) for all active voxels.
template <class F>
void forEachVoxel(const openvdb::FloatGrid& grid, F&& visit)
{
    for (auto voxel = grid.cbeginValueOn(); voxel; ++voxel) {
        const openvdb::Vec3d p = grid.indexToWorld(voxel.getCoord());
        visit(Vec3d(p.x(), p.y(), p.z()), double(*voxel));
    }
}

void expectSound(const ParticleResult& made)
{
    const CheckReport report = check(*made.grid);
    for (const CheckFinding& finding : report.findings) ADD_FAILURE() << finding.what;
    EXPECT_EQ(made.grid->getName(), "surface");
}

TEST(Particles, ALoneParticleIsItsBall)
{
    const Vec3d center(1.3, -0.7, 20.1);
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres})
        for (const double voxels : {2.0, 4.0, 9.3}) {
            SCOPED_TRACE(voxels);
            const double r = 0.37, h = r / voxels;
            const ParticleResult made = surfaceOf({center}, r, h, surface);
            expectSound(made);
            double worst = 0;
            forEachVoxel(*made.grid, [&](const Vec3d& p, double value) {
                const double distance = (p - center).norm() - r;
                // The center is a medial axis, about which no gradient says where the surface is.
                if (distance > 1.5 * h - r) worst = std::max(worst, std::abs(value - distance));
            });
            EXPECT_LT(worst, h * h / r); // the sag of a ball's cap that is two diagonals wide
        }
}

/// Without radii a ball has the volume of a cube that is as wide as particles are apart, whether
/// they fill a solid, a layer or a row.
TEST(Particles, SpacingIsThatOfSolidsLayersAndRows)
{
    const double apart = 0.3;
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> shift(-0.1, 0.1); // spacings
    for (const auto& [x, y, z] :
         {std::array{14, 14, 14}, std::array{30, 30, 1}, std::array{30, 30, 2}, {100, 1, 1}}) {
        std::vector<Vec3d> centers;
        for (int n = 0; n < x * y * z; ++n)
            centers.push_back(apart * Vec3d(n % x + shift(random), n / x % y + shift(random),
                                            n / x / y + shift(random)));
        ParticleOptions options;
        options.voxelSize = world(0.1);
        const ParticleReport report = particlesToLevelSet(particlesAt(centers), options).report;
        ASSERT_TRUE(report.spacing);
        EXPECT_NEAR(*report.spacing / apart, 1, 0.2) << x << ' ' << y << ' ' << z;
    }
}

/// Balls that no voxel meets are told of: as a finding where they are more than a hundredth.
TEST(Particles, BallsThatVoxelsPassByAreToldOf)
{
    for (const int small : {0, 1, 40}) {
        std::vector<Vec3d> centers;
        for (int n = 0; n < 150; ++n) centers.push_back(4 * Vec3d(n % 5, n / 5 % 5, n / 25));
        for (int n = 0; n < small; ++n) centers.push_back(Vec3d(2.21 + 0.4 * n, -6.13, 1.17));
        Particles particles = particlesAt(centers);
        particles.radii.assign(150, 1);
        particles.radii.resize(centers.size(), 0.05f);
        const ParticleReport report = particlesToLevelSet(std::move(particles)).report;
        EXPECT_EQ(report.lost, std::uint64_t(small));
        EXPECT_EQ(report.findings.size(), small == 40 ? 1u : 0u);
        EXPECT_EQ(report.warnings.size(), small == 1 ? 1u : 0u);
    }
}

TEST(Particles, JoinWhereTheyAreLessThanThreeRadiiApart)
{
    const double r = 1, ball = 4 * M_PI / 3;
    for (const double apart : {1.5, 2.0, 2.4, 2.9, 3.2, 4.0}) {
        SCOPED_TRACE(apart);
        const SolidMeasures pair =
            measure(surfaceOf({Vec3d::Zero(), Vec3d(apart, 0.1, 0)}, r, 0.1).levelSet());
        EXPECT_EQ(pair.surfaces, apart < 3.06 ? 1u : 2u);
        EXPECT_EQ(pair.genus, 0);
        // Joined, at most a third more; apart, what the other's kernel adds at its end.
        EXPECT_LT(pair.volume, (apart < 3.06 ? 1.37 : 1.03) * 2 * ball);
    }
}

TEST(Particles, SpheresAreTheirUnion)
{
    const double r = 1, h = 0.1, apart = 1.4, half = apart / 2;
    const ParticleResult made =
        surfaceOf({Vec3d::Zero(), Vec3d(apart, 0, 0)}, r, h, ParticleSurface::Spheres);
    expectSound(made);
    const double circle = std::sqrt(r * r - half * half);
    double worst = 0;
    forEachVoxel(*made.grid, [&](const Vec3d& p, double value) {
        const double a = p.norm() - r, b = (p - Vec3d(apart, 0, 0)).norm() - r;
        double distance = std::min(a, b);
        // Feet on a sphere within the other ball are not on the union: the circle is nearest.
        const double foot =
            p.x() < half ? p.x() / p.norm() * r : apart - (apart - p.x()) / (b + r) * r;
        if (distance < 0 && (p.x() < half ? foot > half : foot < half))
            distance = -std::hypot(p.x() - half, std::hypot(p.y(), p.z()) - circle);
        worst = std::max(worst, std::abs(value - distance));
    });
    EXPECT_LT(worst, 0.5 * h);
}

TEST(Particles, APoolHasItsParticlesVolume)
{
    // Radii of unit balls, of balls that touch, and that overlap by half.
    for (const double radius : {kUnitBall, 0.5, 0.8}) {
        SCOPED_TRACE(radius);
        const std::vector<Vec3d> centers = box(24, 24, 12, 0.25);
        const ParticleResult made = surfaceOf(centers, radius, 0.3);
        expectSound(made);
        const SolidMeasures solid = measure(made.levelSet());
        EXPECT_EQ(solid.surfaces, 1u);
        EXPECT_EQ(solid.genus, 0);
        // Other radii than those of unit balls move the surface by up to an eighth of the spacing.
        const double shift = radius == kUnitBall ? 0.06 : 0.125;
        EXPECT_NEAR(solid.volume / double(centers.size()), 1,
                    shift * solid.area / double(centers.size()));
    }
}

TEST(Particles, AMovingPoolKeepsItsVolume)
{
    const std::vector<Vec3d> rest = box(18, 18, 12, 0.25);
    const Vec3d middle(9, 9, 6);
    for (int frame = 0; frame < 24; ++frame) {
        // Turned, moved, and sheared: each of which keeps volumes.
        const double time = frame / 24.0;
        const Eigen::Matrix3d turn =
            Eigen::AngleAxisd(1.1 * time, Vec3d(0.3, 0.2, 1).normalized()).toRotationMatrix();
        std::vector<Vec3d> centers;
        for (const Vec3d& p : rest) {
            Vec3d q = p - middle;
            q.z() += 2 * time * std::sin(0.3 * q.x()) * std::cos(0.3 * q.y());
            centers.push_back(turn * q + Vec3d(3.3 * time, 0, -1.7 * time));
        }
        const SolidMeasures solid =
            measure(surfaceOf(centers, kUnitBall, kUnitBall / 2).levelSet());
        EXPECT_NEAR(solid.volume / double(rest.size()), 1, 0.02) << "frame " << frame;
    }
}

TEST(Particles, SheetsAndThreadsAreWhole)
{
    for (const unsigned seed : {1u, 2u})
        for (const double radius : {kUnitBall, 0.5}) {
            SCOPED_TRACE(std::to_string(seed) + ", radius " + std::to_string(radius));
            const SolidMeasures sheet =
                measure(surfaceOf(box(30, 30, 2, 0.15, seed), radius, 0.25).levelSet());
            EXPECT_EQ(sheet.eulerCharacteristic, 2);
            EXPECT_EQ(sheet.surfaces, 1u);
            // A surface that lies off by up to 0.15 spacings.
            EXPECT_NEAR(sheet.volume, 30 * 30 * 2, 0.15 * sheet.area);
        }
    const SolidMeasures single =
        measure(surfaceOf(box(30, 30, 1, 0.1), kUnitBall, 0.25).levelSet());
    EXPECT_EQ(single.eulerCharacteristic, 2);
    const SolidMeasures thread = measure(surfaceOf(box(40, 1, 1, 0.1), kUnitBall, 0.25).levelSet());
    EXPECT_EQ(thread.eulerCharacteristic, 2);
    EXPECT_EQ(thread.surfaces, 1u);
}

TEST(Particles, VoxelCentersAreTheirSolid)
{
    // Without a radius: the spacing is measured.
    std::vector<Vec3d> centers;
    const double spacing = 0.1, r = 1;
    for (double x = -1; x <= 1; x += spacing)
        for (double y = -1; y <= 1; y += spacing)
            for (double z = -1; z <= 1; z += spacing)
                if (Vec3d(x, y, z).norm() < r) centers.push_back({x, y, z});
    const ParticleResult made =
        particlesToLevelSet(importParticles({NumberView(centers), {}, {}, {}, {}}));
    expectSound(made);
    ASSERT_TRUE(made.report.spacing);
    EXPECT_NEAR(*made.report.spacing, spacing, 0.02 * spacing);
    const SolidMeasures solid = measure(made.levelSet());
    EXPECT_EQ(solid.surfaces, 1u);
    // Where the surface runs across the grid, layers are dense, and it lies farther out.
    EXPECT_NEAR(solid.volume, double(centers.size()) * std::pow(spacing, 3),
                0.15 * spacing * solid.area);
}

TEST(Particles, RadiiOfAllSizesTogether)
{
    const std::vector<Vec3d> centers = {{0, 0, 0}, {4, 0, 0}, {0, 5, 0}, {3, 3, 3}};
    const std::vector<float> radii = {1.0f, 0.05f, 0.3f, 0.1f};
    ParticleView view;
    view.positions = centers;
    view.radii = radii;
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres}) {
        ParticleOptions options;
        options.surface = surface;
        options.voxelSize = world(0.02);
        const ParticleResult made = particlesToLevelSet(importParticles(view), options);
        expectSound(made);
        const SolidComponents parts(made.levelSet());
        ASSERT_EQ(parts.measures().size(), 4u);
        std::size_t n = 0;
        for (const double r : {1.0, 0.3, 0.1, 0.05}) {
            const double volume = parts.measures()[n++].volume;
            // Half a thousandth of a voxel's slope away from a ball of so few voxels.
            EXPECT_NEAR(std::cbrt(volume / (4 * M_PI / 3)), r, 0.1 * 0.02);
        }
        EXPECT_EQ(made.report.smallestRadius, double(0.05f));
        EXPECT_EQ(made.report.largestRadius, 1.0);
    }
}

TEST(Particles, SmallOnesInALargeOneLeaveItsBall)
{
    // Radii a tenth to a half of the ball's in which they lie, and one far away, of a radius
    // between.
    std::mt19937 random(5);
    std::uniform_real_distribution<double> along(-1, 1);
    for (const float small : {0.1f, 0.3f, 0.5f}) {
        std::vector<Vec3d> centers = {{0, 0, 0}, {9, 0, 0}};
        std::vector<float> radii = {1, 0.4f};
        while (centers.size() < 102) {
            const Vec3d p(along(random), along(random), along(random));
            if (p.norm() > 1 - double(small)) continue;
            centers.push_back(p);
            radii.push_back(small);
        }
        ParticleView view;
        view.positions = centers;
        view.radii = radii;
        ParticleOptions options;
        options.voxelSize = world(0.05);
        const SolidComponents parts(particlesToLevelSet(importParticles(view), options).levelSet());
        ASSERT_EQ(parts.measures().size(), 2u);
        const double ball = 4 * M_PI / 3, volume = parts.measures().front().volume;
        EXPECT_GT(volume, 0.998 * ball) << small;
        EXPECT_LT(volume, 1.06 * ball) << small;
    }
}

TEST(Particles, FarFromTheOriginIsAsNearIt)
{
    std::vector<Vec3d> centers = box(6, 6, 6, 0.2);
    const double volume = measure(surfaceOf(centers, kUnitBall, 0.25).levelSet()).volume;
    for (Vec3d& p : centers) p += Vec3d(2.5e6, -1e6, 250);
    const ParticleResult made = surfaceOf(centers, kUnitBall, 0.25);
    expectSound(made);
    EXPECT_NEAR(measure(made.levelSet()).volume, volume, 1e-3 * volume);
}

/// A pool whose particles turn about an axis.
Particles turning(const std::vector<Vec3d>& centers)
{
    std::vector<Vec3d> velocities;
    std::vector<float> heights;
    std::vector<Rgb> colors;
    for (const Vec3d& p : centers) {
        velocities.push_back(Vec3d(-p.y(), p.x(), 2));
        heights.push_back(float(p.z()));
        colors.push_back({200, 100, 50});
    }
    ParticleView view;
    view.positions = centers;
    view.velocities = velocities;
    view.colors = colors;
    view.scalars = {{"height", heights}};
    return importParticles(view);
}

TEST(Particles, CarryVelocitiesColorsAndScalars)
{
    ParticleOptions options;
    options.radius = world(kUnitBall);
    const ParticleResult made = particlesToLevelSet(turning(box(8, 8, 6, 0.2)), options);
    ASSERT_EQ(made.beside.size(), 3u);
    const auto v = openvdb::gridPtrCast<openvdb::Vec3SGrid>(made.beside[0]);
    ASSERT_TRUE(v);
    EXPECT_EQ(v->getName(), kVelocityName);
    EXPECT_EQ(v->getVectorType(), openvdb::VEC_CONTRAVARIANT_RELATIVE);
    EXPECT_EQ(v->activeVoxelCount(), made.grid->activeVoxelCount());
    const double band = made.report.voxelSize * made.report.halfWidth;
    for (auto voxel = v->cbeginValueOn(); voxel; ++voxel) {
        const openvdb::Vec3d p = v->indexToWorld(voxel.getCoord()), got(*voxel);
        // The nearest place is as far as the band is wide; means reach as far as a kernel.
        const double reach = band + 2.95 * kUnitBall;
        EXPECT_NEAR(got.x(), -p.y(), reach);
        EXPECT_NEAR(got.y(), p.x(), reach);
        EXPECT_NEAR(got.z(), 2, 1e-5);
    }
    EXPECT_EQ(made.beside[1]->getName(), "Cd");
    const auto colors = openvdb::gridPtrCast<openvdb::Vec3SGrid>(made.beside[1]);
    const Vec3f linear = linearColor({200, 100, 50});
    for (auto voxel = colors->cbeginValueOn(); voxel; ++voxel)
        EXPECT_NEAR((*voxel)[0], linear.x(), 1e-5);
    EXPECT_EQ(made.beside[2]->getName(), "height");
    options.velocity = false;
    EXPECT_EQ(particlesToLevelSet(turning(box(4, 4, 4, 0.2)), options).beside.size(), 2u);
}

TEST(Particles, SeparateDropsKeepWhatTheyCarry)
{
    // Drops whose radii differ, farther apart than the smaller one is wide.
    const std::vector<Vec3d> centers = {{0, 0, 0}, {2, 0, 0}}, velocities = {{0, 0, 0}, {10, 0, 0}};
    const std::vector<float> radii = {0.2f, 0.8f};
    ParticleView view;
    view.positions = centers;
    view.radii = radii;
    view.velocities = velocities;
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres}) {
        ParticleOptions options;
        options.surface = surface;
        options.voxelSize = world(0.05);
        const ParticleResult made = particlesToLevelSet(importParticles(view), options);
        const auto v = openvdb::gridPtrCast<openvdb::Vec3SGrid>(made.beside.at(0));
        for (auto voxel = v->cbeginValueOn(); voxel; ++voxel) {
            const openvdb::Vec3d p = v->indexToWorld(voxel.getCoord());
            EXPECT_NEAR((*voxel)[0], p.x() < 0.7 ? 0 : 10, 1e-5) << p;
        }
    }
}

TEST(Particles, SameBytesForAnyNumberOfThreads)
{
    const std::vector<Vec3d> centers = box(14, 14, 8, 0.3, 7);
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres}) {
        std::vector<std::string> files;
        for (const std::size_t threads : {std::size_t(1), std::size_t(4)}) {
            const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
            ParticleOptions options;
            options.surface = surface;
            options.radius = world(kUnitBall);
            const ParticleResult made = particlesToLevelSet(turning(centers), options);
            const auto file = std::filesystem::temp_directory_path() /
                              ("particles_test_" + std::to_string(::getpid()) + ".vdb");
            writeLevelSet(file, made.levelSet(), {}, {made.beside.begin(), made.beside.end()});
            std::ifstream in(file, std::ios::binary);
            files.emplace_back(std::istreambuf_iterator<char>(in),
                               std::istreambuf_iterator<char>());
            std::filesystem::remove(file);
        }
        EXPECT_GT(files[0].size(), 1000u);
        EXPECT_TRUE(files[0] == files[1]);
    }
}

TEST(Particles, NamesOfRadiiAndVelocities)
{
    const ParticleNames houdini = ParticleNames::among({"id", "pscale", "vx", "vy", "vz"});
    EXPECT_EQ(houdini.radius, "pscale");
    EXPECT_EQ(houdini.velocity, (std::vector<std::string>{"vx", "vy", "vz"}));
    const ParticleNames usd =
        ParticleNames::among({"width", "velocity_x", "velocity_y", "velocity_z"});
    EXPECT_EQ(usd.radius, "width");
    EXPECT_EQ(usd.radiusScale, 0.5);
    EXPECT_EQ(usd.velocity.front(), "velocity_x");
    for (const std::vector<std::string>& written :
         {std::vector<std::string>{"v[x]", "v[y]", "v[z]"},
          {"Velocity:0", "Velocity:1", "Velocity:2"},
          {"velX", "velY", "velZ"},
          {"VX", "VY", "VZ"}})
        EXPECT_EQ(ParticleNames::among(written).velocity, written);
    EXPECT_EQ(ParticleNames::among({"age", "RADIUS"}).radius, "RADIUS");
    EXPECT_EQ(ParticleNames::among({"Diameter"}).radiusScale, 0.5);
    const ParticleNames none = ParticleNames::among({"intensity", "vx", "vz"});
    EXPECT_TRUE(none.radius.empty());
    EXPECT_TRUE(none.velocity.empty());
    const std::vector<std::string> plane = {"vx", "vy"};
    EXPECT_EQ(ParticleNames::among({"intensity", "vx", "vy"}).velocity, plane);
}

/// A folder that goes with the test.
class ParticleFiles : public testing::Test
{
protected:
    void SetUp() override
    {
        mFolder = std::filesystem::temp_directory_path() /
                  ("particle_files_" + std::to_string(::getpid()));
        std::filesystem::create_directories(mFolder);
    }
    void TearDown() override { std::filesystem::remove_all(mFolder); }

    std::filesystem::path mFolder;
};

TEST_F(ParticleFiles, PlyBringsRadiiVelocitiesAndScalars)
{
    const auto file = mFolder / "two.ply";
    std::ofstream(file) << "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
                           "property float y\nproperty float z\nproperty float pscale\n"
                           "property float vx\nproperty float vy\nproperty float vz\n"
                           "property float age\nend_header\n"
                           "0 0 0 0.5 1 2 3 7\n4 0 0 0.25 4 5 6 8\n";
    const Particles read = readParticles({file}, {"age"});
    ASSERT_EQ(read.size(), 2u);
    EXPECT_EQ(read.radii, (std::vector<float>{0.5f, 0.25f}));
    EXPECT_EQ(read.velocities[1], Vec3f(4, 5, 6));
    ASSERT_EQ(read.scalars.size(), 1u);
    EXPECT_EQ(read.scalars[0].values[1], 8);
    EXPECT_THROW(readParticles({file}, {"temperature"}), InputError);
}

TEST_F(ParticleFiles, VelocitiesInAPlaneHaveNoThirdComponent)
{
    const auto file = mFolder / "plane.txt";
    std::ofstream(file) << "x y z vx vy\n0 0 0 1 2\n4 0 0 4 5\n";
    const Particles read = readParticles({file}, {});
    ASSERT_EQ(read.velocities.size(), 2u);
    EXPECT_EQ(read.velocities[1], Vec3f(4, 5, 0));
    ASSERT_FALSE(read.notes.empty());
    EXPECT_NE(read.notes.back().find("the third is 0"), std::string::npos) << read.notes.back();
}

TEST_F(ParticleFiles, WhatSomeFilesLackIsTold)
{
    const auto with = mFolder / "with.csv", without = mFolder / "without.csv";
    std::ofstream(with) << "X,Y,Z,Pscale,vx,vy,vz\n0,0,0,0.5,1,2,3\n4,0,0,0.25,4,5,6\n";
    std::ofstream(without) << "x,y,z\n0,8,0\n4,8,0\n";
    EXPECT_EQ(readParticles({with}).radii.size(), 2u);
    const Particles read = readParticles({with, without});
    EXPECT_TRUE(read.radii.empty());
    EXPECT_TRUE(read.velocities.empty());
    ASSERT_EQ(read.warnings.size(), 2u);
    EXPECT_NE(read.warnings[0].find("without.csv has no 'Pscale': the radii"), std::string::npos)
        << read.warnings[0];
    EXPECT_NE(read.warnings[1].find("velocities"), std::string::npos) << read.warnings[1];
}

TEST_F(ParticleFiles, PointGridsAreParticles)
{
    namespace points = openvdb::points;
    openvdb::initialize();
    const std::vector<openvdb::Vec3f> places = {{0, 0, 0}, {3, 1, 2}, {3.1f, 1, 2}, {-40, 5, 1}};
    const std::vector<float> radii = {0.5f, 0.25f, 0.3f, 1};
    const std::vector<openvdb::Vec3f> velocities = {{1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
    const points::PointAttributeVector<openvdb::Vec3f> positions(places);
    const auto transform = openvdb::math::Transform::createLinearTransform(0.7);
    const auto index =
        openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(positions, *transform);
    const auto grid = points::createPointDataGrid<points::NullCodec, points::PointDataGrid>(
        *index, positions, *transform);
    points::appendAttribute<float>(grid->tree(), "pscale");
    points::appendAttribute<openvdb::Vec3f>(grid->tree(), "v");
    points::populateAttribute<points::PointDataTree, openvdb::tools::PointIndexTree,
                              points::PointAttributeVector<float>>(
        grid->tree(), index->tree(), "pscale", points::PointAttributeVector<float>(radii));
    points::populateAttribute<points::PointDataTree, openvdb::tools::PointIndexTree,
                              points::PointAttributeVector<openvdb::Vec3f>>(
        grid->tree(), index->tree(), "v", points::PointAttributeVector<openvdb::Vec3f>(velocities));
    const auto file = mFolder / "points.vdb";
    openvdb::io::File(file.string()).write(openvdb::GridPtrVec{grid});

    const Particles read = readParticles({file});
    ASSERT_EQ(read.size(), places.size());
    for (std::size_t i = 0; i < read.size(); ++i) {
        // Each is one of those that were written, with its radius and velocity.
        const Vec3d p = read.frame + read.positions[i].cast<double>();
        const auto n = std::size_t(read.velocities[i].x()) - 1;
        ASSERT_LT(n, places.size());
        EXPECT_NEAR((p - Vec3d(places[n].x(), places[n].y(), places[n].z())).norm(), 0, 1e-5);
        EXPECT_EQ(read.radii[i], radii[n]);
    }
    EXPECT_THROW(readParticles({file}, {"age"}), InputError);
    const auto empty = mFolder / "empty.vdb";
    writeLevelSet(empty, emptyLevelSet(Lattice{}, 3), {});
    EXPECT_THROW(readParticles({empty}), InputError);
}

TEST(Particles, TinyOnesAmongOthersCostLittle)
{
    // Spray that fades out: voxels pass by the smallest, of a millionth of the box.
    std::vector<Vec3d> centers = box(8, 8, 8, 0.3);
    std::vector<float> radii(centers.size());
    for (std::size_t i = 0; i < radii.size(); ++i) radii[i] = 0.5f * float(std::pow(0.96, i));
    ParticleView view;
    view.positions = centers;
    view.radii = radii;
    ParticleOptions options;
    options.voxelSize = world(0.1);
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres}) {
        options.surface = surface;
        const auto start = std::chrono::steady_clock::now();
        const ParticleResult made = particlesToLevelSet(importParticles(view), options);
        const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
        EXPECT_GT(made.report.lost, 300u);
        EXPECT_LT(taken.count(), 20) << "before it was minutes";
    }
}

TEST(Particles, BadInputIsRefused)
{
    const std::vector<Vec3d> centers = box(3, 3, 3, 0);
    for (const float bad : {0.0f, -1.0f, std::nanf(""), INFINITY}) {
        std::vector<float> radii(centers.size(), 0.5f);
        radii[5] = bad;
        ParticleView view;
        view.positions = centers;
        view.radii = radii;
        try {
            particlesToLevelSet(importParticles(view));
            ADD_FAILURE() << bad;
        } catch (const InputError& e) {
            EXPECT_NE(std::string(e.what()).find("particle 5"), std::string::npos) << e.what();
        }
    }
    EXPECT_THROW(particlesToLevelSet(Particles()), InputError);
    const std::vector<Vec3d> one = {Vec3d::Zero()};
    EXPECT_THROW(particlesToLevelSet(importParticles({NumberView(one), {}, {}, {}, {}})),
                 InputError);
    EXPECT_THROW(surfaceOf(centers, -1, 0.1), UsageError);
    EXPECT_THROW(surfaceOf(centers, 0.5, 0), UsageError);
    EXPECT_THROW(surfaceOf(centers, 0.5, 1e-9), LimitError);
    const std::vector<float> few(4, 0.5f);
    EXPECT_THROW(importParticles({NumberView(centers), NumberView(few), {}, {}, {}}), UsageError);
    Particles short_ = particlesAt(centers);
    short_.radii = few;
    EXPECT_THROW(particlesToLevelSet(std::move(short_)), UsageError);
    ParticleOptions options;
    options.radiusScale = 0;
    EXPECT_THROW(particlesToLevelSet(turning(centers), options), UsageError);
    options = {};
    options.halfWidth = 1;
    EXPECT_THROW(particlesToLevelSet(turning(centers), options), UsageError);
}

TEST(Particles, MemoryIsEstimatedBeforeItIsTaken)
{
    ParticleOptions options;
    options.maxBytes = 200 << 20;
    for (const auto surface : {ParticleSurface::Smooth, ParticleSurface::Spheres})
        for (const double radius : {0.5, 300.0, 1e5}) {
            options.surface = surface;
            options.radius = world(radius);
            options.voxelSize = world(radius > 1 ? 0.5 : 0.01);
            EXPECT_THROW(particlesToLevelSet(turning(box(4, 4, 4, 0.1)), options), LimitError)
                << radius;
        }
    options.voxelSize = world(0.25);
    options.radius = world(0.5);
    EXPECT_NO_THROW(particlesToLevelSet(turning(box(4, 4, 4, 0.1)), options));
}

TEST(Particles, StopWithinAQuarterOfASecond)
{
    using Clock = std::chrono::steady_clock;
    const Particles particles = turning(box(40, 40, 40, 0.3));
    Clock::time_point asked;
    for (const char* const stage : {"sort", "blocks", "sample", "distances", "attributes"}) {
        Interrupter* self = nullptr;
        Interrupter progress([&](const std::string& name, double) {
            if (name != stage || self->stopped()) return;
            asked = Clock::now();
            self->stop();
        });
        self = &progress;
        ParticleOptions options;
        options.radius = world(kUnitBall);
        EXPECT_THROW(particlesToLevelSet(Particles(particles), options, &progress), Interrupted)
            << stage;
        EXPECT_LT(std::chrono::duration<double>(Clock::now() - asked).count(), 0.25) << stage;
    }
}

} // namespace
} // namespace mpuvdb
