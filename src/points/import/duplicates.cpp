// Exact copies of points: in the index their positions are one run.
#include "raw_points.h"

#include "core/parallel_each.h"
#include "spatial/point_index.h"
#include "spatial/position_order.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// The order of points at one position by all else that they have: below 0 for @a i before @a j, 0
/// for copies. What is not a number is equal to nothing, and of no order.
int compared(const PointCloud& cloud, std::size_t i, std::size_t j)
{
    const auto order = [](const auto& a, const auto& b) { return int(b < a) - int(a < b); };
    int result = 0;
    const auto compare = [&](const auto& values) {
        if (result == 0 && !values.empty()) result = order(values[i], values[j]);
    };
    if (!cloud.normals.empty() && cloud.normals[i] != cloud.normals[j])
        return positionBefore(cloud.normals[i], cloud.normals[j]) ? -1 : 1;
    compare(cloud.confidence);
    compare(cloud.colors);
    for (const NamedScalars& scalars : cloud.scalars) compare(scalars.values);
    return result;
}

/// Whether a point has values that are not numbers: it is no copy.
bool isUnordered(const PointCloud& cloud, std::size_t i)
{
    return std::any_of(cloud.scalars.begin(), cloud.scalars.end(),
                       [i](const NamedScalars& s) { return s.values[i] != s.values[i]; });
}

} // namespace

std::uint64_t dropDuplicates(PointCloud& cloud, Interrupter& progress)
{
    constexpr std::size_t kGrain = 1 << 14; // points; [free: the same copies]
    cloud.index = std::make_shared<const PointIndex>(cloud.positions, progress);
    const PointIndex& index = *cloud.index;
    std::vector<std::uint8_t> keep(cloud.size(), 1);
    const auto markCopies = [&](std::size_t begin) {
        if (index.isCopy(begin)) return;
        const std::size_t end = index.endOfCopies(begin);
        if (end - begin == 1) return;
        std::vector<std::uint32_t> points;
        std::copy_if(index.order().begin() + std::ptrdiff_t(begin),
                     index.order().begin() + std::ptrdiff_t(end), std::back_inserter(points),
                     [&](std::uint32_t i) { return !isUnordered(cloud, i); });
        std::stable_sort(points.begin(), points.end(), [&](std::uint32_t i, std::uint32_t j) {
            return compared(cloud, i, j) < 0;
        });
        for (std::size_t n = 1; n < points.size(); ++n)
            if (compared(cloud, points[n - 1], points[n]) == 0) keep[points[n]] = 0;
    };
    forEachParallel(index.size(), kGrain, progress, markCopies);
    const auto dropped = std::uint64_t(std::count(keep.begin(), keep.end(), 0));
    if (dropped == 0) return 0;
    std::vector<std::uint32_t> copies;
    for (std::size_t n = 0; n < keep.size(); ++n)
        if (!keep[n]) copies.push_back(std::uint32_t(n));
    const std::shared_ptr<const PointIndex> left = index.without(copies, progress);
    cloud.compact(keep);
    cloud.index = left;
    return dropped;
}

} // namespace mpuvdb
