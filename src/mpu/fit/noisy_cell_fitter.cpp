#include "noisy_cell_fitter.h"

#include "files/array_file.h"
#include "fit_quality.h"
#include "sharp_faces.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mpu_field.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Least noise, in tolerances, for which points are averaged. [tuned: fidelity; below, fits to
/// the tolerance follow the points as well]
constexpr double kLeastNoise = 0.7;

/// Noise of normals that were estimated from the positions, radians: they only tell sides apart.
/// [tuned: noise_bench]
constexpr double kEstimatedNormalNoise = 0.2;

/// Largest radius of a cell's ball in radii of its fit's. [tuned: noise_bench; 0.35 and 0.75 cost
/// nothing and 2 %]
constexpr double kBallPerRadius = 0.5;

/// Least points of a ball that are of no sheet yet and make another. [tuned: noise_bench]
constexpr std::size_t kFewestOfSheet = 6;

/// Start of a sheet's growth in the reach of its seed. [tuned: noise_bench]
constexpr double kStartPerSeed = 1.3;

/// Extrapolation up to which a fit is supported by the data, and from which on it is not.
/// [tuned: noise_bench; halves and doubles change nothing]
constexpr double kFullSupport = 3, kNoSupport = 6;

/// Least radius of a ball, in standard deviations of the noise: a smaller one cuts off points that
/// are far from their sheet. [tuned: noise_bench]
constexpr double kLeastBall = 3;

/// Share of a ball's points that are outliers rather than another sheet's. [tuned: noise_bench]
constexpr double kStrayShare = 0.05;

/// Median spacing of the points, world units; 0 if they are too few.
double medianSpacing(const SortedPoints& points, const RootCube& root)
{
    /// Places at which the spacing is measured, and points about each. [derived: a median of as
    /// many is known to a tenth of its scatter; twice the neighbors that a spacing takes, and a
    /// margin]
    constexpr std::size_t kPlaces = 100;
    constexpr double kPointsAbout = 60;
    const double radius = root.size(points.levelOfCells(kPointsAbout));
    BatchFilter filter;
    PointBatch ball;
    std::vector<double> spacings;
    const std::size_t stride = 1 + points.size() / kPlaces;
    for (std::size_t n = 0; n < points.size(); n += stride) {
        const PointArrays& p = points.points();
        const OctreeCell cell = root.cellAt(Vec3d(p.x[n], p.y[n], p.z[n]), SortedPoints::kMaxLevel);
        points.gather(points.around(cell, radius), 1, filter, ball);
        const double spacing = filter.spacing(ball, root.center(cell), radius);
        if (spacing > 0) spacings.push_back(spacing);
    }
    if (spacings.empty()) return 0;
    const auto middle = spacings.begin() + std::ptrdiff_t(spacings.size() / 2);
    std::nth_element(spacings.begin(), middle, spacings.end());
    return *middle;
}

} // namespace

bool NoisyScan::isFor(const MpuSettings& settings)
{
    return !settings.interpolate && settings.noise > kLeastNoise * settings.tolerance;
}

std::unique_ptr<const NoisyScan> NoisyScan::of(const SortedPoints& points, const RootCube& root,
                                               const MpuSettings& settings, Interrupter& progress)
{
    if (!isFor(settings)) return nullptr;
    const double spacing = medianSpacing(points, root);
    if (!(spacing > 0)) return nullptr;
    auto scan = std::make_unique<NoisyScan>();
    PointNoise noise;
    noise.sigma = settings.noise;
    noise.tolerance = settings.tolerance;
    noise.tau = settings.normalNoise > 0 ? std::max(settings.normalNoise, kMinNormalNoise)
                                         : kEstimatedNormalNoise;
    noise.lever = settings.normalNoise > 0 ? noise.sigma / noise.tau : 0;
    scan->minPoints = std::size_t(settings.minPoints);
    scan->pyramid = std::make_unique<MeanPyramid>(points, root, spacing, progress);
    scan->radii = std::make_unique<RadiusMap>(*scan->pyramid, root, noise, spacing, progress);
    return scan;
}

std::unique_ptr<const NoisyScan> NoisyScan::open(const SortedPoints& points, const ArrayFile& file,
                                                 const RootCube& root)
{
    auto scan = std::make_unique<NoisyScan>();
    scan->minPoints = std::size_t(file.value<std::uint64_t>("least points"));
    scan->pyramid = std::make_unique<MeanPyramid>(points, file, root);
    scan->radii = std::make_unique<RadiusMap>(file, root);
    return scan;
}

