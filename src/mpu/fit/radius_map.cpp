#include "radius_map.h"

#include "core/morton.h"
#include "files/array_file.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Mean number of points of a probe's cell. [tuned: noise_bench; flat from 20 to 100]
constexpr double kProbePoints = 60;

/// Radii of a probe's fits: the least, in spacings and in standard deviations of the noise, and
/// their ratio. [tuned: noise_bench]
constexpr double kLeastSpacings = 2, kLeastNoises = 1, kRatio = 1.25;

/// Fits of a probe whose bias is far above their variance, in a row, after which no larger one is
/// tried: the ratio and the number. [tuned: noise_bench, time]
constexpr double kHopeless = 4;
constexpr int kHopelessSteps = 3;
/// Least radius of such fits, in standard deviations of the noise: smaller windows are needles, in
/// which sheets settle anywhere. [tuned: noise_bench]
constexpr double kJudgedFrom = 3;

/// Range in which probes are averaged, in edges of their cells. [tuned: noise_bench]
constexpr double kWindow = 1.5;

/// Places around the center, in radii, at which fits are compared. [tuned: noise_bench]
constexpr double kTestPlace = 0.33;
constexpr std::size_t kTests = 5;

/// Radius, in standard deviations of the noise, of the fits that move a probe onto the surface, and
/// their largest number. [tuned: noise_bench]
constexpr double kSettled = 2;
constexpr int kMostMoves = 4;

/// Largest ratio of a place's noise to the cloud's, as a logarithm. [derived: a near and a far
/// station, ten times as far]
constexpr double kMostSigmas = 2.3;

/// The fits of one probe.
class Ladder
{
public:
    Ladder(PointGatherer& gatherer, double least) : mGatherer(gatherer), mLeast(least) {}

    /// Move @a center onto the sheet near it, set @a normal to the sheet's, and sum its residuals.
    NoiseSums settle(Vec3d& center, Vec3d& normal, const PointNoise& noise)
    {
        mNoise = noise;
        Sheet sheet = seedAt(center);
        if (!(sheet.count > 0)) return {};
        const double radius = std::max(mLeast, kSettled * mNoise.sigma);
        for (int n = 0; n < kMostMoves; ++n) {
            mGatherer.gather(center, radius, mNoise, mPoints);
            sheet = growSheet(mPoints, sheet, radius, radius, mNoise, mScratch);
            const Vec3d step = heightOver(sheet, Vec3d::Zero(), sheet.axis) * sheet.axis;
            if (!(step.norm() < radius + 3 * mNoise.sigma)) return {};
            center += step;
            sheet = sheet.about(step);
            if (step.norm() < 0.5 * mNoise.sigma) break;
        }
        normal = sheet.axis;
        mGatherer.gatherPoints(center, std::hypot(radius, 5 * mNoise.sigma), mPoints);
        return residualsOf(mPoints, sheet, radius, mNoise);
    }

    /// The residuals of a fit of @a radius about @a center on a sheet whose normal is @a axis.
    NoiseSums residualsAt(const Vec3d& center, const Vec3d& axis, double radius,
                          const PointNoise& noise)
    {
        mGatherer.gather(center, radius, noise, mPoints);
        const Sheet seed = planeSheet(Vec3d::Zero(), axis);
        Sheet sheet = growSheet(mPoints, seed, kStart * radius, radius, noise, mScratch);
        sheet = overFeet(sheet, radius, noise, mScratch);
        mGatherer.gatherPoints(center, std::hypot(radius, 5 * noise.sigma), mPoints);
        return residualsOf(mPoints, sheet, radius / 2, noise);
    }

    /// The risks of fits about @a center on a sheet whose normal is @a axis.
    Risk climb(const Vec3d& center, const Vec3d& axis, const PointNoise& noise)
    {
        mNoise = noise;
        Risk risk;
        mSheets.clear();
        Sheet sheet = planeSheet(Vec3d::Zero(), axis);
        int hopeless = 0;
        for (int k = 0; k < kMostRadii && hopeless < kHopelessSteps; ++k) {
            const double radius = radiusOf(k);
            mGatherer.gather(center, radius, mNoise, mPoints);
            sheet = growSheet(mPoints, sheet, radius, radius, mNoise, mScratch);
            mSheets.push_back(sheet);
            const double variance = varianceOf(k, radius, axis);
            const double bias2 = biasOf(k, radius, axis);
            risk.bias2[std::size_t(k)] = float(bias2);
            risk.variance[std::size_t(k)] = float(variance);
            risk.steps = k + 1;
            hopeless = bias2 > kHopeless * variance && radius > kJudgedFrom * noise.sigma
                           ? hopeless + 1
                           : 0;
        }
        return risk;
    }

