// What nobody saw: virtual scans from a few viewpoints are reconstructed, and the part of the mesh
// that is farther than three spacings from the points is held against the solid:
//     unseen_bench [POISSON_RECON [DEPTH]]
// Prints JSON: the share of the area, mean and largest distance, and beside them PoissonRecon's,
// where a path to it is given.
//     unseen_bench pieces [VOXELS]
// Details of a long bar that are small beside it, and seen from one side: the volume on the wrong
// side of the surface, in parts of the detail's cube, with the whole bar and with a piece of it
// alone.
#include "peer.h"
#include "small_details.h"
#include "unseen_part.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

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

void pieces(double voxels)
{
    Interrupter progress;
    const test::Bar bar;
    const auto solid = parseSolid(bar.solid);
    const double voxel = test::Bar::kLength / voxels;
    const PointCloud cloud = test::scanOf(*solid, voxel, progress);
    ReconstructOptions options;
    options.clean.reset();
    options.voxelSize = Length{voxel};
    const auto fit = [&](const PointCloud& points) {
        return fitPoints(preparePoints(PointCloud(points), options, &progress), &progress);
    };
    const FittedPoints whole = fit(cloud);
    double wholeSum = 0, aloneSum = 0;
    fmt::print("[");
    for (const test::Bar::Detail& detail : bar.details) {
        const FittedPoints alone = fit(test::pieceOf(cloud, detail.at, 1.5));
        const double inWhole = test::wrongVolume(*whole.field, detail, *solid),
                     inPiece = test::wrongVolume(*alone.field, detail, *solid);
        wholeSum += inWhole;
        aloneSum += inPiece;
        fmt::print(R"({}
  {{"detail": "{}", "steps": {:.1f}, "whole": {:.4f}, "alone": {:.4f}}})",
                   &detail == bar.details.data() ? "" : ",", detail.kind,
                   detail.size / test::Bar::kRootStep, inWhole, inPiece);
        std::fflush(stdout);
    }
    fmt::print(R"(,
  {{"detail": "sum", "whole": {:.4f}, "alone": {:.4f}, "ratio": {:.3f}}}
]
)",
               wholeSum, aloneSum, wholeSum / aloneSum);
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    try {
        if (argc > 1 && std::string(argv[1]) == "pieces") {
            pieces(argc > 2 ? std::atof(argv[2]) : 4000);
            return 0;
        }
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