void NoisyScan::save(ArrayFileWriter& file) const
{
    file.addValue("least points", std::uint64_t(minPoints));
    pyramid->save(file);
    radii->save(file);
}

bool NoisyCellFitter::isTooLarge(const Vec3d& center, double radius) const
{
    const auto reach = mScan.radii->at(center);
    return !reach || radius > kBallPerRadius * *reach;
}

/// Grow sheets until the points of @a ball are of one each.
void NoisyCellFitter::growSheets(const CellPoints& ball, const Vec3d& center, double radius)
{
    mSheets.clear();
    mTaken.assign(ball.count, 0);
    std::size_t left = ball.count;
    while (left >= kFewestOfSheet && mSheets.size() < std::size_t(LocalFit::kMaxPieces)) {
        double seen = 0;
        const Sheet seed = seedSheet(ball, mTaken, mNoise, seen);
        if (!(seed.count > 0)) return;
        const double reach = std::max(mScan.radii->at(center, seed.axis).value_or(0), radius);
        mGatherer.gather(center, reach, mNoise, mAround);
        const double start = std::max(kStartPerSeed * seen, kStart * reach);
        Sheet sheet = growSheet(mAround, seed, start, reach, mNoise, mScratch);
        sheet = overFeet(sheet, reach, mNoise, mScratch);
        removeTangentialBias(sheet, mNoise);
        const std::size_t before = left;
        left = takePoints(ball, sheet, mNoise, mTaken);
        mSheets.push_back(sheet);
        if (left == before) return;
    }
}

bool NoisyCellFitter::fit(const CellPoints& ball, const Vec3d& center, double radius,
                          LocalFit& result)
{
    mNoise = mScan.radii->noiseAt(center);
    growSheets(ball, center, radius);
    if (mSheets.empty()) return false;
    mEvidence = ball;
    double points = 0;
    for (std::size_t i = 0; i < ball.paddedCount(); ++i)
        points += mEvidence.weight[i] = ball.confidence[i] > 0 ? 1 : 0;
    double least = std::numeric_limits<double>::infinity();
    LocalFit sheets;
    bool opposed = false;
    for (std::size_t m = 0; m < mSheets.size(); ++m) {
        for (std::size_t k = 0; k < m; ++k) opposed |= mSheets[k].axis.dot(mSheets[m].axis) < 0;
        sheets.pieces[m] = mSheets[m].q;
        sheets.count = int(m) + 1;
        if (m > 0 && !mSharp && !opposed) continue;
        LocalFit candidate = sheets;
        const auto errorOf = [&](const LocalFit& fit) {
            return noisyMisfit(fit, mEvidence, mNoise.spread(), mNoise.tau);
        };
        combineFaces(candidate, errorOf);
        // Six unknowns of each sheet, ln(n) / 2 each, of twice the log-likelihood [Schwarz78].
        const double score = points * errorOf(candidate) + 6 * double(m + 1) * std::log(points);
        if (!(score < least)) continue;
        least = score;
        result = candidate;
    }
    return true;
}

double NoisyCellFitter::support(const LocalFit& result, const Vec3d& center, double radius) const
{
    if (mSheets.empty()) return 0;
    const double most = largestOnZeroSet(result, center, radius, [&](const Vec3d& foot) {
        // The sheet whose zero set is there.
        const auto offOf = [&](const Sheet& s) { return std::abs(s.q.value(foot)); };
        const auto ruling =
            std::min_element(mSheets.begin(), mSheets.end(),
                             [&](const Sheet& a, const Sheet& b) { return offOf(a) < offOf(b); });
        return ruling->extrapolation(foot);
    });
    const double t = std::clamp((most - kFullSupport) / (kNoSupport - kFullSupport), 0.0, 1.0);
    return 1 - t * t * (3 - 2 * t);
}

bool NoisyCellFitter::leavesSheets(const LocalFit& result, double radius) const
{
    if (radius < 2 * kLeastBall * mNoise.sigma) return false; // too small once it is split
    const std::size_t count =
        countUnlikely(result, mEvidence, mNoise.spread(), mNoise.tau, kUnlikely);
    return count >= mScan.minPoints && double(count) > kStrayShare * double(mEvidence.count);
}

} // namespace mpuvdb
