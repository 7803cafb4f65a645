// What OpenVDB's own operations and copying memory cost, beside a level set of any origin:
//     yardsticks GRID.vdb [THREADS]
// JSON on standard output: seconds and CPU seconds, the least of three, and what they are to be
// divided by. The sphere has about as many active voxels as the grid.
#include "timing.h"

#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <vector>

using openvdb::FloatGrid;

namespace
{

constexpr int kRuns = 3;

/// Time @a work and print it; @a units is what it worked on: active voxels, or bytes.
template <typename Work>
void measure(const char* name, double units, int runs, bool isLast, Work work)
{
    bench::Times times;
    for (int n = 0; n < runs; ++n) times.add(work);
    std::printf("  \"%s\": {\"seconds\": %.9f, \"cpu_seconds\": %.9f, \"units\": %.0f}%s\n", name,
                bench::least(times.wall), bench::least(times.cpu), units, isLast ? "" : ",");
}

FloatGrid::Ptr sphere(double active)
{
    const double radius = std::sqrt(active / (6 * 4 * M_PI)); // a band of 6 voxels
    return openvdb::tools::createLevelSetSphere<FloatGrid>(float(radius), openvdb::Vec3f(0), 1, 3);
}

void compare(const char* path)
{
    const FloatGrid::Ptr grid = bench::readGrid(path);
    const auto active = double(grid->activeVoxelCount());
    const FloatGrid::Ptr ball = sphere(active);
    const auto ballActive = double(ball->activeVoxelCount());
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec3I> triangles;
    std::vector<openvdb::Vec4I> quads;
    std::printf("{\n");
    measure("createLevelSetSphere", ballActive, kRuns, false, [&] { sphere(active); });
    measure("volumeToMesh", active, kRuns, false,
            [&] { openvdb::tools::volumeToMesh(*grid, points, triangles, quads); });
    measure("csgUnionCopy", 2 * ballActive, kRuns, false,
            [&] { openvdb::tools::csgUnionCopy(*ball, *ball); });
    const auto bytes = std::size_t(4 * active);
    const auto from = std::make_unique<char[]>(bytes), to = std::make_unique<char[]>(bytes);
    measure("memoryCopy", double(bytes), kRuns, false,
            [&] { std::memcpy(to.get(), from.get(), bytes); });
    // An order of magnitude slower than the rest.
    measure("meshToVolume", active, 1, true, [&] {
        openvdb::tools::meshToLevelSet<FloatGrid>(grid->transform(), points, triangles, quads, 3);
    });
    std::printf("}\n");
}

} // namespace

int main(int count, char** arguments)
try {
    if (count < 2 || count > 3) {
        std::fprintf(stderr, "usage: %s GRID.vdb [THREADS]\n", arguments[0]);
        return 2;
    }
    std::unique_ptr<tbb::global_control> limit;
    if (count > 2)
        limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                      std::size_t(std::atoi(arguments[2])));
    openvdb::initialize();
    compare(arguments[1]);
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
