// Clouds whose truth is known, most of them from the virtual scanner, and what is found in them.
#pragma once
#include <mpuvdb/clean.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/outliers.h>
#include <mpuvdb/scan_sampler.h>

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace mpuvdb
{

using Pattern = ScanSettings::Pattern;
constexpr std::uint32_t kSeed = 5;

inline PointCloud scanned(const std::string& solid, std::uint64_t points, Pattern pattern,
                          double noise = 0, double outliers = 0)
{
    ScanSettings s;
    s.points = points;
    s.pattern = pattern;
    s.noise = noise;
    s.outliers = outliers;
    s.seed = kSeed;
    Interrupter progress;
    return scan(*parseSolid(solid), s, &progress);
}

inline PointCloud planeGrid(int side, float step)
{
    PointCloud cloud;
    for (int x = 0; x < side; ++x)
        for (int y = 0; y < side; ++y)
            cloud.positions.emplace_back(step * float(x), step * float(y), 0.0f);
    return cloud;
}

/// @a count points at random in a box of edges @a size about @a middle.
inline void appendClump(PointCloud& cloud, int count, const Vec3f& middle, const Vec3f& size)
{
    SCOPED_TRACE(kSeed);
    std::mt19937 engine(kSeed);
    const auto uniform = [&] { return float(engine()) / 4294967296.f - 0.5f; };
    for (int i = 0; i < count; ++i) {
        const float x = uniform(), y = uniform(), z = uniform();
        cloud.positions.push_back(middle + size.cwiseProduct(Vec3f(x, y, z)));
        cloud.normals.push_back(Vec3f(x, y, z).normalized());
    }
}

inline std::vector<std::uint32_t> outliersOf(const PointCloud& cloud)
{
    Interrupter progress;
    return findOutliers(cloud, measure(cloud, &progress), &progress);
}

inline std::size_t foundIn(const PointCloud& cloud)
{
    Interrupter progress;
    return findInwardSolids(cloud, measure(cloud, &progress), &progress).size();
}

inline std::size_t foundInFlipped(PointCloud cloud)
{
    flipNormals(cloud);
    return foundIn(cloud);
}

} // namespace mpuvdb
