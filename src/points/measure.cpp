// Spacing and noise of a cloud.
#include "chosen_neighbors.h"
#include "core/parallel_each.h"
#include "indexed.h"
#include "least_squares.h"
#include "spatial/position_order.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <Eigen/Dense>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The number of points that are compared with their neighbors. [derived: it knows a median to a
/// twentieth of the values' standard deviation]
constexpr std::size_t kSamples = 1000;
constexpr std::size_t kSpacingNeighbors = 12; // [tuned: noise_test]
constexpr std::size_t kUnknowns = 6;          // [derived: of a bivariate quadratic]

double quantile(std::vector<double> values, double share)
{
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

/// A disc that holds j neighbors has an area of j cells, each a spacing squared.
double spacingAt(const Neighborhood& n)
{
    const std::size_t j = std::min(kSpacingNeighbors, n.neighbors.size());
    return std::sqrt(M_PI / double(j) * n.neighbors[j - 1].squaredDistance);
}

/// Neighbors that lie on one sheet, about the point they are the neighbors of.
struct Sheet {
    Eigen::Matrix3Xd positions, normals; // the first is the center's; the last the farthest
    double radius = 0;
};

/// The center and its neighbors within the first @a k whose normals, if there are any, do not turn
/// away from the center's.
Sheet sheetOf(const Neighborhood& n, std::size_t k)
{
    Sheet sheet;
    const std::size_t most = std::min(k, n.neighbors.size());
    sheet.positions.resize(3, Eigen::Index(most + 1));
    sheet.normals.resize(3, Eigen::Index(most + 1));
    Eigen::Index count = 0;
    const auto add = [&](const Vec3f& position, const Vec3f& normal) {
        sheet.positions.col(count) = (position - n.center).cast<double>();
        sheet.normals.col(count++) = normal.cast<double>();
    };
    add(n.center, n.normal);
    for (std::size_t i = 0; i < most; ++i)
        if (!(n.neighbors[i].normal.dot(n.normal) < 0))
            add(n.neighbors[i].position, n.neighbors[i].normal);
    sheet.positions.conservativeResize(3, count);
    sheet.normals.conservativeResize(3, count);
    sheet.radius = sheet.positions.col(count - 1).norm();
    return sheet;
}

/// What of a sheet is left unexplained, and how many degrees of freedom that has.
struct Residual {
    double deviation;
    std::size_t freedom;
};

/// Coordinates of a sheet along its principal axes, in its radii; the first row is the heights.
Eigen::Matrix3Xd alongAxes(const Sheet& sheet)
{
    Eigen::Matrix3Xd p = sheet.positions / sheet.radius;
    p.colwise() -= Vec3d(p.rowwise().mean());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(p * p.transpose());
    return axes.eigenvectors().transpose() * p;
}

/// The columns of @a p, in radii along its axes, that the ball does not leave short of the far ones
/// along the first axis; all if they are few.
Eigen::Matrix3Xd withinCylinder(const Eigen::Matrix3Xd& p)
{
    constexpr double kAcross = 0.8; // of the radius; [tuned: noise_test]
    // The fewest points of which a part is enough. [tuned: noise_test]
    constexpr Eigen::Index kFew = 60;
    if (p.cols() < kFew) return p;
    Eigen::Matrix3Xd within(3, p.cols());
    Eigen::Index count = 0;
    for (Eigen::Index i = 0; i < p.cols(); ++i)
        if (p.col(i).tail<2>().squaredNorm() < kAcross * kAcross) within.col(count++) = p.col(i);
    return count > 2 * Eigen::Index(kUnknowns) ? Eigen::Matrix3Xd(within.leftCols(count)) : p;
}

/// Standard deviation of the heights about a quadratic over the sheet's principal plane.
Residual heightResidual(const Sheet& sheet)
{
    const Eigen::Matrix3Xd p = withinCylinder(alongAxes(sheet));
    const Eigen::Index count = p.cols();
    Eigen::Matrix<double, Eigen::Dynamic, int(kUnknowns)> a(count, Eigen::Index(kUnknowns));
    const Eigen::ArrayXd u = p.row(1), v = p.row(2);
    a << Eigen::ArrayXd::Ones(count), u, v, u * u, u * v, v * v;
    const Eigen::VectorXd heights = p.row(0);
    const Eigen::VectorXd fit = leastSquares(a, heights);
    const std::size_t freedom = std::size_t(count) - kUnknowns;
    return {sheet.radius * std::sqrt((heights - a * fit).squaredNorm() / double(freedom)), freedom};
}

/// Standard deviation, radians, of the normals about ones that change linearly over the plane.
Residual normalResidual(const Sheet& sheet)
{
    constexpr Eigen::Index kOfLine = 3; // [derived: coefficients of a linear function of two]
    const Eigen::Matrix3Xd p = alongAxes(sheet);
    Eigen::Matrix<double, Eigen::Dynamic, kOfLine> a(p.cols(), kOfLine);
    a << Eigen::VectorXd::Ones(p.cols()), p.row(1).transpose(), p.row(2).transpose();
    const Eigen::MatrixX3d normals = sheet.normals.transpose();
    const Eigen::MatrixX3d fit = leastSquares(a, normals);
    const auto freedom = std::size_t(2 * (p.cols() - kOfLine)); // lengths do not vary
    return {std::sqrt((normals - a * fit).squaredNorm() / double(freedom)), freedom};
}

/// A quantile, and where the normal distribution has it.
struct Quantile {
    double share, deviations;
};
/// Edges, outliers and second sheets only add to residuals: they can spoil three quarters of them.
constexpr Quantile kLowerQuartile{0.25, -0.6745}, kMedian{0.5, 0};

/// A quantile of a residual of noise whose standard deviation is 1: of chi-square over its
/// freedom [Wilson31].
double expected(const Quantile& of, std::size_t freedom)
{
    const double spread = 2 / (9 * double(freedom));
    return std::pow(1 - spread + of.deviations * std::sqrt(spread), 1.5);
}

/// A quantile of the residuals of sheets of @a k neighbors, scaled to the standard deviation that
/// it stands for. 0 if no sheet has enough points.
double residualAmong(const std::vector<Neighborhood>& neighborhoods, std::size_t k,
                     Residual (*residualOf)(const Sheet&), const Quantile& of,
                     Interrupter& progress)
{
    std::vector<double> noise(neighborhoods.size(), -1);
    tbb::parallel_for(std::size_t(0), noise.size(), [&](std::size_t i) {
        progress.check();
        const Sheet sheet = sheetOf(neighborhoods[i], k);
        if (std::size_t(sheet.positions.cols()) <= 2 * kUnknowns) return;
        const Residual residual = residualOf(sheet);
        noise[i] = residual.deviation / expected(of, residual.freedom);
    });
    noise.erase(std::remove(noise.begin(), noise.end(), -1.0), noise.end());
    return noise.empty() ? 0 : quantile(std::move(noise), of.share);
}

/// Residuals are noise and what the fit lacks of the shape. The latter grows with a power of the
/// radius, and so of k: two sizes separate them.
/// @param growth  of its square where k doubles.
double robustNoise(const std::vector<Neighborhood>& neighborhoods, std::size_t k,
                   Residual (*residualOf)(const Sheet&), double growth, Interrupter& progress)
{
    const double whole = residualAmong(neighborhoods, k, residualOf, kLowerQuartile, progress);
    const double half = residualAmong(neighborhoods, k / 2, residualOf, kLowerQuartile, progress);
    if (!(half > 0)) return whole;
    return std::sqrt(std::max(0.0, (growth * half * half - whole * whole) / (growth - 1)));
}

/// The standard deviation of positions by which points are off the arcs that their normals make
/// with the nearest neighbors': the way from one point of an arc to another is perpendicular to the
/// mean of the normals. Not less than the noise, where the normals know nothing of it.
double arcNoise(const std::vector<Neighborhood>& neighborhoods)
{
    // Neighbors of a point that make arcs with it. [derived: those of a square lattice]
    constexpr std::size_t kNearest = 4;
    std::vector<double> off;
    for (const Neighborhood& n : neighborhoods)
        for (std::size_t i = 0; i < std::min(kNearest, n.neighbors.size()); ++i)
            if (n.neighbors[i].normal.dot(n.normal) > 0)
                off.push_back(std::abs(double((n.neighbors[i].position - n.center)
                                                  .dot(n.neighbors[i].normal + n.normal))) /
                              2);
    if (off.empty()) return std::numeric_limits<double>::max();
    return quantile(std::move(off), 0.5) / (-kLowerQuartile.deviations * std::sqrt(2.0));
}

/// The share of points that have a sheet behind theirs, nearer than spacings or a depth, world
/// units, that looks the opposite way.
double thinShare(const std::vector<Neighborhood>& neighborhoods, double spacings, double depth)
{
    // The cosine of opposite normals. [derived: of two that are both within 30 degrees of a
    // plane's]
    constexpr float kOpposite = -0.5f;
    const auto isThin = [&](const Neighborhood& n) {
        const double spacing = spacingAt(n), near = std::max(spacings * spacing, depth);
        return std::any_of(n.neighbors.begin(), n.neighbors.end(), [&](const Neighbor& other) {
            const Vec3f apart = other.position - n.center;
            const double behind = -double(apart.dot(n.normal));
            const double beside2 = double(apart.squaredNorm()) - behind * behind;
            return other.normal.dot(n.normal) < kOpposite && behind > 0 && behind < near &&
                   beside2 < spacing * spacing;
        });
    };
    const auto thin = std::count_if(neighborhoods.begin(), neighborhoods.end(), isThin);
    return double(thin) / double(neighborhoods.size());
}

double medianReach(const std::vector<Neighborhood>& neighborhoods)
{
    std::vector<double> reach;
    reach.reserve(neighborhoods.size());
    for (const Neighborhood& n : neighborhoods)
        reach.push_back(std::sqrt(n.neighbors.back().squaredDistance));
    return quantile(std::move(reach), 0.5);
}

/// Whether the points lie throughout their neighborhoods, as those of a solid do, and are no
/// sheets: most have residuals as large as they are in a ball that is filled.
bool fillBalls(const std::vector<Neighborhood>& neighborhoods, std::size_t k, Interrupter& progress)
{
    // [derived: points of a ball have a standard deviation of 0.45 of its radius along an axis, in
    // halves, about those at a solid's sides, 0.22; noise that is thin against its balls has less]
    constexpr double kFilled = 0.25;
    return residualAmong(neighborhoods, k, heightResidual, kMedian, progress) >
           kFilled * medianReach(neighborhoods);
}

/// About @a count points, for balls that reach far with few neighbors; a smaller choice of points
/// is among them.
std::shared_ptr<const PointIndex> thinned(const PointIndex& index, std::size_t count,
                                          Interrupter& progress)
{
    constexpr std::size_t kGrain = 1 << 14; // points; [free: the same choice]
    const std::vector<Vec3f> chosen = choosePositions(index, count, progress);
    std::vector<std::uint8_t> keep(index.size());
    forEachParallel(index.size(), kGrain, progress, [&](std::size_t n) {
        keep[index.order()[n]] =
            std::binary_search(chosen.begin(), chosen.end(), index[n], positionBefore);
    });
    return index.kept(keep, progress);
}

} // namespace

