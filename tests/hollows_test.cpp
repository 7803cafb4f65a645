// Solids with dents, bores and gaps: what their data leave open closes without cavities inside, and
// near to where they are.
#include "field_fixture.h"
#include "small_details.h"
#include "uncleaned.h"
#include "unseen_part.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
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
    for (const auto& [bumps, amplitude] : {std::pair(8, 0.12), {16, 0.12}})
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
            test::Uncleaned settings;
            settings.voxels = kVoxels[(n + s) % 3];
            SCOPED_TRACE(testing::Message()
                         << cases[n].solid << ", scan " << s << ", " << *settings.voxels);
            Interrupter progress;
            const ReconstructResult result =
                reconstruct(scan(*solid, scans[s], &progress), settings, &progress);
            const MeshReport report = measure(extractMesh(result.levelSet(), {}, &progress));
            EXPECT_EQ(report.components, cases[n].components);
            EXPECT_EQ(report.eulerCharacteristic, cases[n].euler);
            EXPECT_NEAR(report.volume, volume, 0.02 * volume);
        }
    }
}

// --- What nobody saw

TEST(UnseenParts, AreNearTheSolid)
{
    struct Limit {
        const char* solid;
        unsigned views;
        double mean, largest;
    };
    // A tenth above what is reached now; of the bored box, and of the gear's mean, about the middle
    // between what a harmonic function reached and what came out when fits passed for supported
    // far from data. On the torus that function reached .0056 and .017, on the blob, whose bumps
    // are narrower than curvatures reach, .007 and .029.
    for (const Limit& limit :
         {Limit{"gear(12, 1, 0.5)", 5, 0.0116, 0.038}, Limit{"blob(1, 20, 0.05)", 3, 0.01, 0.042},
          Limit{"torus(1, 0.4)", 3, 0.0022, 0.011},
          Limit{"difference(box(2, 2, 1), cylinder(0.4, 3))", 4, 0.044, 0.14},
          Limit{"difference(sphere(1), cylinder(0.35, 3))", 4, 0.1, 0.31}}) {
        SCOPED_TRACE(limit.solid);
        ScanSettings scanned;
        scanned.points = 60000;
        scanned.pattern = ScanSettings::Pattern::Scan;
        scanned.views = limit.views;
        const auto solid = parseSolid(limit.solid);
        Interrupter progress;
        const PointCloud cloud = scan(*solid, scanned, &progress);
        test::Uncleaned settings;
        settings.voxels = 200;
        const ReconstructResult made = reconstruct(PointCloud(cloud), settings, &progress);
        const Mesh mesh = extractMesh(made.levelSet(), {}, &progress);
        const test::Unseen unseen =
            test::unseenPart(mesh, *solid, cloud, test::farFrom(cloud, mesh));
        EXPECT_GT(unseen.share, 0.01);
        EXPECT_LT(unseen.mean, limit.mean);
        EXPECT_LT(unseen.largest, limit.largest);
    }
}

TEST(UnseenParts, AreAsInAPieceAloneHoweverLargeTheWhole)
{
    // Details of 29 and 44 voxels, and a root grid whose step is 29 voxels. Without finer levels
    // the volume on the wrong side is 1.35 times that of the pieces.
    constexpr double kVoxel = test::Bar::kLength / 2000, kMaxRatio = 1.15;
    const test::Bar bar;
    const auto solid = parseSolid(bar.solid);
    Interrupter progress;
    const PointCloud cloud = test::scanOf(*solid, kVoxel, progress);
    test::Uncleaned settings;
    settings.voxelSize = Length{kVoxel};
    const auto fit = [&](const PointCloud& points) {
        return fitPoints(preparePoints(PointCloud(points), settings, &progress), &progress).field;
    };
    const auto whole = fit(cloud);
    double inWhole = 0, inPieces = 0;
    for (const test::Bar::Detail& detail : bar.details) {
        const double steps = detail.size / test::Bar::kRootStep;
        if (steps < 0.9 || steps > 1.6) continue;
        inWhole += test::wrongVolume(*whole, detail, *solid);
        inPieces += test::wrongVolume(*fit(test::pieceOf(cloud, detail.at, 1.5)), detail, *solid);
    }
    EXPECT_GT(inPieces, 0.1);
    EXPECT_LT(inWhole, kMaxRatio * inPieces);
}

/// How much a surface over a hole bends: the mean over its area of the angle between neighboring
/// triangles, times the length of their edge; a ball of radius r has 2 / r.
double bendOfUnseen(const Mesh& mesh, const PointCloud& cloud)
{
    std::map<std::pair<std::uint32_t, std::uint32_t>, Vec3d> normals; // of one triangle per edge
    double unseen = 0, bend = 0;
    test::forEachUnseen(mesh, cloud, test::farFrom(cloud, mesh),
                        [&](const Mesh::Triangle& t, const std::array<Vec3d, 3>& p, double area) {
                            const Vec3d normal = (p[1] - p[0]).cross(p[2] - p[0]).normalized();
                            unseen += area;
                            for (std::size_t k = 0; k < 3; ++k) {
                                const std::size_t next = (k + 1) % 3;
                                const auto [at, isNew] =
                                    normals.emplace(std::minmax(t[k], t[next]), normal);
                                if (isNew) continue;
                                const double cosine = std::clamp(at->second.dot(normal), -1.0, 1.0);
                                bend += std::acos(cosine) * (p[k] - p[next]).norm();
                            }
                        });
    return bend / unseen;
}

TEST(UnseenParts, CloseSmoothly)
{
    struct Limit {
        const char* solid;
        double bend;
    };
    // A tenth above what is reached now; of the others, the middle between that and what came out
    // when leaves without points dragged the surface that closes the cut towards the points beside.
    for (const Limit& limit : {Limit{"blob(1, 20, 0.05)", 5.2}, Limit{"blob(1, 8, 0.12)", 5.3},
                               Limit{"gear(12, 1, 0.5)", 12}}) {
        SCOPED_TRACE(limit.solid);
        ScanSettings scanned;
        scanned.points = 60000;
        scanned.pattern = ScanSettings::Pattern::Random;
        Interrupter progress;
        const PointCloud whole = scan(*parseSolid(limit.solid), scanned, &progress);
        PointCloud cut;
        cut.frame = whole.frame;
        for (std::size_t n = 0; n < whole.size(); ++n) {
            if (whole.positions[n][1] < -0.25f) continue;
            cut.positions.push_back(whole.positions[n]);
            cut.normals.push_back(whole.normals[n]);
        }
        test::Uncleaned settings;
        settings.voxels = 150;
        const ReconstructResult made = reconstruct(PointCloud(cut), settings, &progress);
        EXPECT_LT(bendOfUnseen(extractMesh(made.levelSet(), {}, &progress), cut), limit.bend);
    }
}

} // namespace
} // namespace mpuvdb
