// Connected parts of a solid, apart and together again.
#include "solid_parts.h"
#include "surface_integrals.h"

#include <mpuvdb/error.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

SurfaceIntegrals integralsOf(const LevelSet& levelSet, Progress& progress)
{
    return integrateSurface(measurable(levelSet, progress), progress);
}

SolidComponent measured(LevelSet levelSet, Progress& progress)
{
    const SurfaceIntegrals sums = integralsOf(levelSet, progress);
    return {std::move(levelSet), sums.volume, sums.area, sums.bounds, sums.genus()};
}

/// Largest first; of equals as they were.
std::vector<std::uint32_t> byVolume(const std::vector<double>& volumes)
{
    std::vector<std::uint32_t> order(volumes.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return volumes[a] > volumes[b]; });
    return order;
}

} // namespace

std::vector<SolidComponent> components(const LevelSet& levelSet, Progress& progress)
{
    const SolidParts parts(levelSet, progress);
    std::vector<SolidComponent> found(parts.parts().size(), {levelSet, 0, 0, {}, 0});
    std::vector<double> volumes(found.size());
    tbb::parallel_for(std::size_t(0), found.size(), [&](std::size_t n) {
        progress.check();
        found[n] = measured(parts.extract({std::uint32_t(n)}, progress), progress);
        volumes[n] = found[n].volume;
    });
    std::vector<SolidComponent> sorted;
    for (const std::uint32_t n : byVolume(volumes)) sorted.push_back(std::move(found[n]));
    return sorted;
}

LevelSet keepComponents(const LevelSet& levelSet, double minVolume, std::size_t count,
                        Progress& progress)
{
    if (!(minVolume >= 0))
        throw UsageError(fmt::format("components: the least volume is {}; it must be 0 or more "
                                     "cubic world units",
                                     minVolume));
    const SolidParts parts(levelSet, progress);
    std::vector<double> volumes(parts.parts().size());
    tbb::parallel_for(std::size_t(0), volumes.size(), [&](std::size_t n) {
        progress.check();
        volumes[n] = integralsOf(parts.extract({std::uint32_t(n)}, progress), progress).volume;
    });
    std::vector<std::uint32_t> kept;
    for (const std::uint32_t n : byVolume(volumes))
        if (volumes[n] >= minVolume && kept.size() < count) kept.push_back(n);
    return kept.size() == volumes.size() ? levelSet : parts.extract(kept, progress);
}

} // namespace mpuvdb
