#include "dual_cells.h"

#include "joined_faces.h"
#include "sign_halo.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Access = SignHalo::Access;

/// Find the cells of @a block.
void findCells(const Access& access, float voxelSize, DualBlock& block)
{
    const JoinedFaces faces(access, voxelSize);
    const SignHalo signs(access, block.origin);
    std::size_t count = 0;
    for (int x = 0; x < 8; ++x) {
        const std::uint64_t passed = block.passed[std::size_t(x)] = signs.passed(x);
        for (int y = 0; y < 8; ++y) {
            block.rank[8 * std::size_t(x) + std::size_t(y)] = std::uint16_t(count);
            count += kBitCounts[passed >> (8 * y) & 0xff];
        }
    }
    block.cells.reserve(count);
    for (int x = 0; x < 8; ++x)
        for (std::uint64_t bits = block.passed[std::size_t(x)]; bits; bits &= bits - 1) {
            const int bit = __builtin_ctzll(bits), y = bit >> 3, z = bit & 7;
            const std::uint8_t inside = signs.corners(x, y, z);
            const std::uint8_t joined =
                ambiguousFaces(inside) ? faces.of(block.origin.offsetBy(x, y, z), inside) : 0;
            block.cells.push_back({std::uint16_t(block.vertices), inside, joined});
            block.vertices += block.cells.back().sheets().count;
            for (int axis = 0; axis < 3; ++axis)
                block.quads += (inside >> (4 >> axis) & 1) != (inside & 1);
        }
}

using Origins = std::vector<Coord>;

Origins leafOrigins(const openvdb::FloatTree& tree)
{
    Origins origins;
    origins.reserve(tree.leafCount());
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) origins.push_back(leaf->origin());
    return origins;
}

/// Range of steps to blocks around a block, on each axis.
struct Steps {
    int low, high;
};

/// Add the blocks around @a block that are not leaves and not in @a known, which is sorted.
void addAround(const Coord& block, Steps steps, const Access& access, const Origins& known,
               Origins& found)
{
    for (int x = steps.low; x <= steps.high; ++x)
        for (int y = steps.low; y <= steps.high; ++y)
            for (int z = steps.low; z <= steps.high; ++z) {
                const Coord at = block.offsetBy(8 * x, 8 * y, 8 * z);
                if (!access.probeConstLeaf(at) &&
                    !std::binary_search(known.begin(), known.end(), at))
                    found.push_back(at);
            }
}

/// The blocks around @a blocks that are not leaves and not in @a known, sorted.
Origins around(const Origins& blocks, Steps steps, const openvdb::FloatTree& tree,
               const Origins& known)
{
    tbb::enumerable_thread_specific<Origins> parts;
    using Range = tbb::blocked_range<std::size_t>;
    tbb::parallel_for(Range(0, blocks.size(), 256), [&](const Range& range) {
        const Access access(tree);
        Origins& found = parts.local();
        for (std::size_t n = range.begin(); n < range.end(); ++n)
            addAround(blocks[n], steps, access, known, found);
    });
    Origins found;
    for (const Origins& part : parts) found.insert(found.end(), part.begin(), part.end());
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
}

/// Drop the blocks that do not count.
void keep(Origins& origins, const BlockFilter& only)
{
    if (only)
        origins.erase(std::remove_if(origins.begin(), origins.end(),
                                     [&](const Coord& origin) { return !only(origin); }),
                      origins.end());
}

} // namespace

const std::array<std::uint8_t, 256> kBitCounts = [] {
    std::array<std::uint8_t, 256> counts{};
    for (std::size_t n = 1; n < 256; ++n) counts[n] = std::uint8_t(counts[n / 2] + n % 2);
    return counts;
}();

DualCells::DualCells(const openvdb::FloatTree& tree, double voxelSize, Interrupter& progress,
                     const BlockFilter& only)
{
    Origins leaves = leafOrigins(tree);
    keep(leaves, only);
    add(tree, leaves, float(voxelSize), progress);
    // A cell belongs to its lowest voxel, which may lie below the leaves. Where tiles of different
    // sign meet, cells without any leaf follow.
    Origins known;
    for (Origins next = around(leaves, {-1, 0}, tree, known); !next.empty();) {
        keep(next, only);
        const std::size_t before = mBlocks.size();
        add(tree, next, float(voxelSize), progress);
        known.insert(known.end(), next.begin(), next.end());
        std::sort(known.begin(), known.end());
        Origins passed;
        for (std::size_t n = before; n < mBlocks.size(); ++n) passed.push_back(mBlocks[n].origin);
        next = around(passed, {-1, 1}, tree, known);
    }
    number();
}

/// Add those of the blocks at @a origins that the surface crosses.
void DualCells::add(const openvdb::FloatTree& tree, const std::vector<Coord>& origins,
                    float voxelSize, Interrupter& progress)
{
    std::vector<DualBlock> found(origins.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, origins.size(), 32),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          const Access access(tree);
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              found[n].origin = origins[n];
                              findCells(access, voxelSize, found[n]);
                          }
                      });
    for (DualBlock& block : found)
        if (!block.cells.empty()) mBlocks.push_back(std::move(block));
}

void DualCells::number()
{
    std::unordered_map<Coord, std::uint32_t> index; // by origin
    index.reserve(mBlocks.size());
    for (DualBlock& block : mBlocks) {
        index.emplace(block.origin, std::uint32_t(index.size()));
        block.firstVertex = mVertices;
        block.firstQuad = mQuads;
        mVertices += block.vertices;
        mQuads += block.quads;
    }
    tbb::parallel_for(std::size_t(0), mBlocks.size(), [&](std::size_t n) {
        for (int step = 0; step < 8; ++step) {
            const auto found = index.find(mBlocks[n].origin.offsetBy(
                step & 4 ? -8 : 0, step & 2 ? -8 : 0, step & 1 ? -8 : 0));
            mBlocks[n].near[std::size_t(step)] =
                found != index.end() ? found->second : DualBlock::kNone;
        }
    });
}

std::size_t DualCells::blockOf(std::uint64_t v) const
{
    const auto after = std::upper_bound(
        mBlocks.begin(), mBlocks.end(), v,
        [](std::uint64_t vertex, const DualBlock& block) { return vertex < block.firstVertex; });
    return std::size_t(after - mBlocks.begin()) - 1;
}

std::vector<char> DualCells::withNeighbors(const std::vector<char>& selection) const
{
    std::vector<char> reached(selection.size(), 0);
    tbb::parallel_for(std::size_t(0), selection.size(), [&](std::size_t n) {
        for (const std::uint32_t near : mBlocks[n].near)
            if (near != DualBlock::kNone && selection[near]) reached[n] = 1;
    });
    return reached;
}

} // namespace mpuvdb
