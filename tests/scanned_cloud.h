// Clouds of the virtual scanner, whose truth is known.
#pragma once
#include <mpuvdb/interrupter.h>
#include <mpuvdb/scan_sampler.h>

#include <string>

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

} // namespace mpuvdb
