// Fits a sphere and prints how many voxels its narrow band has.
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>

#include <cstdio>

int main()
{
    openvdb::initialize();
    try {
        mpuvdb::Interrupter progress;
        mpuvdb::ScanSettings scanner;
        scanner.points = 4000;
        mpuvdb::ReconstructSettings settings;
        settings.voxels = 32;
        const mpuvdb::Reconstruction sphere =
            mpuvdb::reconstruct(mpuvdb::scan(*mpuvdb::parseSolid("sphere(1)"), scanner, &progress),
                                settings, &progress);
        const mpuvdb::Mesh mesh = mpuvdb::extractMesh(sphere.levelSet, {}, &progress);
        const bool sound = mpuvdb::check(sphere.levelSet.grid(), kGradientTolerance,
                                         openvdb::CoordBBox::inf(), &progress)
                               .sound() &&
                           mpuvdb::measure(mesh).components == 1;
        std::printf("%llu active voxels\n",
                    static_cast<unsigned long long>(sphere.levelSet.grid().activeVoxelCount()));
        return sound ? 0 : 1;
    } catch (const mpuvdb::Error& error) {
        std::fprintf(stderr, "%s: %s\n", error.type(), error.what());
        return int(error.code());
    }
}