    double radiusOf(int k) const { return mLeast * std::pow(kRatio, k); }

private:
    Sheet seedAt(const Vec3d& center)
    {
        double reach = 0;
        mGatherer.gatherPoints(center, 2 * mLeast, mPoints);
        mTaken.assign(mPoints.count, 0);
        return seedSheet(mPoints, mTaken, mNoise, reach);
    }

    static Vec3d place(std::size_t n, double radius, const Vec3d& axis)
    {
        if (n == 0) return Vec3d::Zero();
        const Frame frame(axis);
        return (n % 2 ? 1 : -1) * kTestPlace * radius * (n < 3 ? frame.u : frame.v);
    }

    /// Mean variance of the fit @a k over the test places.
    double varianceOf(int k, double radius, const Vec3d& axis) const
    {
        const Sheet& sheet = mSheets[std::size_t(k)];
        double variance = 0;
        for (std::size_t n = 0; n < kTests; ++n) variance += sheet.variance(place(n, radius, axis));
        return variance / kTests;
    }

    /// Squared bias of the fit @a k: the mean squared difference from smaller fits beyond that of
    /// their variances [derived: a nested fit's difference has the difference of variances], per
    /// share of the bias that a smaller fit is without [derived: it grows as the radius to the
    /// fourth].
    double biasOf(int k, double radius, const Vec3d& axis) const
    {
        double total = 0;
        int compared = 0;
        for (int j = std::max(k - 3, 0); j <= k - 2; ++j, ++compared) {
            const Sheet &a = mSheets[std::size_t(k)], &b = mSheets[std::size_t(j)];
            double difference2 = 0, excess = 0;
            for (std::size_t n = 0; n < kTests; ++n) {
                const Vec3d at = place(n, radius, axis);
                const double d = heightOver(a, at, axis) - heightOver(b, at, axis);
                difference2 += d * d;
                excess += std::max(b.variance(at) - a.variance(at), 0.0);
            }
            const double sigma2 = mNoise.sigma * mNoise.sigma,
                         share = 1 - std::pow(kRatio, -4 * (k - j));
            total += (difference2 / sigma2 - excess) / kTests / (share * share);
        }
        return compared ? total / compared : 0;
    }

    PointGatherer& mGatherer;
    PointNoise mNoise;
    double mLeast;
    std::vector<Sheet> mSheets;
    CellPoints mPoints, mScratch;
    std::vector<std::uint8_t> mTaken;
};

/// Average the step @a k of the probes @a around, by their weights: the variance by the mean, the
/// bias, of which some probes have a wrong one, by the median; those without a fit so large have a
/// large one. @return whether most have one.
bool averageStep(const std::vector<std::pair<const Risk*, double>>& around, std::size_t k,
                 std::array<double, kMostRadii>& bias2, std::array<double, kMostRadii>& variance)
{
    std::vector<std::pair<float, double>> biases;
    double total = 0, fitted = 0;
    for (const auto& [risk, weight] : around) {
        const bool isFitted = k < std::size_t(risk->steps);
        biases.emplace_back(isFitted ? risk->bias2[k] : std::numeric_limits<float>::infinity(),
                            weight);
        total += weight;
        fitted += isFitted ? weight : 0;
        variance[k] += isFitted ? weight * double(risk->variance[k]) : 0;
    }
    if (!(fitted > 0)) return false;
    variance[k] /= fitted;
    std::sort(biases.begin(), biases.end());
    double below = 0;
    for (const auto& [bias, weight] : biases) {
        bias2[k] = double(bias);
        if ((below += weight) >= total / 2) break;
    }
    return std::isfinite(bias2[k]);
}

