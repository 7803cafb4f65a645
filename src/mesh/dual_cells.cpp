#include "dual_cells.h"

#include <mpuvdb/progress.h>

#include <algorithm>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;

/// Signs of a block's voxels and of those one step above, in rows along z.
class SignHalo
{
public:
    explicit SignHalo(const BlockHalo& values)
    {
        for (int x = 0; x <= 8; ++x)
            for (int y = 0; y <= 8; ++y) {
                std::uint32_t row = 0;
                const int start = BlockHalo::index(x, y, 0);
                for (int z = 0; z <= 8; ++z) row |= std::uint32_t(values[start + z] < 0) << z;
                mRows[std::size_t(x)][std::size_t(y)] = row;
            }
    }

    /// The row's voxels that are inside, bit z.
    std::uint32_t row(int x, int y) const { return mRows[std::size_t(x)][std::size_t(y)]; }

    std::uint8_t corners(int x, int y, int z) const
    {
        const auto pair = [&](int dx, int dy) {
            const std::uint32_t two = row(x + dx, y + dy) >> z & 3;
            return two; // bit 0: z, bit 1: z + 1
        };
        return std::uint8_t(pair(0, 0) | pair(0, 1) << 2 | pair(1, 0) << 4 | pair(1, 1) << 6);
    }

private:
    std::array<std::array<std::uint32_t, 9>, 9> mRows;
};

std::uint8_t cornersAt(const openvdb::FloatTree& tree, const Coord& at)
{
    std::uint8_t inside = 0;
    for (int c = 0; c < 8; ++c)
        if (tree.getValue(at.offsetBy(c >> 2 & 1, c >> 1 & 1, c & 1)) < 0)
            inside = std::uint8_t(inside | 1 << c);
    return inside;
}

/// Whether the cell at @a at has to turn its doubtful face: the other cell there doubts it too.
bool isTurned(const openvdb::FloatTree& tree, const Coord& at, std::uint8_t inside)
{
    const int face = doubtfulFace(inside);
    if (face < 0) return false;
    Coord next = at;
    next[face / 2] += face % 2 ? 1 : -1;
    return doubtfulFace(cornersAt(tree, next)) == (face ^ 1);
}

