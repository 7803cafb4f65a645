// Spacing and noise of a cloud.
#include "chosen_neighbors.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <Eigen/Dense>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kSamples = 2000;
constexpr std::size_t kSpacingNeighbors = 12;
constexpr int kUnknowns = 6; // of a bivariate quadratic

double quantile(std::vector<double> values, double share)
{
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

/// A disc that holds j neighbours has an area of j cells, each a spacing squared.
double spacingAt(const Neighborhood& n)
{
    const std::size_t j = std::min(kSpacingNeighbors, n.neighbors.size());
    const double distance = (n.neighbors[j - 1].cast<double>() - n.center.cast<double>()).norm();
    return std::sqrt(M_PI / double(j)) * distance;
}

/// Standard deviation of a neighborhood's heights about a quadratic over its own principal plane,
/// corrected for the quadratic's freedom.
double residualAt(const Neighborhood& n, std::size_t k)
{
    const auto count = Eigen::Index(std::min(k, n.neighbors.size()));
    Eigen::Matrix3Xd p(3, count + 1);
    p.col(0).setZero();
    for (Eigen::Index i = 0; i < count; ++i)
        p.col(i + 1) = n.neighbors[i].cast<double>() - n.center.cast<double>();
    const double radius = p.col(count).norm();
    p /= radius;
    p.colwise() -= Vec3d(p.rowwise().mean());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(p * p.transpose());
    p = axes.eigenvectors().transpose() * p; // x: the heights
    Eigen::Matrix<double, Eigen::Dynamic, kUnknowns> a(count + 1, kUnknowns);
    const Eigen::ArrayXd u = p.row(1), v = p.row(2);
    a << Eigen::ArrayXd::Ones(count + 1), u, v, u * u, u * v, v * v;
    const Eigen::VectorXd heights = p.row(0);
    const Eigen::VectorXd fit = a.colPivHouseholderQr().solve(heights);
    const double squares = (heights - a * fit).squaredNorm();
    return radius * std::sqrt(squares / double(count + 1 - kUnknowns));
}

/// The lower quartile of the residuals, scaled to the standard deviation that it stands for. Edges,
/// outliers and second sheets only add to residuals: they can spoil three quarters of the samples.
double robustNoise(const std::vector<Neighborhood>& neighborhoods, std::size_t k,
                   Progress& progress)
{
    std::vector<double> residuals(neighborhoods.size());
    tbb::parallel_for(std::size_t(0), residuals.size(), [&](std::size_t i) {
        progress.check();
        residuals[i] = residualAt(neighborhoods[i], k);
    });
    // Quartile of chi-square over its freedom [Wilson31].
    constexpr double kQuartile = 0.25, kNormalQuartile = -0.6745;
    const double spread = 2 / (9 * double(k + 1 - kUnknowns));
    const double expected = std::pow(1 - spread + kNormalQuartile * std::sqrt(spread), 1.5);
    return quantile(std::move(residuals), kQuartile) / expected;
}

double medianReach(const std::vector<Neighborhood>& neighborhoods)
{
    std::vector<double> reach;
    for (const Neighborhood& n : neighborhoods)
        reach.push_back((n.neighbors.back() - n.center).cast<double>().norm());
    return quantile(std::move(reach), 0.5);
}

} // namespace

PointStatistics measure(const PointCloud& cloud, Progress& progress)
{
    const std::vector<Vec3f> chosen = choosePositions(cloud.positions, kSamples, progress);
    if (chosen.size() < 2)
        throw InputError("the points have fewer than two distinct positions: nothing can be "
                         "measured. Give points on a surface");
    // More neighbours, until the noise is thin against the ball that they fill: a ball that lies
    // within the noise shows its own size instead.
    constexpr std::size_t kFewest = 40, kMost = 640, kFactor = 4;
    constexpr double kThin = 0.18;
    PointStatistics result;
    for (std::size_t k = kFewest; k <= kMost; k *= kFactor) {
        const auto neighborhoods = nearestOfChosen(cloud.positions, chosen, k, progress);
        const std::size_t found = neighborhoods.front().neighbors.size();
        if (k == kFewest) {
            std::vector<double> spacings;
            for (const Neighborhood& n : neighborhoods) spacings.push_back(spacingAt(n));
            result.spacing = quantile(std::move(spacings), 0.5);
        }
        if (found < 2 * kUnknowns) break; // too few to tell noise from shape
        result.noise = robustNoise(neighborhoods, std::min(k, found), progress);
        if (found < k || result.noise < kThin * medianReach(neighborhoods)) break;
    }
    return result;
}

} // namespace mpuvdb
