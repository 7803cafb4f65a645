// Particles to a surface, beside the two recipes of vdb_tool's page, made of the same parts of
// OpenVDB: level-set spheres (ParticlesToLevelSet), dilated, smoothed and eroded (LevelSetFilter).
// "recipe" is -points2ls -dilate -gauss -erode, "production" -dilate radius=2.5 -gauss iter=2
// -erode radius=2.5; both with space=5 time=1.
//     particles_bench [COUNT [pool|splash|spray [RADIUS_IN_VOXELS [PREFIX [RUNS [alone]]]]]]
// "alone" leaves OpenVDB's out. Prints JSON: times, volumes, active voxels, topology. With PREFIX
// the level sets are written to PREFIX-smooth.vdb, PREFIX-recipe.vdb and so on.
#include "timing.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/particles.h>

#include <fmt/format.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/ParticlesToLevelSet.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <random>
#include <string>
#include <vector>

namespace
{

using mpuvdb::Vec3d;
using openvdb::FloatGrid;

/// Particles one unit apart, which each take one unit of volume.
struct Scene {
    std::vector<Vec3d> centers;
    std::mt19937 random{1};

    double uniform(double low, double high)
    {
        return std::uniform_real_distribution<double>(low, high)(random);
    }
    /// Add a particle off its place by up to a quarter of the spacing, as a simulation's are.
    void add(const Vec3d& place)
    {
        centers.push_back(place +
                          Vec3d(uniform(-0.25, 0.25), uniform(-0.25, 0.25), uniform(-0.25, 0.25)));
    }
    /// A box of water with a wave on it, @a side long and @a depth deep.
    void addPool(double side, double depth)
    {
        for (double x = 0.5; x < side; ++x)
            for (double y = 0.5; y < side; ++y)
                for (double z = 0.5;
                     z < depth + 2 * std::sin(8 * x / side) * std::sin(6 * y / side); ++z)
                    add({x, y, z});
    }
    /// A crown: the wall of a cone, two particles thick.
    void addCrown(const Vec3d& base, double radius, double height)
    {
        for (int layer = 0; layer < 2; ++layer)
            for (double z = 0.5; z < height; ++z) {
                const double r = radius + layer + 0.4 * z;
                const double n = std::round(2 * M_PI * r);
                for (double k = 0; k < n; ++k)
                    add(base +
                        Vec3d(r * std::cos(2 * M_PI * k / n), r * std::sin(2 * M_PI * k / n), z));
            }
    }
    void addSpray(std::size_t count, const Vec3d& low, const Vec3d& high)
    {
        for (std::size_t n = 0; n < count; ++n)
            centers.push_back(
                {uniform(low[0], high[0]), uniform(low[1], high[1]), uniform(low[2], high[2])});
    }
};

Scene sceneOf(const std::string& name, double count)
{
    Scene scene;
    if (name == "pool") {
        const double side = std::cbrt(4 * count);
        scene.addPool(side, side / 4);
    } else if (name == "splash") {
        // Water a fifth as deep as it is wide, two crowns, and a fiftieth of the rest as droplets.
        const double side = std::cbrt(4.5 * count), depth = side / 5;
        scene.addPool(side, depth);
        const Vec3d middle(side / 2, side / 2, depth + 1);
        scene.addCrown(middle, side / 6, side / 4);
        scene.addCrown(middle, side / 12, side / 6);
        scene.addSpray(scene.centers.size() / 50, {0, 0, depth + 2}, {side, side, side});
    } else {
        const double side = std::cbrt(20 * count);
        scene.addSpray(std::size_t(count), Vec3d::Zero(), Vec3d::Constant(side));
    }
    return scene;
}

/// What ParticlesToLevelSet asks of a list.
struct ParticleList {
    using PosType = openvdb::Vec3R;
    const std::vector<Vec3d>& centers;
    double radius;

