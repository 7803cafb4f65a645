// Bands of which only a zone is sampled.
#include "band.h"

#include "core/parallel_each.h"
#include "field/near_zero.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <unordered_set>
#include <utility>

namespace mpuvdb
{

/// Add to @a found the blocks without data among the @a count blocks along each axis from @a first
/// on, as far as they are in the zone, that the band may have.
void Band::findUnsupported(const Vec3i& first, int count, BlockSampler& sampler,
                           std::vector<Vec3i>& found) const
{
    const BlockBox& box = mZone->known;
    if ((first.array() > box.last.array()).any()) return;
    if (count == 1 && find(first)) return;
    const int edge = kBlockDim * count;
    const Vec3d middle = (first * kBlockDim).cast<double>().array() + 0.5 * (edge - 1);
    const double h = mLattice.voxelSize;
    const FieldSample there = mField.evaluate(mLattice.origin + h * middle);
    if (!mayComeNear(there, (edge - 1) * h, double(mBackground))) return;
    if (count > 1) {
        for (int octant = 0; octant < 8; ++octant)
            findUnsupported(first + count / 2 * Vec3i(octant & 1, octant >> 1 & 1, octant >> 2),
                            count / 2, sampler, found);
        return;
    }
    // Where data support the surface, the band has been found from the data in the zone.
    if (there.supported) return;
    const Block block = sample(sampler, first);
    if (block.leaf && !block.leaf->getValueMask().isOff()) found.push_back(first);
}

void Band::searchUnsupported()
{
    constexpr double kMostCubes = 1 << 15; // of the largest edge; [free: grain]
    const BlockBox& box = mZone->known;
    int edge = 4; // blocks
    Vec3i cubes;
    do {
        edge *= 2;
        cubes = (box.last - box.first) / edge + Vec3i::Ones();
    } while (cubes.cast<double>().prod() > kMostCubes);
    tbb::enumerable_thread_specific<std::unique_ptr<BlockSampler>> samplers(
        [&] { return mField.sampler(mLattice, double(mBackground)); });
    std::vector<std::vector<Vec3i>> found(std::size_t(cubes.prod()));
    forEachParallel(found.size(), 1, mProgress, [&](std::size_t n) {
        const Vec3i cube(int(n) % cubes[0], int(n) / cubes[0] % cubes[1],
                         int(n) / (cubes[0] * cubes[1]));
        findUnsupported(box.first + edge * cube, edge, *samplers.local(), found[n]);
    });
    std::vector<Vec3i> blocks;
    for (const auto& some : found) blocks.insert(blocks.end(), some.begin(), some.end());
    const std::size_t known = mBlocks.size();
    search(std::move(blocks));
    dropUnreached(known);
}

/// Drop blocks from number @a known on that the whole's band does not have, as nothing leads from
/// data to them: what the data in the zone lead to is known, and the rest is followed beyond it.
void Band::dropUnreached(std::size_t known)
{
    enum class Lead : std::uint8_t { Untried, Data, Nothing };
    std::vector<Lead> leads(mBlocks.size(), Lead::Untried);
    for (std::size_t n = known; n < mBlocks.size(); ++n) {
        if (leads[n] != Lead::Untried || !isAtBorder(mBlocks[n].at)) continue;
        std::vector<std::size_t> followed;
        const Lead lead = leadsToData(n, known, followed) ? Lead::Data : Lead::Nothing;
        for (const std::size_t m : followed) leads[m] = lead;
    }
    std::vector<Block> rest(std::make_move_iterator(mBlocks.begin() + std::ptrdiff_t(known)),
                            std::make_move_iterator(mBlocks.end()));
    for (const Block& block : rest) mIndex.erase(packed(block.at));
    mBlocks.resize(known);
    for (std::size_t n = 0; n < rest.size(); ++n)
        if (leads[known + n] == Lead::Data) add(std::move(rest[n]));
}

/// Whether active voxels lead from block @a from to data, within the zone or beyond it; @a followed
/// are the zone's blocks from number @a known on that they lead to.
bool Band::leadsToData(std::size_t from, std::size_t known,
                       std::vector<std::size_t>& followed) const
{
    tbb::enumerable_thread_specific<std::unique_ptr<BlockSampler>> samplers(
        [&] { return mField.sampler(mLattice, double(mBackground)); });
    std::unordered_set<std::uint64_t> seen{packed(mBlocks[from].at)};
    std::vector<Vec3i> wave{mBlocks[from].at};
    bool found = false;
    // In the zone all is followed, so that each block is once; beyond it as far as needed.
    while (!wave.empty()) {
        std::vector<std::vector<Vec3i>> next(wave.size());
        std::vector<char> hasData(wave.size(), 0);
        tbb::parallel_for(std::size_t(0), wave.size(), [&](std::size_t n) {
            mProgress.check();
            const Vec3i& at = wave[n];
            if (isKnown(at)) {
                const Block* const block = find(at);
                if (block && std::size_t(block - mBlocks.data()) < known)
                    hasData[n] = 1;
                else if (block)
                    addNeighbors(*block, next[n]);
            } else if (!found) {
                const Block block = sample(*samplers.local(), at);
                if (!block.leaf || block.leaf->getValueMask().isOff()) return;
                SignWords all;
                all.fill(~std::uint64_t(0));
                hasData[n] = countData(at, all) > 0;
                addNeighbors(block, next[n]);
            }
        });
        for (const Vec3i& at : wave)
            if (const Block* const block = isKnown(at) ? find(at) : nullptr)
                if (const auto n = std::size_t(block - mBlocks.data()); n >= known)
                    followed.push_back(n);
        wave.clear();
        for (std::size_t n = 0; n < next.size(); ++n) {
            found |= hasData[n] != 0;
            for (const Vec3i& at : next[n])
                if (isInReach(at) && seen.insert(packed(at)).second) wave.push_back(at);
        }
        if (found) // only the zone is of interest any more
            wave.erase(std::remove_if(wave.begin(), wave.end(),
                                      [&](const Vec3i& at) { return !isKnown(at); }),
                       wave.end());
    }
    return found;
}

} // namespace mpuvdb
