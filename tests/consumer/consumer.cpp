// Points in the memory of a program that speaks OpenVDB: std::vector<openvdb::Vec3f> in,
// FloatGrid::Ptr out.
#include <mpuvdb/error.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <cmath>
#include <cstdio>

int main()
{
    openvdb::initialize();
    std::vector<openvdb::Vec3f> points;
    for (int i = 0; i < 4000; ++i) { // evenly over a sphere
        const double z = (2 * i + 1) / 4000.0 - 1, turn = 2.399963 * i, r = std::sqrt(1 - z * z);
        points.emplace_back(float(r * std::cos(turn)), float(r * std::sin(turn)), float(z));
    }
    try {
        mpuvdb::PointView view(points);
        view.normals = points; // of a unit sphere
        mpuvdb::ReconstructOptions options;
        options.voxels = 32;
        const mpuvdb::ReconstructResult sphere = mpuvdb::reconstruct(view, options);
        const openvdb::FloatGrid::Ptr grid = sphere.grid;
        const bool sound = mpuvdb::check(*grid).sound() &&
                           mpuvdb::measure(mpuvdb::extractMesh(sphere.levelSet())).components == 1;
        std::printf("%llu active voxels\n", (unsigned long long)grid->activeVoxelCount());
        return sound ? 0 : 1;
    } catch (const mpuvdb::Error& error) {
        std::fprintf(stderr, "%s: %s\n", error.type(), error.what());
        return 1;
    }
}
