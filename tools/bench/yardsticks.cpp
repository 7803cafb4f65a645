// What OpenVDB's own operations and copying memory cost, beside a level set of any origin:
//     yardsticks GRID.vdb [THREADS]
// JSON on standard output: seconds and CPU seconds, the least of three, and what they are to be
// divided by. The sphere has about as many active voxels as the grid.
#include <openvdb/openvdb.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <exception>
#include <memory>
#include <stdexcept>
#include <vector>

using openvdb::FloatGrid;

namespace
{

constexpr int kRuns = 3;

double cpuSeconds()
{
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// Time @a work and print it; @a units is what it worked on: active voxels, or bytes.
template <typename Work>
void measure(const char* name, double units, int runs, bool isLast, Work work)
{
    double seconds = HUGE_VAL, cpu = HUGE_VAL;
    for (int n = 0; n < runs; ++n) {
        const auto start = std::chrono::steady_clock::now();
        const double cpuStart = cpuSeconds();
        work();
        const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
        cpu = std::min(cpu, cpuSeconds() - cpuStart);
        seconds = std::min(seconds, wall.count());
    }
    std::printf("  \"%s\": {\"seconds\": %.5f, \"cpu_seconds\": %.5f, \"units\": %.0f}%s\n", name,
                seconds, cpu, units, isLast ? "" : ",");
}

FloatGrid::Ptr read(const char* path)
{
    openvdb::io::File file(path);
    file.open();
    const auto grids = file.getGrids();
    for (const auto& grid : *grids)
        if (auto floats = openvdb::gridPtrCast<FloatGrid>(grid)) return floats;
    throw std::runtime_error(std::string(path) + ": has no float grid");
}

FloatGrid::Ptr sphere(double active)
{
    const double radius = std::sqrt(active / (6 * 4 * M_PI)); // a band of 6 voxels
    return openvdb::tools::createLevelSetSphere<FloatGrid>(float(radius), openvdb::Vec3f(0), 1, 3);
}

void compare(const char* path)
{
    const FloatGrid::Ptr grid = read(path);
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