/// Make the first @a steps biases grow with the radius, as they do, by moving them as little as may
/// be: isotonic regression, by pools of adjacent violators [Barlow72]. An estimate scatters as its
/// variance.
void makeMonotone(std::array<double, kMostRadii>& bias2,
                  const std::array<double, kMostRadii>& variance, int steps)
{
    struct Pool {
        double weight, sum;
        int count;
        double mean() const { return sum / weight; }
    };
    std::vector<Pool> pools;
    for (int k = 0; k < steps; ++k) {
        const double weight = 1 / std::pow(std::max(variance[std::size_t(k)], 1e-12), 2);
        pools.push_back({weight, weight * bias2[std::size_t(k)], 1});
        while (pools.size() > 1 && pools[pools.size() - 2].mean() >= pools.back().mean()) {
            const Pool last = pools.back();
            pools.pop_back();
            pools.back().weight += last.weight;
            pools.back().sum += last.sum;
            pools.back().count += last.count;
        }
    }
    int k = 0;
    for (const Pool& pool : pools)
        for (int n = 0; n < pool.count; ++n) bias2[std::size_t(k++)] = std::max(pool.mean(), 0.0);
}

/// The step of least risk, between steps by the parabola through its neighbors.
double bestStep(std::array<double, kMostRadii>& bias2,
                const std::array<double, kMostRadii>& variance, int steps)
{
    makeMonotone(bias2, variance, steps);
    const auto risk = [&](int k) { return bias2[std::size_t(k)] + variance[std::size_t(k)]; };
    int best = 0;
    for (int k = 1; k < steps; ++k)
        if (risk(k) < risk(best)) best = k;
    if (best == 0 || best + 1 >= steps) return best;
    const double bend = risk(best - 1) - 2 * risk(best) + risk(best + 1);
    return bend > 0 ? best + 0.5 * (risk(best - 1) - risk(best + 1)) / bend : best;
}

} // namespace

void PointGatherer::gatherFrom(const SortedPoints& points, const Vec3d& center, double radius,
                               CellPoints& out)
{
    // The smallest cell about the place stands for it.
    const OctreeCell at = mRoot.cellAt(center, SortedPoints::kMaxLevel);
    const double slack = 2 * mRoot.size(SortedPoints::kMaxLevel);
    points.gather(points.around(at, radius + slack), 1, mFilter, mBatch);
    out.assign(mBatch, center, radius);
}

void PointGatherer::gather(const Vec3d& center, double radius, const PointNoise& noise,
                           CellPoints& out)
{
    gatherFrom(mPyramid.of(radius / kMeansPerRadius), center, radius + 3 * noise.sigma, out);
}

void PointGatherer::gatherPoints(const Vec3d& center, double radius, CellPoints& out)
{
    gatherFrom(mPyramid.points(), center, radius, out);
}

namespace
{

/// What one thread measures probes with.
struct Scratch {
    PointGatherer gatherer;
    Ladder ladder;
    Scratch(const MeanPyramid& pyramid, const RootCube& root, double least)
        : gatherer(pyramid, root), ladder(gatherer, least)
    {
    }
};

} // namespace

RadiusMap::RadiusMap(const MeanPyramid& pyramid, const RootCube& root, const PointNoise& noise,
                     double spacing, Interrupter& progress)
    : mRoot(root), mNoise(noise)
{
    placeProbes(pyramid.points());
    const double least = std::max(kLeastSpacings * spacing, kLeastNoises * noise.sigma);
    tbb::enumerable_thread_specific<std::unique_ptr<Scratch>> scratch(
        [&] { return std::make_unique<Scratch>(pyramid, root, least); });
    std::vector<NoiseSums> residuals(mProbes.size());
    std::vector<Risk> risks(mProbes.size());
    const auto forEachProbe = [&](const auto& f) {
        tbb::parallel_for(std::size_t(0), mProbes.size(), [&](std::size_t n) {
            progress.check();
            f(n, mProbes[n], scratch.local()->ladder);
        });
    };
    forEachProbe([&](std::size_t n, Probe& probe, Ladder& ladder) {
        residuals[n] = ladder.settle(probe.place, probe.normal, noise);
    });
    measureSigma(residuals);
    forEachProbe([&](std::size_t n, Probe& probe, Ladder& ladder) {
        if (residuals[n].n > 0) risks[n] = ladder.climb(probe.place, probe.normal, noiseOf(probe));
    });
    forEachProbe([&](std::size_t n, Probe& probe, Ladder&) {
        probe.logRadius = std::log(least) + stepAt(n, risks) * std::log(kRatio);
    });
    forEachProbe([&](std::size_t n, Probe& probe, Ladder& ladder) {
        if (risks[n].steps > 0)
            residuals[n] = ladder.residualsAt(probe.place, probe.normal, std::exp(probe.logRadius),
                                              noiseOf(probe));
    });
    measureTangential(residuals);
    mSettled = std::move(mProbes);
}

