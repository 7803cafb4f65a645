#include "disturbances.h"

#include "core/parallel_each.h"
#include "core/random.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kGrain = 4096; ///< points in a task [free: grain size]

template <class T>
void keepMarked(std::vector<T>& values, const std::vector<char>& keep)
{
    if (values.empty()) return;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < values.size(); ++i)
        if (keep[i]) values[kept++] = values[i];
    values.resize(kept);
}

/// @a n turned by a normally distributed angle in each of two tangential directions.
Vec3d turned(const Vec3d& n, double radians, CounterRandom& random)
{
    const double x = random.normal(), y = random.normal();
    const Vec3d axis = tangents(n) * Eigen::Vector2d(x, y);
    const double length = axis.norm();
    if (!(length > 0)) return n;
    return Eigen::AngleAxisd(radians * length, axis / length) * n;
}

/// Flags of exactly the requested share, of the smallest random numbers.
std::vector<char> chooseOutliers(std::size_t count, const ScanSettings& settings)
{
    std::vector<char> chosen;
    const auto wanted = std::size_t(std::llround(settings.outliers * double(count)));
    if (wanted == 0) return chosen;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> lots(count);
    for (std::size_t i = 0; i < count; ++i)
        lots[i] = {CounterRandom(settings.seed, RandomStream::OutlierChoice, i).next(), i};
    std::nth_element(lots.begin(), lots.begin() + std::ptrdiff_t(wanted), lots.end());
    chosen.assign(count, 0);
    for (std::size_t k = 0; k < wanted; ++k) chosen[lots[k].second] = 1;
    return chosen;
}

/// Disturbs points one by one; the random numbers of each depend on its index alone.
class Measurement
{
public:
    Measurement(const ScanSettings& settings, double diagonal)
        : mSettings(settings), mOutlierSpread(settings.outlierDistance * diagonal),
          mTurn(settings.normalNoise * M_PI / 180)
    {
    }

    /// @param along  unit direction of the noise. @return the confidence, by the noise drawn.
    double disturb(std::size_t i, const Vec3d& along, Vec3d& position, Vec3d& normal) const
    {
        CounterRandom random(mSettings.seed, RandomStream::Noise, i);
        const double draw = random.normal();
        if (mSettings.noise > 0) position += mSettings.noise * draw * along;
        if (mTurn > 0) normal = turned(normal, mTurn, random);
        return mSettings.noise > 0 ? std::max(std::exp(-draw * draw / 2), 0.01) : 1.0;
    }

    void throwOut(std::size_t i, Vec3d& position, Vec3d& normal) const
    {
        CounterRandom random(mSettings.seed, RandomStream::Outliers, i);
        position += mOutlierSpread * random.normalVector();
        normal = random.direction();
    }

private:
    const ScanSettings& mSettings;
    double mOutlierSpread, mTurn;
};

void scaleToLargestOne(std::vector<float>& values)
{
    const float largest = values.empty() ? 1 : *std::max_element(values.begin(), values.end());
    for (float& v : values) v /= largest;
}

} // namespace

void cutHoles(const Solid& solid, const ScanSettings& settings, RangeScans& scans,
              Interrupter& progress)
{
    if (settings.holes == 0 || !(settings.holeRadius > 0)) return;
    const std::uint64_t seed = CounterRandom(settings.seed, RandomStream::Holes, 0).next();
    const auto centers = sampleRandom(solid, std::uint64_t(settings.holes), seed, progress).points;
    const double radius = settings.holeRadius * solid.bounds().diagonal().norm();
    std::vector<char> keep(scans.points.size());
    forEachParallel(keep.size(), kGrain, progress, [&](std::size_t i) {
        keep[i] = std::none_of(centers.begin(), centers.end(), [&](const SurfacePoint& c) {
            return (scans.points[i].position - c.position).squaredNorm() < radius * radius;
        });
    });
    keepMarked(scans.points, keep);
    keepMarked(scans.rays, keep);
    keepMarked(scans.confidence, keep);
}

PointCloud measureWithNoise(const Solid& solid, const ScanSettings& settings, RangeScans&& scans,
                            Interrupter& progress)
{
    const Box3d box = solid.bounds();
    const Measurement measurement(settings, box.diagonal().norm());
    const std::size_t count = scans.points.size();
    const std::vector<char> outlier = chooseOutliers(count, settings);
    PointCloud cloud;
    cloud.frame = box.center();
    cloud.positions.resize(count);
    if (settings.normals) cloud.normals.resize(count);
    if (settings.confidence) cloud.confidence.resize(count);
    forEachParallel(count, kGrain, progress, [&](std::size_t i) {
        Vec3d position = scans.points[i].position;
        Vec3d normal = scans.points[i].normal.cast<double>().normalized();
        const Vec3d along = scans.rays.empty() ? normal : Vec3d(scans.rays[i].cast<double>());
        const double drawn = measurement.disturb(i, along, position, normal);
        if (!outlier.empty() && outlier[i]) measurement.throwOut(i, position, normal);
        cloud.positions[i] = (position - cloud.frame).cast<float>();
        if (settings.normals) cloud.normals[i] = normal.cast<float>();
        if (settings.confidence)
            cloud.confidence[i] = scans.confidence.empty() ? float(drawn) : scans.confidence[i];
    });
    scaleToLargestOne(cloud.confidence);
    return cloud;
}

} // namespace mpuvdb
