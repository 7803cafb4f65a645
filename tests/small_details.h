// Details that are small beside the bar they are on: what is made of those seen from one side.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace mpuvdb::test
{

/// A bar with bores, domes and dents on top, of sizes about a step of the coarse field's root grid.
struct Bar {
    static constexpr double kLength = 40, kWidth = 4, kHeight = 2;
    /// Step of the coarse field's root grid, as src/mpu/fill/coarse_sign.cpp has it, world units.
    static constexpr double kRootStep = 1.4 * kLength / 96;
    struct Detail {
        std::string kind;
        double at, size; ///< middle along the bar, and diameter
    };
    std::vector<Detail> details;
    std::string solid;

    Bar()
    {
        std::string added, cut;
        double at = -17.05;
        for (const char* const kind : {"bore", "dome", "dent"})
            for (const double steps : {0.5, 1.0, 1.5, 3.0}) {
                const double size = steps * kRootStep, height = kHeight / 2;
                details.push_back({kind, at, size});
                if (details.back().kind == "bore")
                    cut += fmt::format(", translate(cylinder({}, {}), {}, 0, {})", size / 2,
                                       1.5 * size, at, height);
                else
                    (details.back().kind == "dome" ? added : cut) +=
                        fmt::format(", translate(sphere({}), {}, 0, {})", size / 2, at, height);
                at += 3.1;
            }
        solid = fmt::format("difference(union(box({}, {}, {}){}){})", kLength, kWidth, kHeight,
                            added, cut);
    }
};

/// The points whose place along the bar is within @a half of @a at.
inline PointCloud pieceOf(const PointCloud& cloud, double at, double half)
{
    PointCloud piece;
    piece.frame = cloud.frame;
    for (std::size_t n = 0; n < cloud.size(); ++n) {
        if (!(std::abs(cloud.world(n)[0] - at) < half)) continue;
        piece.positions.push_back(cloud.positions[n]);
        piece.normals.push_back(cloud.normals[n]);
    }
    return piece;
}

/// The volume on the wrong side of a field's surface about a detail, parts of the detail's cube.
inline double wrongVolume(const Field& field, const Bar::Detail& detail, const Solid& solid)
{
    constexpr int kCells = 48;
    const double reach = 0.75 * detail.size;
    const Vec3d low = Vec3d(detail.at, 0, Bar::kHeight / 2) - Vec3d(reach, reach, 2 * reach),
                cell = Vec3d(2 * reach, 2 * reach, 3 * reach) / kCells;
    int wrong = 0;
    for (int i = 0; i < kCells; ++i)
        for (int j = 0; j < kCells; ++j)
            for (int k = 0; k < kCells; ++k) {
                const Vec3d p = low + cell.cwiseProduct(Vec3d(i + 0.5, j + 0.5, k + 0.5));
                wrong += (field.evaluate(p).value < 0) != (solid.bound(p) < 0);
            }
    return wrong * cell.prod() / std::pow(detail.size, 3);
}

/// The bar seen from four viewpoints, one of them above, with points about @a spacing apart.
inline PointCloud scanOf(const Solid& solid, double spacing, Interrupter& progress)
{
    ScanSettings settings;
    const double area = 2 * Bar::kLength * (Bar::kWidth + Bar::kHeight);
    settings.points = std::uint64_t(area / (spacing * spacing));
    settings.pattern = ScanSettings::Pattern::Scan;
    settings.viewpoints = {{0, 50, 55}, {0, -50, -60}, {90, 0, 1}, {-90, 0, -1}};
    return scan(solid, settings, &progress);
}

} // namespace mpuvdb::test