RadiusMap::RadiusMap(const ArrayFile& file, const RootCube& root)
    : mRoot(root), mNoise(file.value<PointNoise>("noise")),
      mLevel(file.value<std::int32_t>("probe level")), mSettled(file.get<Probe>("probes"))
{
}

void RadiusMap::save(ArrayFileWriter& file) const
{
    file.addValue("noise", mNoise);
    file.addValue("probe level", std::int32_t(mLevel));
    file.add("probes", mSettled);
}

/// Put a probe at the mean of the points of each cell that holds about as many as a probe takes.
void RadiusMap::placeProbes(const SortedPoints& points)
{
    mLevel = points.levelOfCells(kProbePoints);
    points.forEachCell(mLevel, [&](std::size_t begin, std::size_t end) {
        const PointArrays& p = points.points();
        Vec3d sum = Vec3d::Zero();
        for (std::size_t n = begin; n < end; ++n) sum += Vec3d(p.x[n], p.y[n], p.z[n]);
        mProbes.push_back({points.keyOf(begin) >> 3 * (SortedPoints::kMaxLevel - mLevel),
                           sum / double(end - begin)});
    });
}

/// The step of least risk at probe @a n, by the probes of its sheet around it.
double RadiusMap::stepAt(std::size_t n, const std::vector<Risk>& risks) const
{
    std::vector<std::pair<const Risk*, double>> around;
    const double window = kWindow * mRoot.size(mLevel);
    forEachNear(mProbes[n].place, [&](const Probe& near) {
        const double t = (near.place - mProbes[n].place).norm() / window;
        const Risk& risk = risks[std::size_t(&near - mProbes.data())];
        const double alike = likeness(near, mProbes[n]);
        if (t < 1 && risk.steps > 0 && alike > 0)
            around.emplace_back(&risk, alike * (1 - t * t) * (1 - t * t));
    });
    std::array<double, kMostRadii> bias2{}, variance{};
    int steps = 0;
    while (steps < kMostRadii && averageStep(around, std::size_t(steps), bias2, variance)) ++steps;
    return bestStep(bias2, variance, steps);
}

/// Set the noise of each probe to what the residuals around it say.
void RadiusMap::measureSigma(const std::vector<NoiseSums>& residuals)
{
    const double window = kWindow * mRoot.size(mLevel);
    tbb::parallel_for(std::size_t(0), mProbes.size(), [&](std::size_t n) {
        std::vector<std::pair<double, double>> around;
        double total = 0;
        forEachNear(mProbes[n].place, [&](const Probe& near) {
            const NoiseSums& sums = residuals[std::size_t(&near - mProbes.data())];
            if (!((near.place - mProbes[n].place).norm() < window) ||
                !(sums.count > 2 * sums.unknowns))
                return;
            around.emplace_back(sums.squares / (sums.count - sums.unknowns), sums.count);
            total += sums.count;
        });
        std::sort(around.begin(), around.end());
        double below = 0, variance = mNoise.sigma * mNoise.sigma;
        for (const auto& [square, count] : around) {
            variance = square;
            if ((below += count) >= total / 2) break;
        }
        mProbes[n].logSigma =
            std::clamp(std::log(variance) / 2, std::log(mNoise.sigma) - kMostSigmas,
                       std::log(mNoise.sigma) + kMostSigmas);
    });
}