/// Find the cells of @a block.
void findCells(const openvdb::FloatTree& tree, DualBlock& block)
{
    BlockHalo values;
    values.load(tree, block.origin);
    const SignHalo signs(values);
    for (int x = 0; x < 8; ++x) {
        block.rank[std::size_t(x)] = std::uint16_t(block.cells.size());
        for (int y = 0; y < 8; ++y) {
            const std::uint32_t a = signs.row(x, y), b = signs.row(x, y + 1),
                                c = signs.row(x + 1, y), d = signs.row(x + 1, y + 1);
            const std::uint32_t any = a | b | c | d, all = a & b & c & d;
            // Passed: not all corners alike, over two steps of z.
            const std::uint32_t passed = ((any | any >> 1) & ~(all & all >> 1)) & 0xff;
            block.passed[std::size_t(x)] |= std::uint64_t(passed) << (8 * y);
            for (std::uint32_t bits = passed; bits; bits &= bits - 1) {
                const int z = __builtin_ctz(bits);
                const std::uint8_t inside = signs.corners(x, y, z);
                const bool turned = isTurned(tree, block.origin.offsetBy(x, y, z), inside);
                block.cells.push_back({std::uint16_t(block.vertices), inside, turned});
                block.vertices += block.cells.back().sheets().count;
                for (int axis = 0; axis < 3; ++axis)
                    block.quads += (inside >> (4 >> axis) & 1) != (inside & 1);
            }
        }
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

/// The blocks around @a blocks, from @a low steps below them to @a high above, that are no leaves
/// and not in @a known; sorted.
Origins around(const Origins& blocks, int low, int high, const openvdb::FloatTree& tree,
               const Origins& known)
{
    Origins found;
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(tree);
    for (const Coord& block : blocks)
        for (int x = low; x <= high; ++x)
            for (int y = low; y <= high; ++y)
                for (int z = low; z <= high; ++z) {
                    const Coord at = block.offsetBy(8 * x, 8 * y, 8 * z);
                    if (!access.probeConstLeaf(at) &&
                        !std::binary_search(known.begin(), known.end(), at))
                        found.push_back(at);
                }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
}

} // namespace

void BlockHalo::load(const openvdb::FloatTree& tree, const Coord& origin)
{
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(tree);
    // Per axis: from the block below one voxel, from the block all eight, from the next two.
    constexpr std::array<int, 3> kFrom = {7, 0, 0}, kTo = {-1, 0, 8}, kCount = {1, 8, 2};
    for (std::size_t bx = 0; bx < 3; ++bx)
        for (std::size_t by = 0; by < 3; ++by)
            for (std::size_t bz = 0; bz < 3; ++bz) {
                const Coord at = origin.offsetBy(8 * int(bx) - 8, 8 * int(by) - 8, 8 * int(bz) - 8);
                const Leaf* leaf = access.probeConstLeaf(at);
                const float* data = leaf ? leaf->buffer().data() : nullptr;
                const float tile = leaf ? 0 : access.getValue(at);
                for (int x = 0; x < kCount[bx]; ++x)
                    for (int y = 0; y < kCount[by]; ++y) {
                        float* row =
                            &mValues[std::size_t(index(kTo[bx] + x, kTo[by] + y, kTo[bz]))];
                        if (data)
                            std::copy_n(data + (kFrom[bx] + x) * 64 + (kFrom[by] + y) * 8 +
                                            kFrom[bz],
                                        kCount[bz], row);
                        else
                            std::fill_n(row, kCount[bz], tile);
                    }
            }
}

DualCells::DualCells(const openvdb::FloatTree& tree, Progress& progress)
{
    const Origins leaves = leafOrigins(tree);
    add(tree, leaves, progress);
    // A cell belongs to its lowest voxel, which may lie below the leaves. Where it has no leaf
    // about it at all (two tiles of different sign meet), the surface is followed on.
    Origins known;
    for (Origins next = around(leaves, -1, 0, tree, known); !next.empty();) {
        const std::size_t before = mBlocks.size();
        add(tree, next, progress);
        known.insert(known.end(), next.begin(), next.end());
        std::sort(known.begin(), known.end());
        Origins passed;
        for (std::size_t n = before; n < mBlocks.size(); ++n) passed.push_back(mBlocks[n].origin);
        next = around(passed, -1, 1, tree, known);
    }
    number();
}

/// Those of the blocks at @a origins that the surface passes.
void DualCells::add(const openvdb::FloatTree& tree, const std::vector<Coord>& origins,
                    Progress& progress)
{
    std::vector<DualBlock> found(origins.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, origins.size(), 32),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              found[n].origin = origins[n];
                              findCells(tree, found[n]);
                          }
                      });
    for (DualBlock& block : found)
        if (!block.cells.empty()) mBlocks.push_back(std::move(block));
}

void DualCells::number()
{
    mIndex.reserve(mBlocks.size());
    for (DualBlock& block : mBlocks) {
        mIndex.emplace(block.origin, std::uint32_t(mIndex.size()));
        block.firstVertex = mVertices;
        block.firstQuad = mQuads;
        mVertices += block.vertices;
        mQuads += block.quads;
    }
}

std::size_t DualCells::blockOf(std::uint64_t v) const
{
    const auto after = std::upper_bound(
        mBlocks.begin(), mBlocks.end(), v,
        [](std::uint64_t vertex, const DualBlock& block) { return vertex < block.firstVertex; });
    return std::size_t(after - mBlocks.begin()) - 1;
}

std::vector<char> DualCells::withNeighbours(const std::vector<char>& selection) const
{
    std::vector<char> reached(selection.size(), 0);
    tbb::parallel_for(std::size_t(0), selection.size(), [&](std::size_t n) {
        for (const DualBlock* near : neighboursOf(mBlocks[n]))
            if (near && selection[std::size_t(near - mBlocks.data())]) reached[n] = 1;
    });
    return reached;
}

DualCells::Neighbours DualCells::neighboursOf(const DualBlock& block) const
{
    Neighbours near{};
    for (int step = 0; step < 8; ++step) {
        const auto found = mIndex.find(
            block.origin.offsetBy(step & 4 ? -8 : 0, step & 2 ? -8 : 0, step & 1 ? -8 : 0));
        if (found != mIndex.end()) near[std::size_t(step)] = &mBlocks[found->second];
    }
    return near;
}

} // namespace mpuvdb
