// Extraction of a mesh beside openvdb::tools::volumeToMesh, from the same level set:
//     mesh_bench [SOLID [VOXEL_SIZE [THREADS [RUNS]]]]
// SOLID as mpuvdb sample takes it. JSON on standard output: medians of alternated runs, seconds and
// CPU seconds.
#include <mpuvdb/fields.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/progress.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <exception>

using namespace mpuvdb;

namespace
{

struct Times {
    std::vector<double> seconds, cpuSeconds;

    template <typename Work>
    void add(const Work& work)
    {
        const auto start = std::chrono::steady_clock::now();
        const std::clock_t cpuStart = std::clock();
        work();
        cpuSeconds.push_back(double(std::clock() - cpuStart) / CLOCKS_PER_SEC);
        const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
        seconds.push_back(wall.count());
    }
};

double median(std::vector<double> values)
{
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

std::string json(const char* name, const Times& times)
{
    return fmt::format("  \"{}\": {{\"seconds\": {:.5f}, \"cpu_seconds\": {:.5f}}},\n", name,
                       median(times.seconds), median(times.cpuSeconds));
}

void run(const std::string& description, double voxelSize, int runs)
{
    const FieldPtr field = makeSolidField(parseSolid(description));
    SampleSettings settings;
    settings.lattice.voxelSize = voxelSize;
    Progress progress;
    const LevelSet levelSet = sampleField(*field, settings, progress);
    Times theirs, fromGrid, fromField, simplified;
    Mesh mesh, fewer;
    for (int n = 0; n < runs; ++n) {
        theirs.add([&] { openvdb::tools::VolumeToMesh()(levelSet.grid()); });
        fromGrid.add([&] { mesh = extractMesh(levelSet, progress); });
        fromField.add([&] { mesh = extractMesh(levelSet, progress, {field.get()}); });
        simplified.add([&] { fewer = simplify(mesh, {0.1 * voxelSize}, progress); });
    }
    fmt::print(
        "{{\n  \"active_voxels\": {},\n  \"triangles\": {},\n  \"simplified_triangles\": {},\n",
        levelSet.grid().activeVoxelCount(), mesh.triangles.size(), fewer.triangles.size());
    fmt::print("{}{}{}{}", json("volumeToMesh", theirs), json("from_grid", fromGrid),
               json("from_field", fromField), json("simplify_to_0.1_voxel", simplified));
    fmt::print(
        "  \"from_grid_by_volumeToMesh\": {:.3f},\n  \"from_field_by_volumeToMesh\": {:.3f}\n}}\n",
        median(fromGrid.seconds) / median(theirs.seconds),
        median(fromField.seconds) / median(theirs.seconds));
}

} // namespace

int main(int argc, char** argv)
try {
    openvdb::initialize();
    const int threads = argc > 3 ? std::atoi(argv[3]) : 1;
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      std::size_t(std::max(threads, 1)));
    run(argc > 1 ? argv[1] : "rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)",
        argc > 2 ? std::atof(argv[2]) : 0.01, argc > 4 ? std::max(std::atoi(argv[4]), 1) : 5);
    return 0;
} catch (const std::exception& error) {
    fmt::print(stderr, "mesh_bench: {}\n", error.what());
    return 1;
}