/// Set the noise of normals and along the surface to what the residuals say.
void RadiusMap::measureTangential(const std::vector<NoiseSums>& residuals)
{
    NoiseSums all;
    for (const NoiseSums& sums : residuals) all += sums;
    const double spread = all.n * all.xx - all.x * all.x;
    if (mNoise.lever > 0 && spread > 0) {
        // Squared turns are those of normals' noise and those by which tangential noise moves
        // points to other normals.
        const double sigma2 = mNoise.sigma * mNoise.sigma;
        const double tangential2 =
            std::clamp((all.n * all.xy - all.x * all.y) / spread, 0.0, sigma2);
        const double turn2 = (all.y - tangential2 * all.x) / all.n / 2;
        mNoise.tangential = std::sqrt(tangential2);
        mNoise.tau = std::clamp(std::sqrt(std::max(turn2, 0.0)), kMinNormalNoise, mNoise.tau);
        mNoise.lever = mNoise.sigma / mNoise.tau;
    }
}

PointNoise RadiusMap::noiseOf(const Probe& probe) const
{
    PointNoise noise = mNoise;
    const double ratio = std::exp(probe.logSigma) / mNoise.sigma;
    noise.sigma *= ratio, noise.lever *= ratio, noise.tangential *= ratio;
    return noise;
}

PointNoise RadiusMap::noiseAt(const Vec3d& place) const
{
    Probe probe{};
    const auto sigma = average(place, &Probe::logSigma, [](const Probe&) { return 1.0; });
    probe.logSigma = std::log(sigma.value_or(mNoise.sigma));
    return noiseOf(probe);
}

template <typename F>
void RadiusMap::forEachNear(const Vec3d& place, const F& f) const
{
    const OctreeCell cell = mRoot.cellAt(place, mLevel);
    const auto last = std::int64_t((std::uint64_t(1) << mLevel) - 1);
    const Probe *const begin = mProbes.empty() ? mSettled.begin() : mProbes.data(),
                       *const end = mProbes.empty() ? mSettled.end() : begin + mProbes.size();
    for (int dk = -1; dk <= 1; ++dk)
        for (int dj = -1; dj <= 1; ++dj)
            for (int di = -1; di <= 1; ++di) {
                const std::int64_t i = std::int64_t(cell.i) + di, j = std::int64_t(cell.j) + dj,
                                   k = std::int64_t(cell.k) + dk;
                if (std::min({i, j, k}) < 0 || std::max({i, j, k}) > last) continue;
                const std::uint64_t key =
                    mortonKey(std::uint64_t(i), std::uint64_t(j), std::uint64_t(k));
                const Probe* const probe =
                    std::lower_bound(begin, end, key, [](const Probe& p, std::uint64_t than) {
                        return p.key < than;
                    });
                if (probe != end && probe->key == key) f(*probe);
            }
}

double RadiusMap::likeness(const Probe& a, const Probe& b)
{
    const double alike = std::pow(std::max(a.normal.dot(b.normal), 0.0), 4);
    const Vec3d apart = b.place - a.place;
    const double off = std::max(std::abs(apart.dot(a.normal)), std::abs(apart.dot(b.normal)));
    return alike * std::max(1 - 4 * off * off / std::max(apart.squaredNorm(), 1e-300), 0.0);
}

template <typename WeightOf>
std::optional<double> RadiusMap::average(const Vec3d& place, double Probe::*log,
                                         const WeightOf& weightOf) const
{
    double total = 0, sum = 0;
    const double reach = kWindow * mRoot.size(mLevel);
    forEachNear(place, [&](const Probe& near) {
        const double weight =
            std::max(1 - (near.place - place).norm() / reach, 1e-6) * weightOf(near);
        total += weight;
        sum += weight * near.*log;
    });
    if (!(total > 0)) return std::nullopt;
    return std::exp(sum / total);
}

std::optional<double> RadiusMap::at(const Vec3d& place) const
{
    return average(place, &Probe::logRadius, [](const Probe&) { return 1.0; });
}

std::optional<double> RadiusMap::at(const Vec3d& place, const Vec3d& normal) const
{
    const auto same = average(place, &Probe::logRadius, [&](const Probe& near) {
        return std::pow(std::max(near.normal.dot(normal), 0.0), 4);
    });
    return same ? same : at(place);
}

} // namespace mpuvdb