    std::size_t size() const { return centers.size(); }
    void getPos(std::size_t n, openvdb::Vec3R& at) const
    {
        at = openvdb::Vec3R(centers[n].x(), centers[n].y(), centers[n].z());
    }
    void getPosRad(std::size_t n, openvdb::Vec3R& at, openvdb::Real& r) const
    {
        getPos(n, at);
        r = radius;
    }
};

/// @param offset  voxels by which the balls are dilated and eroded. @param times  of smoothing.
FloatGrid::Ptr recipeOf(const Scene& scene, double radius, double voxelSize, double offset,
                        int times)
{
    FloatGrid::Ptr grid = openvdb::createLevelSet<FloatGrid>(voxelSize, 3);
    openvdb::tools::ParticlesToLevelSet<FloatGrid> rasterizer(*grid);
    rasterizer.setRmin(0);
    rasterizer.rasterizeSpheres(ParticleList{scene.centers, radius});
    rasterizer.finalize(true);
    openvdb::tools::LevelSetFilter<FloatGrid> filter(*grid);
    filter.setSpatialScheme(openvdb::math::HJWENO5_BIAS);
    filter.setTemporalScheme(openvdb::math::TVD_RK1);
    const auto by = float(offset * voxelSize);
    filter.offset(-by);
    for (int n = 0; n < times; ++n) filter.gaussian(1);
    filter.offset(by);
    return grid;
}

void print(const char* name, const FloatGrid::Ptr& grid, const bench::Times& times,
           const std::string& prefix, bool last)
{
    const mpuvdb::SolidMeasures solid = mpuvdb::measure(mpuvdb::LevelSet(grid));
    const mpuvdb::CheckReport check = mpuvdb::check(*grid);
    fmt::print("  \"{}\": {{\"seconds\": {:.3f}, \"cpu_seconds\": {:.3f}, \"active_voxels\": {}, "
               "\"volume\": {:.5g}, \"area\": {:.5g}, \"surfaces\": {}, \"genus\": {:g}, "
               "\"mean_gradient_error\": {:.4f}, \"findings\": {}}}{}\n",
               name, bench::least(times.wall), bench::least(times.cpu), grid->activeVoxelCount(),
               solid.volume, solid.area, solid.surfaces, solid.genus, check.meanGradientError,
               check.findings.size(), last ? "" : ",");
    std::fflush(stdout);
    if (!prefix.empty())
        mpuvdb::writeGrids(prefix + "-" + name + ".vdb", openvdb::GridCPtrVec{grid});
}

void compare(const std::string& name, double count, double voxels, const std::string& prefix,
             int runs, bool alone)
{
    const Scene scene = sceneOf(name, count);
    const double radius = std::cbrt(3 / (4 * M_PI)), voxelSize = radius / voxels;
    fmt::print("{{\n  \"scene\": \"{}\", \"particles\": {}, \"radius\": {:.4f}, \"voxel_size\": "
               "{:.4f},\n",
               name, scene.centers.size(), radius, voxelSize);
    const std::vector<double> radii(scene.centers.size(), radius);
    mpuvdb::ParticleView view;
    view.positions = scene.centers;
    view.radii = radii;
    for (const auto surface : {mpuvdb::ParticleSurface::Smooth, mpuvdb::ParticleSurface::Spheres}) {
        mpuvdb::ParticleOptions options;
        options.voxelSize = mpuvdb::Length{voxelSize, mpuvdb::Length::Unit::World};
        options.surface = surface;
        mpuvdb::ParticleResult made;
        bench::Times times;
        std::vector<mpuvdb::StageTime> stages;
        for (int run = 0; run < runs; ++run) {
            mpuvdb::Interrupter progress;
            times.add([&] {
                made = mpuvdb::particlesToLevelSet(mpuvdb::importParticles(view, &progress),
                                                   options, &progress);
            });
            stages = progress.stages();
        }
        for (const mpuvdb::StageTime& stage : stages)
            fmt::print(stderr, "{} {:.3f} s, {:.3f} s cpu\n", stage.name, stage.seconds,
                       stage.cpuSeconds);
        print(surface == mpuvdb::ParticleSurface::Smooth ? "smooth" : "spheres", made.grid, times,
              prefix, false);
    }
    for (const bool isProduction : {false, true}) {
        if (alone) continue;
        FloatGrid::Ptr made;
        bench::Times times;
        for (int run = 0; run < runs; ++run)
            times.add([&] {
                made = isProduction ? recipeOf(scene, radius, voxelSize, 2.5, 2)
                                    : recipeOf(scene, radius, voxelSize, 1, 1);
            });
        print(isProduction ? "production" : "recipe", made, times, prefix, isProduction);
    }
    fmt::print("}}\n");
}

} // namespace

int main(int argc, char** argv)
{
    try {
        openvdb::initialize();
        compare(argc > 2 ? argv[2] : "splash", argc > 1 ? std::atof(argv[1]) : 1e6,
                argc > 3 ? std::atof(argv[3]) : 2, argc > 4 ? argv[4] : "",
                argc > 5 ? std::atoi(argv[5]) : 1, argc > 6);
    } catch (const std::exception& e) {
        std::fprintf(stderr, "particles_bench: %s\n", e.what());
        return 1;
    }
    return 0;
}
