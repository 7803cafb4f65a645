#include "fill_bubbles.h"

#include "core/parallel_each.h"
#include "core/union_find.h"
#include "grid/block_parts.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;

constexpr std::size_t kBubbleGrain = 64; // leaves; [free: the same bubbles]

/// The connected parts of the voxels outside in each leaf.
struct OutsideParts {
    std::vector<Leaf*> leaves; ///< by origin
    std::vector<std::vector<SignWords>> parts;
    std::vector<std::uint32_t> first; ///< number of each leaf's first part

    std::size_t find(const openvdb::Coord& origin) const
    {
        const auto at = std::lower_bound(
            leaves.begin(), leaves.end(), origin,
            [](const Leaf* leaf, const openvdb::Coord& o) { return leaf->origin() < o; });
        return at != leaves.end() && (*at)->origin() == origin ? std::size_t(at - leaves.begin())
                                                               : leaves.size();
    }
};

OutsideParts partsOf(openvdb::FloatTree& tree, Interrupter& progress)
{
    OutsideParts all;
    tree.getNodes(all.leaves);
    std::sort(all.leaves.begin(), all.leaves.end(),
              [](const Leaf* a, const Leaf* b) { return a->origin() < b->origin(); });
    all.parts.resize(all.leaves.size());
    forEachParallel(all.leaves.size(), kBubbleGrain, progress, [&](std::size_t n) {
        const float* const values = all.leaves[n]->buffer().data();
        appendConnectedParts(wordsWhere(values, [](float v) { return !(v < 0); }), all.parts[n]);
    });
    std::uint32_t count = 0;
    for (const auto& parts : all.parts) {
        all.first.push_back(count);
        count += std::uint32_t(parts.size());
    }
    all.first.push_back(count);
    return all;
}

} // namespace

std::uint64_t fillBubbles(openvdb::FloatTree& tree, std::uint64_t most, Interrupter& progress)
{
    const OutsideParts all = partsOf(tree, progress);
    const std::uint32_t count = all.first.back();
    UnionFind components(count);
    std::vector<char> isOpen(count, 0);
    for (std::size_t n = 0; n < all.leaves.size(); ++n) {
        if (n % kBubbleGrain == 0) progress.check();
        for (int face = 0; face < 6; ++face) {
            const int axis = face / 2;
            const bool upper = face % 2;
            openvdb::Coord origin = all.leaves[n]->origin();
            origin[axis] += upper ? kBlockDim : -kBlockDim;
            const std::size_t beside = all.find(origin);
            const bool isTile = beside == all.leaves.size();
            if (isTile && tree.getValue(origin) < 0) continue;
            for (std::size_t p = 0; p < all.parts[n].size(); ++p) {
                const auto part = std::uint32_t(all.first[n] + p);
                if (!reachesFace(all.parts[n][p], axis, upper)) continue;
                if (isTile) isOpen[part] = 1;
                for (std::size_t q = 0; upper && !isTile && q < all.parts[beside].size(); ++q)
                    if (meet(all.parts[n][p], all.parts[beside][q], axis))
                        components.join(part, std::uint32_t(all.first[beside] + q));
            }
        }
    }
    std::vector<std::uint64_t> voxels(count, 0); // by root; many where it is open
    for (std::size_t n = 0; n < all.leaves.size(); ++n)
        for (std::size_t p = 0; p < all.parts[n].size(); ++p) {
            const auto part = std::uint32_t(all.first[n] + p);
            voxels[components.find(part)] +=
                countVoxels(all.parts[n][p]) + (isOpen[part] ? most + 1 : 0);
        }
    std::uint64_t filled = 0;
    for (std::size_t n = 0; n < all.leaves.size(); ++n)
        for (std::size_t p = 0; p < all.parts[n].size(); ++p) {
            const auto part = std::uint32_t(all.first[n] + p);
            const std::uint32_t root = components.find(part);
            if (voxels[root] > most) continue;
            filled += root == part;
            float* const values = all.leaves[n]->buffer().data();
            for (int v = 0; v < kBlockVoxels; ++v)
                if (all.parts[n][p][std::size_t(v / 64)] >> (v % 64) & 1u)
                    values[v] = std::min(-values[v], -std::numeric_limits<float>::min());
        }
    return filled;
}

} // namespace mpuvdb
