#include "particle_spacing.h"

#include "core/parallel_each.h"
#include "core/quantile.h"
#include "points/chosen_neighbors.h"
#include "spatial/point_index.h"

#include <mpuvdb/error.h>

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

/// The spacing at a particle with @a near others, by distance: the ball that ends midway between
/// the last of them and the next one holds as many cells, and its own.
double spacingAmong(const std::vector<PointIndex::Near>& near, std::size_t inBall)
{
    const double radius =
        (std::sqrt(near[inBall].squared) + std::sqrt(near[inBall + 1].squared)) / 2;
    return std::cbrt(4 * M_PI / 3 * std::pow(radius, 3) / double(inBall + 1));
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
            spacings[n] = spacingAmong(near, near.size() - 2);
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
