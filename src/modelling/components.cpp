// Connected parts of a solid, separated and joined again.
#include "solid_measures.h"
#include "solid_parts.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

ComponentMeasures measuresOf(const LevelSet& levelSet, Interrupter& progress)
{
    const SurfaceIntegrals sums = integrateSurface(measurable(levelSet, progress), progress);
    return {sums.volume, sums.area, sums.bounds, sums.genus()};
}

/// The parts' indices, largest first; equal ones in order.
std::vector<std::uint32_t> byVolume(const std::vector<ComponentMeasures>& parts)
{
    std::vector<std::uint32_t> order(parts.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
        return parts[a].volume > parts[b].volume;
    });
    return order;
}

/// Calls @a work isolated from other exceptions' cancellation: OpenVDB frees a tree's nodes in
/// parallel loops, which do nothing within a canceled loop, and the nodes would leak.
template <typename Work>
void uncanceled(const Work& work)
{
    tbb::task_group_context alone(tbb::task_group_context::isolated);
    tbb::task_group(alone).run_and_wait(work);
}

/// Calls @a give with each part's number, level set and measures, in any order.
template <typename Give>
void forEachPart(const SolidParts& parts, Interrupter& progress, const Give& give)
{
    tbb::parallel_for(std::size_t(0), parts.parts().size(), [&](std::size_t n) {
        progress.check();
        uncanceled([&] {
            LevelSet alone = parts.extract({std::uint32_t(n)}, progress);
            const ComponentMeasures measures = measuresOf(alone, progress);
            give(n, std::move(alone), measures);
        });
    });
}

} // namespace

SolidComponents::SolidComponents(const LevelSet& levelSet, Interrupter* interrupter)
    : mLevelSet(levelSet),
      mParts(std::make_shared<const SolidParts>(levelSet, orSilent(interrupter)))
{
    Interrupter& progress = orSilent(interrupter);
    std::vector<ComponentMeasures> found(mParts->parts().size());
    forEachPart(*mParts, progress,
                [&](std::size_t n, const LevelSet&, const ComponentMeasures& m) { found[n] = m; });
    mOrder = byVolume(found);
    for (const std::uint32_t n : mOrder) mMeasures.push_back(found[n]);
}

LevelSet SolidComponents::keep(double minVolume, std::size_t count, Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    if (!(minVolume >= 0))
        throw UsageError(fmt::format("components: the least volume is {}; it must be 0 or more "
                                     "cubic world units",
                                     minVolume));
    std::size_t kept = 0;
    while (kept < std::min(count, mMeasures.size()) && mMeasures[kept].volume >= minVolume) ++kept;
    if (kept == mMeasures.size()) return mLevelSet;
    return mParts->extract({mOrder.begin(), mOrder.begin() + std::ptrdiff_t(kept)}, progress);
}

std::vector<SolidComponent> components(const LevelSet& levelSet, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const SolidParts parts(levelSet, progress);
    std::vector<ComponentMeasures> measures(parts.parts().size());
    std::vector<LevelSet> alone(measures.size(), levelSet);
    forEachPart(parts, progress, [&](std::size_t n, LevelSet part, const ComponentMeasures& m) {
        alone[n] = std::move(part);
        measures[n] = m;
    });
    std::vector<SolidComponent> sorted;
    for (const std::uint32_t n : byVolume(measures)) sorted.push_back({measures[n], alone[n]});
    return sorted;
}

LevelSet keepComponents(const LevelSet& levelSet, double minVolume, std::size_t count,
                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    return SolidComponents(levelSet, &progress).keep(minVolume, count, &progress);
}

} // namespace mpuvdb
