// Extraction of a mesh beside openvdb::tools::volumeToMesh, from the same level set:
//     mesh_bench [SOLID|GRID.vdb [VOXEL_SIZE [THREADS [RUNS]]]]
// SOLID as mpuvdb sample takes it; a grid has no field, nor needs a voxel size. JSON on standard
// output: medians of alternated runs, seconds and CPU seconds.
#include "timing.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/sampling.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <filesystem>

using namespace mpuvdb;

namespace
{

std::string json(const char* name, const bench::Times& times)
{
    return fmt::format("  \"{}\": {{\"seconds\": {:.5f}, \"cpu_seconds\": {:.5f}}},\n", name,
                       bench::median(times.wall), bench::median(times.cpu));
}

/// @param field  what the level set was sampled from, or null.
void run(const LevelSet& levelSet, const Field* field, int runs)
{
    Interrupter progress;
    bench::Times theirs, fromGrid, fromField, simplified;
    Mesh mesh, fewer;
    for (int n = 0; n < runs; ++n) {
        theirs.add([&] { openvdb::tools::VolumeToMesh()(levelSet.grid()); });
        fromGrid.add([&] { mesh = extractMesh(levelSet, {}, &progress); });
        if (field) fromField.add([&] { mesh = extractMesh(levelSet, {field}, &progress); });
        simplified.add([&] { fewer = simplify(mesh, {0.1 * levelSet.voxelSize()}, &progress); });
    }
    fmt::print(
        "{{\n  \"active_voxels\": {},\n  \"triangles\": {},\n  \"simplified_triangles\": {},\n",
        levelSet.grid().activeVoxelCount(), mesh.triangles.size(), fewer.triangles.size());
    fmt::print("{}{}{}", json("volumeToMesh", theirs), json("from_grid", fromGrid),
               json("simplify_to_0.1_voxel", simplified));
    if (field)
        fmt::print("{}  \"from_field_by_volumeToMesh\": {:.3f},\n", json("from_field", fromField),
                   bench::median(fromField.wall) / bench::median(theirs.wall));
    fmt::print("  \"from_grid_by_volumeToMesh\": {:.3f}\n}}\n",
               bench::median(fromGrid.wall) / bench::median(theirs.wall));
}

void runSolid(const std::string& description, double voxelSize, int runs)
{
    const FieldPtr field = makeSolidField(parseSolid(description));
    SampleSettings settings;
    settings.lattice.voxelSize = voxelSize;
    Interrupter progress;
    run(sampleField(*field, settings, &progress), field.get(), runs);
}

} // namespace

int main(int argc, char** argv)
try {
    openvdb::initialize();
    const int threads = argc > 3 ? std::atoi(argv[3]) : 1;
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      std::size_t(std::max(threads, 1)));
    const std::string what =
        argc > 1 ? argv[1] : "rotate(difference(box(2,2,1),cylinder(0.6,3)),1,2,3,33)";
    const int runs = argc > 4 ? std::max(std::atoi(argv[4]), 1) : 5;
    if (std::filesystem::path(what).extension() == ".vdb")
        run(LevelSet(bench::readGrid(what.c_str())), nullptr, runs);
    else
        runSolid(what, argc > 2 ? std::atof(argv[2]) : 0.01, runs);
    return 0;
} catch (const std::exception& error) {
    fmt::print(stderr, "mesh_bench: {}\n", error.what());
    return 1;
}
