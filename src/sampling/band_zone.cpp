// Bands of which only a zone is sampled.
#include "band.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{

void Band::searchUnsupported()
{
    // Where data support the surface, the band has been found from the data in the zone.
    const BlockBox& box = mZone->known;
    const Vec3i size = box.last - box.first + Vec3i::Ones();
    const double h = mLattice.voxelSize;
    // Half a block's diagonal from its center; values are approximate distances.
    const double near = 1.5 * (double(mBackground) + 0.5 * std::sqrt(3.0) * (kBlockDim - 1) * h);
    tbb::enumerable_thread_specific<std::unique_ptr<BlockSampler>> samplers(
        [&] { return mField.sampler(mLattice, double(mBackground)); });
    std::vector<std::vector<Vec3i>> found(std::size_t(size[0]) * std::size_t(size[1]));
    tbb::parallel_for(std::size_t(0), found.size(), [&](std::size_t column) {
        BlockSampler& sampler = *samplers.local();
        Vec3i at = box.first + Vec3i(int(column) / size[1], int(column) % size[1], 0);
        for (; at[2] <= box.last[2]; ++at[2]) {
            mProgress.check();
            if (find(at)) continue;
            const Vec3d middle = (at * kBlockDim).cast<double>().array() + 0.5 * (kBlockDim - 1);
            const FieldSample there = mField.evaluate(mLattice.origin + h * middle);
            if (there.supported || std::abs(there.value) > near) continue;
            const Block block = sample(sampler, at);
            if (block.leaf && !block.leaf->getValueMask().isOff()) found[column].push_back(at);
        }
    });
    std::vector<Vec3i> blocks;
    for (const auto& some : found) blocks.insert(blocks.end(), some.begin(), some.end());
    const std::size_t known = mBlocks.size();
    search(std::move(blocks));
    dropUncrossed(known);
}

/// Drop blocks from number @a known on whose active voxels are not connected to a change of sign:
/// where the field comes near to zero without crossing it, the whole's band has no blocks.
void Band::dropUncrossed(std::size_t known)
{
    std::vector<char> kept(mBlocks.size(), 0);
    std::vector<std::size_t> front;
    const auto keep = [&](std::size_t n) {
        if (!std::exchange(kept[n], 1)) front.push_back(n);
    };
    for (std::size_t n = 0; n < known; ++n) kept[n] = 1;
    for (std::size_t n = known; n < mBlocks.size(); ++n)
        if (countVoxels(signChanges(mBlocks[n])) > 0) keep(n);
    std::vector<Vec3i> beside;
    while (!front.empty()) {
        mProgress.check();
        const std::size_t n = front.back();
        front.pop_back();
        beside.clear();
        addNeighbors(mBlocks[n], beside);
        for (const Vec3i& next : beside)
            if (const auto found = mIndex.find(packed(next)); found != mIndex.end())
                keep(found->second);
    }
    std::vector<Block> rest(std::make_move_iterator(mBlocks.begin() + std::ptrdiff_t(known)),
                            std::make_move_iterator(mBlocks.end()));
    for (const Block& block : rest) mIndex.erase(packed(block.at));
    mBlocks.resize(known);
    for (std::size_t n = 0; n < rest.size(); ++n)
        if (kept[known + n]) add(std::move(rest[n]));
}

} // namespace mpuvdb
