// Noise: virtual scans and random samples of solids, noisy in position and normal, are
// reconstructed and held against the solid:
//     noise_bench [POISSON_RECON [NOISE]...]
// of 0.005 and 0.01 of the diagonal, or as much as is told.
// Prints JSON: the rms distance from the mesh to the solid and from the solid to the mesh, in parts
// of the noise, components and genus, and beside them PoissonRecon's at the best of depths 5 to 8,
// where a path to it is given.
#include "peer.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>
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

constexpr int kPoints = 60000, kVoxels = 150;
constexpr double kNormalNoise = 10; // degrees

constexpr const char* kSolids[] = {
    "blob(1, 20, 0.05)",
    "blob(1, 12, 0.1)",
    "torus(1, 0.4)",
    "torus(1, 0.1)",
    "union(sphere(1), translate(sphere(0.8), 1.2, 0, 0))",
    "box(2, 2, 0.14)",
    "difference(box(2, 2, 1), cylinder(0.4, 3))",
    "fandisk(1)",
    "gear(12, 1, 0.5)",
};

struct Result {
    double error = 0, there = 0, back = 0; ///< in parts of the noise: the mean of both ways, each
    std::uint64_t components = 0;
    double genus = 0;
};

/// @param truth  points spread evenly on the solid.
Result held(const Mesh& mesh, const Solid& solid, const PointCloud& truth, double noise,
            Interrupter& progress)
{
    double area = 0, squares = 0;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
        const double part = (b - a).cross(c - a).norm() / 2;
        const double distance = solid.distance((a + b + c) / 3);
        area += part;
        squares += part * distance * distance;
    }
    const MeshReport report = measure(mesh);
    Result result;
    result.there = std::sqrt(squares / area) / noise;
    result.back = distances(mesh, truth, &progress).back.rms / noise;
    result.error = (result.there + result.back) / 2;
    result.components = report.components;
    result.genus = report.genus;
    return result;
}

std::string json(const char* name, const Result& r)
{
    return fmt::format(
        R"("{}": {{"error": {:.4f}, "there": {:.4f}, "back": {:.4f}, "components": {}, "genus": {}}})",
        name, r.error, r.there, r.back, r.components, r.genus);
}

struct Case {
    const char* solid;
    ScanSettings::Pattern pattern;
    double noise; ///< parts of the diagonal
};

std::string measured(const Case& chosen, const std::string& program)
{
    Interrupter progress;
    const auto solid = parseSolid(chosen.solid);
    const double noise = chosen.noise * solid->bounds().diagonal().norm();
    ScanSettings exact;
    exact.points = kPoints;
    const PointCloud truth = scan(*solid, exact, &progress);
    ScanSettings scanned = exact;
    scanned.pattern = chosen.pattern;
    scanned.noise = noise;
    scanned.normalNoise = kNormalNoise;
    const PointCloud cloud = scan(*solid, scanned, &progress);

    const Result ours =
        held(bench::ourMesh(cloud, kVoxels, progress), *solid, truth, noise, progress);
    std::string line = fmt::format(
        R"({{"solid": "{}", "pattern": "{}", "noise": {}, )", chosen.solid,
        chosen.pattern == ScanSettings::Pattern::Scan ? "scan" : "random", chosen.noise);
    line += json("mpuvdb", ours);
    if (!program.empty()) {
        Result best;
        int bestDepth = 0;
        for (const int depth : {5, 6, 7, 8}) {
            const Mesh mesh = bench::poissonMesh(program, depth, cloud, progress);
            const Result theirs = held(mesh, *solid, truth, noise, progress);
            if (bestDepth && theirs.error >= best.error) continue;
            best = theirs;
            bestDepth = depth;
        }
        line += fmt::format(R"(, {}, "depth": {}, "ratio": {:.3f})", json("PoissonRecon", best),
                            bestDepth, ours.error / best.error);
    }
    return line + "}";
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    try {
        const std::string program = argc > 1 ? argv[1] : "";
        const char* separator = "[\n";
        std::vector<double> noises{0.005, 0.01};
        if (argc > 2) noises.clear();
        for (int n = 2; n < argc; ++n) noises.push_back(std::atof(argv[n]));
        for (const double noise : noises)
            for (const auto pattern : {ScanSettings::Pattern::Random, ScanSettings::Pattern::Scan})
                for (const char* const solid : kSolids) {
                    fmt::print("{}  {}", separator, measured({solid, pattern, noise}, program));
                    std::fflush(stdout);
                    separator = ",\n";
                }
        fmt::print("\n]\n");
    } catch (const std::exception& error) {
        fmt::print(stderr, "noise_bench: {}\n", error.what());
        return 1;
    }
}
