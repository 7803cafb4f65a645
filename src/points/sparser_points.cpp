#include "sparser_points.h"

#include "kd_tree.h"
#include "local_plane.h"
#include "parallel_each.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kNeighbors = 16;
constexpr std::size_t kReach = 6; // neighbours within it
constexpr float kSparser = 2.5;   // times as far apart as the closest quarter of the neighbours
constexpr std::size_t kGrain = 256;

} // namespace

bool liesFlat(const std::vector<Vec3f>& positions, std::size_t point,
              const std::vector<std::uint32_t>& neighbors, double reach)
{
    // Of ten points at random in a ball, one in a few hundred sets is as flat as this.
    constexpr double kFlat = 0.3, kOffScatter = 3, kOffReach = 0.25;
    const LocalPlane plane = planeOf(positions, neighbors);
    const double height = std::abs(plane.height(positions[point]));
    const double scatter = std::sqrt(plane.variances[0]);
    return scatter < kFlat * std::sqrt((plane.variances[1] + plane.variances[2]) / 2) &&
           height < std::max(kOffScatter * scatter, kOffReach * reach);
}

std::vector<char> findSparserPoints(const std::vector<Vec3f>& positions, Progress& progress)
{
    std::vector<char> found(positions.size(), 0);
    if (positions.size() <= kNeighbors) return found;
    const KdTree tree(positions);
    std::vector<std::uint32_t> neighbors(positions.size() * kNeighbors);
    std::vector<float> reach(positions.size());
    forEachParallel(positions.size(), kGrain, progress, [&](std::size_t i) {
        std::vector<std::uint32_t> indices(kNeighbors + 1);
        std::vector<float> squared(indices.size());
        tree.nearest(positions[i], indices, squared);
        // Itself, or a copy, is the first.
        std::copy_n(indices.begin() + 1, kNeighbors, &neighbors[i * kNeighbors]);
        reach[i] = std::sqrt(squared[kReach]);
    });
    forEachParallel(positions.size(), kGrain, progress, [&](std::size_t i) {
        const std::uint32_t* const near = &neighbors[i * kNeighbors];
        std::array<float, kNeighbors> reaches;
        for (std::size_t k = 0; k < kNeighbors; ++k) reaches[k] = reach[near[k]];
        const auto quarter = reaches.begin() + kNeighbors / 4;
        std::nth_element(reaches.begin(), quarter, reaches.end());
        if (reach[i] < kSparser * *quarter) return;
        // Those that are like it: what it would be a surface with.
        std::vector<std::uint32_t> like;
        for (std::size_t k = 0; k < kNeighbors; ++k)
            if (reach[i] < kSparser * reach[near[k]]) like.push_back(near[k]);
        constexpr std::size_t kFew = 5;
        found[i] = like.size() < kFew || !liesFlat(positions, i, like, reach[i]);
    });
    return found;
}

} // namespace mpuvdb
