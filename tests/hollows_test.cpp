// Solids with dents, bores and gaps: what their data leave open closes without cavities inside.
#include "field_fixture.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

struct Case {
    std::string solid;
    std::uint64_t components;
    std::int64_t euler;
};

std::vector<Case> family()
{
    std::vector<Case> cases;
    for (const auto& [bumps, amplitude] : {std::pair(4, 0.05), {8, 0.12}, {12, 0.1}, {16, 0.12}})
        cases.push_back({fmt::format("blob(1, {}, {})", bumps, amplitude), 1, 2});
    cases.push_back({"difference(box(2, 2, 1), cylinder(0.4, 3))", 1, 0});
    cases.push_back({"gear(12, 1, 0.5)", 1, 0});
    cases.push_back({"union(torus(1, 0.25), "
                     "translate(rotate(torus(1, 0.25), 1, 0, 0, 90), 1.3, 0, 0))",
                     2, 0});
    return cases;
}

/// By the signs at the middles of small cubes.
double volumeOf(const Solid& solid)
{
    constexpr int n = 64;
    const Box3d box = solid.bounds();
    const Vec3d step = box.sizes() / n;
    std::size_t inside = 0;
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            for (int k = 0; k < n; ++k) {
                const Vec3d at = box.min() + step.cwiseProduct(Vec3d(i + 0.5, j + 0.5, k + 0.5));
                inside += solid.bound(at) < 0;
            }
    return double(inside) * step.prod();
}

/// Exact points, noisy points, and range scans with holes.
std::vector<ScanSettings> scansOf(const Solid& solid)
{
    ScanSettings exact;
    exact.points = 50000; // enough for small steps of the coarse sign
    exact.pattern = ScanSettings::Pattern::Random;
    ScanSettings noisy = exact;
    noisy.noise = 0.005 * solid.bounds().diagonal().norm();
    noisy.normalNoise = 5;
    ScanSettings seen = exact;
    seen.pattern = ScanSettings::Pattern::Scan;
    seen.views = 6;
    seen.holes = 4;
    seen.holeRadius = 0.04;
    return {exact, noisy, seen};
}

TEST(Hollows, OpenOnlyWhereDataFaceThem)
{
    const std::vector<Case> cases = family();
    for (std::size_t n = 0; n < cases.size(); ++n) {
        const auto solid = parseSolid(cases[n].solid);
        const double volume = volumeOf(*solid);
        const std::vector<ScanSettings> scans = scansOf(*solid);
        for (std::size_t s = 0; s < scans.size(); ++s) {
            // Each solid with each number of voxels, and each kind of scan.
            constexpr double kVoxels[] = {60, 100, 150};
            ReconstructSettings settings;
            settings.voxels = kVoxels[(n + s) % 3];
            SCOPED_TRACE(testing::Message()
                         << cases[n].solid << ", scan " << s << ", " << *settings.voxels);
            Progress progress;
            const Reconstruction result =
                reconstruct(scan(*solid, scans[s], progress), settings, progress);
            const MeshReport report = measure(extractMesh(result.levelSet, progress));
            EXPECT_EQ(report.components, cases[n].components);
            EXPECT_EQ(report.eulerCharacteristic, cases[n].euler);
            EXPECT_NEAR(report.volume, volume, 0.02 * volume);
        }
    }
}

} // namespace
} // namespace mpuvdb
