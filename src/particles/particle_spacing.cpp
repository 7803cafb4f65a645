#include "particle_spacing.h"

#include "core/parallel_each.h"
#include "core/quantile.h"
#include "points/chosen_neighbors.h"
#include "spatial/point_index.h"

#include <mpuvdb/error.h>

#include <Eigen/Eigenvalues>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Particles that are compared with their neighbors. [derived: they know a median to a twentieth
/// of the values' standard deviation]
constexpr std::size_t kSamples = 1000;
/// Neighbors of a particle that lie in the ball by which its spacing is measured. [derived: those
/// in the 27 cells of a grid of cubes, whose corners are nearer than the next ones]
constexpr std::size_t kInBall = 26;

/// Widths of uniform layers, world units, that spread as the first @a count of @a near do along
/// their principal axes, ascending.
Vec3d widthsOf(const PointIndex& index, const std::vector<PointIndex::Near>& near,
               std::size_t count)
{
    Eigen::Matrix3Xd apart(3, Eigen::Index(count));
    for (std::size_t n = 0; n < count; ++n)
        apart.col(Eigen::Index(n)) = (index[near[n].place] - index[near[0].place]).cast<double>();
    apart.colwise() -= Vec3d(apart.rowwise().mean());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(apart * apart.transpose(),
                                                              Eigen::EigenvaluesOnly);
    return (12 / double(count) * axes.eigenvalues()).cwiseMax(0).cwiseSqrt();
}

/// The spacing at a particle with @a near others, by distance: the ball that ends midway between
/// the last of them and the next one holds as many cells, and its own. Where all lie in a layer or
/// a row no wider than a cell, these are squares or pieces of a line.
double spacingAmong(const PointIndex& index, const std::vector<PointIndex::Near>& near,
                    std::size_t inBall)
{
    const double radius =
        (std::sqrt(near[inBall].squared) + std::sqrt(near[inBall + 1].squared)) / 2;
    const auto cells = double(inBall + 1);
    const double cube = std::cbrt(4 * M_PI / 3 * std::pow(radius, 3) / cells),
                 square = radius * std::sqrt(M_PI / cells), piece = 2 * radius / cells;
    const Vec3d widths = widthsOf(index, near, inBall + 1);
    if (widths[0] > cube) return cube;
    return widths[1] > square ? square : piece;
}

} // namespace

double particleSpacing(const std::vector<Vec3f>& positions, Interrupter& progress)
{
    const PointIndex index(positions, progress);
    const std::vector<Vec3f> chosen = choosePositions(index, kSamples, progress);
    std::vector<double> spacings(chosen.size());
    forEachParallel(chosen.size(), 16, progress, [&](std::size_t n) {
        std::vector<PointIndex::Near> near; // the first is the particle itself
        index.nearest(chosen[n], kInBall + 2, near);
        if (near.size() > 2)
            spacings[n] = spacingAmong(index, near, near.size() - 2);
        else if (near.size() == 2)
            spacings[n] = std::sqrt(near[1].squared);
    });
    const double spacing = quantile(spacings, 0.25);
    if (!(spacing > 0))
        throw InputError("particles: they have no radius, and one position says no spacing. Give "
                         "a radius with --radius");
    return spacing;
}

} // namespace mpuvdb
