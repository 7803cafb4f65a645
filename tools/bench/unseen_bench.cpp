// What nobody saw: virtual scans from a few viewpoints are reconstructed, and the part of the mesh
// that is farther than three spacings from the points is held against the solid:
//     unseen_bench [POISSON_RECON [DEPTH]]
// Prints JSON: the share of the area, mean and largest distance, and beside them PoissonRecon's,
// where a path to it is given.
#include "peer.h"
#include "unseen_part.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

using namespace mpuvdb;

namespace
{

constexpr int kPoints = 60000, kVoxels = 200;

struct Case {
    const char* solid;
    int views;
    int holes = 0;
    double noise = 0; ///< parts of the diagonal
};

constexpr Case kCases[] = {
    {"blob(1, 20, 0.05)", 3},
    {"blob(1, 8, 0.12)", 4},
    {"blob(1, 12, 0.1)", 2},
    {"blob(1, 16, 0.12)", 6, 4},
    {"blob(1, 4, 0.05)", 3, 0, 0.002},
    {"torus(1, 0.4)", 3},
    {"torus(1, 0.25)", 4, 2, 0.002},
    {"torus(1, 0.4)", 2},
    {"union(sphere(1), translate(sphere(0.8), 1.2, 0, 0))", 3},
    {"difference(sphere(1), cylinder(0.35, 3))", 4},
    {"difference(box(2, 2, 1), cylinder(0.4, 3))", 4},
    {"fandisk(1)", 5},
    {"gear(12, 1, 0.5)", 5},
    {"gear(20, 1, 0.3)", 4},
};

std::string json(const char* name, const test::Unseen& part)
{
    return fmt::format(R"("{}": {{"share": {:.4f}, "mean": {:.5f}, "largest": {:.4f}}})", name,
                       part.share, part.mean, part.largest);
}

std::string measured(const Case& chosen, const std::string& program, int depth)
{
    Interrupter progress;
    const auto solid = parseSolid(chosen.solid);
    ScanSettings scanned;
    scanned.points = kPoints;
    scanned.pattern = ScanSettings::Pattern::Scan;
    scanned.views = chosen.views;
    scanned.holes = chosen.holes;
    scanned.noise = chosen.noise * solid->bounds().diagonal().norm();
    const PointCloud cloud = scan(*solid, scanned, &progress);
    const Mesh mesh = bench::ourMesh(cloud, kVoxels, progress);
    const double far = test::farFrom(cloud, mesh);

    std::string line = fmt::format(R"({{"solid": "{}", "views": {}, "holes": {}, "noise": {}, )",
                                   chosen.solid, chosen.views, chosen.holes, chosen.noise);
    line += json("mpuvdb", test::unseenPart(mesh, *solid, cloud, far));
    if (!program.empty())
        line += ", " + json("PoissonRecon",
                            test::unseenPart(bench::poissonMesh(program, depth, cloud, progress),
                                             *solid, cloud, far));
    return line + "}";
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    try {
        const std::string program = argc > 1 ? argv[1] : "";
        const int depth = argc > 2 ? std::atoi(argv[2]) : 8;
        const char* separator = "[\n";
        for (const Case& chosen : kCases) {
            fmt::print("{}  {}", separator, measured(chosen, program, depth));
            std::fflush(stdout);
            separator = ",\n";
        }
        fmt::print("\n]\n");
    } catch (const std::exception& error) {
        fmt::print(stderr, "unseen_bench: {}\n", error.what());
        return 1;
    }
}
