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

constexpr std::size_t kSamples = 1000;
constexpr std::size_t kSpacingNeighbors = 12;
constexpr std::size_t kUnknowns = 6; // of a bivariate quadratic

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
    return std::sqrt(M_PI / double(j) * n.neighbors[j - 1].squaredDistance);
}

/// The center and its neighbors within the first @a k that lie on the same sheet: their normals, if
/// there are any, do not turn away from the center's.
std::vector<Vec3f> sheetOf(const Neighborhood& n, std::size_t k)
{
    std::vector<Vec3f> sheet = {n.center};
    for (std::size_t i = 0; i < std::min(k, n.neighbors.size()); ++i)
        if (!(n.neighbors[i].normal.dot(n.normal) < 0)) sheet.push_back(n.neighbors[i].position);
    return sheet;
}

/// Standard deviation of a sheet's heights about a quadratic over its own principal plane,
/// corrected for the quadratic's freedom; the last of @a sheet is the farthest from the first.
double residualOf(const std::vector<Vec3f>& sheet)
{
    const auto count = Eigen::Index(sheet.size());
    Eigen::Matrix3Xd p(3, count);
    for (Eigen::Index i = 0; i < count; ++i)
        p.col(i) = (sheet[std::size_t(i)] - sheet.front()).cast<double>();
    const double radius = p.col(count - 1).norm();
    p /= radius;
    p.colwise() -= Vec3d(p.rowwise().mean());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(p * p.transpose());
    p = axes.eigenvectors().transpose() * p; // x: the heights
    Eigen::Matrix<double, Eigen::Dynamic, int(kUnknowns)> a(count, Eigen::Index(kUnknowns));
    const Eigen::ArrayXd u = p.row(1), v = p.row(2);
    a << Eigen::ArrayXd::Ones(count), u, v, u * u, u * v, v * v;
    const Eigen::VectorXd heights = p.row(0);
    const Eigen::VectorXd fit = a.colPivHouseholderQr().solve(heights);
    const double squares = (heights - a * fit).squaredNorm();
    return radius * std::sqrt(squares / double(count - Eigen::Index(kUnknowns)));
}

/// Lower quartile of a residual of @a count points, of noise whose standard deviation is 1: of
/// chi-square over its freedom [Wilson31].
double expectedQuartile(std::size_t count)
{
    constexpr double kNormalQuartile = -0.6745;
    const double spread = 2 / (9 * double(count - kUnknowns));
    return std::pow(1 - spread + kNormalQuartile * std::sqrt(spread), 1.5);
}

/// The lower quartile of the residuals of sheets of @a k neighbors, scaled to the standard
/// deviation that it stands for. Edges, outliers and second sheets only add to residuals: they can
/// spoil three quarters of the samples. 0 if no sheet has enough points.
double residualAmong(const std::vector<Neighborhood>& neighborhoods, std::size_t k,
                     Progress& progress)
{
    std::vector<double> noise(neighborhoods.size(), -1);
    tbb::parallel_for(std::size_t(0), noise.size(), [&](std::size_t i) {
        progress.check();
        const std::vector<Vec3f> sheet = sheetOf(neighborhoods[i], k);
        if (sheet.size() > 2 * kUnknowns)
            noise[i] = residualOf(sheet) / expectedQuartile(sheet.size());
    });
    noise.erase(std::remove(noise.begin(), noise.end(), -1.0), noise.end());
    return noise.empty() ? 0 : quantile(std::move(noise), 0.25);
}

/// Residuals are noise and what a quadratic lacks of the shape. The latter, cubic in the radius,
/// grows with k^(3/2): two sizes tell them apart.
double robustNoise(const std::vector<Neighborhood>& neighborhoods, std::size_t k,
                   Progress& progress)
{
    const double whole = residualAmong(neighborhoods, k, progress);
    const double half = residualAmong(neighborhoods, k / 2, progress);
    if (!(half > 0)) return whole;
    return std::sqrt(std::max(0.0, (8 * half * half - whole * whole) / 7));
}

double medianReach(const std::vector<Neighborhood>& neighborhoods)
{
    std::vector<double> reach;
    reach.reserve(neighborhoods.size());
    for (const Neighborhood& n : neighborhoods)
        reach.push_back(std::sqrt(n.neighbors.back().squaredDistance));
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
        const auto neighborhoods = nearestOfChosen(cloud, chosen, k, progress);
        const std::size_t found = neighborhoods.front().neighbors.size();
        if (k == kFewest) {
            std::vector<double> spacings;
            spacings.reserve(neighborhoods.size());
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
