#include "disturbances.h"
#include "surface_sampling.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

#include <cmath>

namespace mpuvdb
{
namespace
{

void require(bool fine, const char* what, const char* cure)
{
    if (!fine) throw UsageError(fmt::format("sample: {}. {}", what, cure));
}

void checkSettings(const ScanSettings& s)
{
    require(s.points >= 1 && s.points <= 4000000000u, "the number of points is out of range",
            "Ask for 1 to 4e9");
    require(s.views >= 1 && s.views <= 10000, "the number of views is out of range",
            "Ask for 1 to 10000");
    for (const Vec3d& v : s.viewpoints)
        require(v.allFinite(), "a viewpoint is not finite", "Give three numbers");
    require(s.noise >= 0 && std::isfinite(s.noise), "the noise is negative or not finite",
            "Give a standard deviation in world units");
    require(s.normalNoise >= 0 && s.normalNoise <= 90, "the normal noise is out of range",
            "Give degrees from 0 to 90");
    require(s.outliers >= 0 && s.outliers <= 0.5, "the share of outliers is out of range",
            "Give 0 to 0.5");
    require(s.outlierDistance >= 0 && std::isfinite(s.outlierDistance),
            "the distance of outliers is negative or not finite", "Give parts of the diagonal");
    require(s.holes >= 0 && s.holes <= 100000, "the number of holes is out of range",
            "Give 0 to 100000");
    require(s.holeRadius >= 0 && std::isfinite(s.holeRadius),
            "the radius of holes is negative or not finite", "Give parts of the diagonal");
}

RangeScans samplePattern(const Solid& solid, const ScanSettings& s, Interrupter& progress)
{
    RangeScans scans;
    if (s.pattern == ScanSettings::Pattern::Scan) return sampleRangeScans(solid, s, progress);
    if (s.pattern == ScanSettings::Pattern::Even)
        scans.points = sampleEven(solid, s.points, s.seed, progress);
    else
        scans.points = sampleRandom(solid, s.points, s.seed, progress).points;
    return scans;
}

} // namespace

PointCloud scan(const Solid& solid, const ScanSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    checkSettings(settings);
    progress.beginStage("sample");
    RangeScans scans = samplePattern(solid, settings, progress);
    cutHoles(solid, settings, scans, progress);
    PointCloud cloud = measureWithNoise(solid, settings, std::move(scans), progress);
    progress.endStage();
    return cloud;
}

} // namespace mpuvdb
