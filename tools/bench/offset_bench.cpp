// What an offset and a re-distancing cost and how exact they are, beside OpenVDB's own:
//     offset_bench GRID.vdb [VOXELS]
// The reference is the distance to the triangles of the surface (openvdb::tools::meshToVolume);
// voxels where it has no slope of 1, near the medial axis, do not count.
#include "timing.h"

#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/LevelSetRebuild.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>

using openvdb::FloatGrid;

namespace
{

/// Distances to the triangles of @a grid, from -@a inside to @a outside voxels.
FloatGrid::Ptr reference(const FloatGrid& grid, float outside, float inside)
{
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec3I> triangles;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(grid, points, triangles, quads);
    return openvdb::tools::meshToSignedDistanceField<FloatGrid>(grid.transform(), points, triangles,
                                                                quads, outside, inside);
}

/// Whether the exact distance has a slope of about 1, so that no medial axis is near.
bool isRegular(const FloatGrid::ConstAccessor& exact, const openvdb::Coord& at, double voxelSize)
{
    constexpr double kTolerance = 0.03;
    double sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
        openvdb::Coord low = at, high = at;
        low[axis] -= 1;
        high[axis] += 1;
        if (!exact.isValueOn(low) || !exact.isValueOn(high)) return false;
        const double slope = (exact.getValue(high) - exact.getValue(low)) / (2 * voxelSize);
        sum += slope * slope;
    }
    return std::abs(std::sqrt(sum) - 1) < kTolerance;
}

/// Print how far @a grid is from @a exact minus @a shift voxels.
void printErrors(const char* name, const FloatGrid& grid, const FloatGrid& exact, double shift,
                 double seconds)
{
    const double voxelSize = grid.voxelSize()[0];
    const auto reference = exact.getConstAccessor();
    double sum = 0, largest = 0;
    std::uint64_t count = 0;
    for (auto value = grid.cbeginValueOn(); value; ++value) {
        const openvdb::Coord at = value.getCoord();
        if (!reference.isValueOn(at) || !isRegular(reference, at, voxelSize)) continue;
        const double error = std::abs((*value - reference.getValue(at)) / voxelSize + shift);
        sum += error;
        largest = std::max(largest, error);
        ++count;
    }
    std::printf("  \"%s\": {\"cpu_seconds\": %.3f, \"active_voxels\": %llu, \"compared\": %llu, "
                "\"mean_error\": %.5f, \"max_error\": %.4f}",
                name, seconds, static_cast<unsigned long long>(grid.activeVoxelCount()),
                static_cast<unsigned long long>(count), count ? sum / double(count) : 0.0, largest);
}

template <typename F>
void run(const char* name, const FloatGrid& exact, double shift, F f)
{
    bench::Times times;
    FloatGrid::ConstPtr result;
    times.add([&] { result = f(); });
    printErrors(name, *result, exact, shift, times.cpu.front());
}

void compare(const char* path, double voxels)
{
    mpuvdb::Progress progress;
    const FloatGrid::Ptr grid = bench::readGrid(path);
    const mpuvdb::LevelSet levelSet(grid);
    const double distance = voxels * levelSet.voxelSize();
    const auto halfWidth = float(levelSet.halfWidth());
    const auto out = float(std::max(voxels, 0.0)) + halfWidth + 1,
               in = float(std::max(-voxels, 0.0)) + halfWidth + 1;
    const FloatGrid::Ptr exact = reference(*grid, out, in);
    std::printf("{\n");
    run("offset", *exact, voxels,
        [&] { return mpuvdb::offset(levelSet, distance, progress).gridPtr(); });
    std::printf(",\n");
    run("LevelSetFilter::offset", *exact, voxels, [&] {
        const FloatGrid::Ptr moved = grid->deepCopy();
        openvdb::tools::LevelSetFilter<FloatGrid>(*moved).offset(float(-distance));
        return moved;
    });
    std::printf(",\n");
    run("redistance", *exact, 0,
        [&] { return mpuvdb::redistance(*grid, halfWidth, progress).gridPtr(); });
    std::printf(",\n");
    run("levelSetRebuild", *exact, 0,
        [&] { return openvdb::tools::levelSetRebuild(*grid, 0.0f, halfWidth, halfWidth); });
    std::printf("\n}\n");
}

} // namespace

int main(int count, char** arguments)
try {
    if (count < 2 || count > 3) {
        std::fprintf(stderr, "usage: %s GRID.vdb [VOXELS]\n", arguments[0]);
        return 2;
    }
    openvdb::initialize();
    compare(arguments[1], count > 2 ? std::atof(arguments[2]) : 20);
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