PointStatistics measure(const PointCloud& cloud, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    cloud.demandWhole();
    return measure(cloud, *indexOf(cloud, progress), progress);
}

PointStatistics measure(const PointCloud& cloud, const PointIndex& index, Interrupter& progress)
{
    const std::vector<Vec3f> chosen = choosePositions(index, kSamples, progress);
    if (chosen.size() < 2)
        throw InputError("the points have fewer than two distinct positions: nothing can be "
                         "measured. Give points on a surface");
    // More neighbors, then fewer points, until the noise is thin against the ball that they fill:
    // a ball that lies within the noise shows its own size instead. [tuned: noise_test]
    constexpr std::size_t kFewest = 40, kMost = 640, kFactor = 4;
    // The noise in the radii of the balls. [tuned: noise_test]
    constexpr double kThin = 0.22;
    // The part of the points in a ball up to which it says whether they fill a solid. [tuned:
    // explained_test; larger parts are thick for the solid's own shape]
    constexpr std::size_t kOfWhole = 16;
    // The part of the points in a ball from which on their arcs tell the noise, too. [derived: a
    // quadratic is off a quarter of a sphere by an eightieth of its radius]
    constexpr std::size_t kMuch = 4;
    PointStatistics result;
    const PointIndex* among = &index;
    std::shared_ptr<const PointIndex> sparse;
    for (std::size_t k = kFewest;;) {
        const auto neighborhoods = nearestOfChosen(cloud, *among, chosen, k, progress);
        const std::size_t found = neighborhoods.front().neighbors.size();
        if (k == kFewest) {
            std::vector<double> spacings;
            spacings.reserve(neighborhoods.size());
            for (const Neighborhood& n : neighborhoods) spacings.push_back(spacingAt(n));
            double area = 0; // each point has that of its spacing squared
            for (const double spacing : spacings) area += spacing * spacing;
            result.evenSpacing = std::sqrt(area / double(spacings.size()));
            result.spacing = quantile(std::move(spacings), 0.5);
        }
        if (found < 2 * kUnknowns) break; // too few to separate noise from shape
        // What a quadratic lacks is cubic, what a line lacks quadratic.
        const std::size_t used = std::min(k, found);
        result.noise = robustNoise(neighborhoods, used, heightResidual, 8, progress);
        // A quadratic lacks much of the shape in a ball that holds so much of it.
        if (used * kMuch > index.size() && cloud.hasNormals())
            result.noise = std::min(result.noise, arcNoise(neighborhoods));
        if (k == kFewest && cloud.hasNormals()) { // known however thick the noise of the positions
            result.normalNoise = robustNoise(neighborhoods, used, normalResidual, 4, progress);
            // Spacings. [derived: as far as the seven nearest of its own sheet are, which a disc of
            // that radius holds]
            constexpr double kNearSpacings = 1.5;
            // Standard deviations. [derived: each side is a layer of 4; between the two there is no
            // room for a third]
            constexpr double kNearNoises = 8;
            result.thin = thinShare(neighborhoods, kNearSpacings, 0);
            result.thinForNoise =
                thinShare(neighborhoods, kNearSpacings, kNearNoises * result.noise);
        }
        const bool isThin = result.noise < kThin * medianReach(neighborhoods);
        if (found == k && k * kOfWhole <= among->size())
            result.fillSolid = !isThin && fillBalls(neighborhoods, k, progress);
        if (found < k || isThin) break;
        if (k < kMost) {
            k *= kFactor;
        } else {
            if (among->size() < kFactor * kFactor * kMost) break;
            // Of the whole: among those chosen already a choice of fewer would be all of them.
            sparse = thinned(index, among->size() / kFactor, progress);
            among = sparse.get();
        }
    }
    return result;
}

} // namespace mpuvdb
